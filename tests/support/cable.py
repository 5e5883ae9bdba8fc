"""A cable to a server, which can be cut."""

from __future__ import annotations

import asyncio


class Cable:
    """Leads to a server at a port, until it is `cut`: then nothing comes through it, and neither end hears of that. When it is closed, both
    ends find their connections ended, without a word of the protocol. A context manager."""

    def __init__(self, port: int) -> None:
        self._port, self.is_cut, self._ends = port, False, list[asyncio.StreamWriter]()

    async def __aenter__(self) -> int:
        """The port at which it begins."""
        self._server = await asyncio.start_server(self._join, "127.0.0.1", 0)
        port: int = self._server.sockets[0].getsockname()[1]
        return port

    async def __aexit__(self, *exception: object) -> None:
        self._server.close()
        for writer in self._ends:
            writer.close()

    async def _join(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._port)
        self._ends += (writer, far_writer)
        await asyncio.gather(self._pass_on(reader, far_writer), self._pass_on(far_reader, writer), return_exceptions=True)

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while (data := await reader.read(65_536)) and not self.is_cut:
            writer.write(data)
