"""The connections of a server of lines, whose number is bounded."""

from __future__ import annotations

import asyncio

from somrs.limits import limits


class OpenSockets:
    """The connections that are open: at most as many as the limits allow. A new one takes the place of the oldest that has said nothing."""

    def __init__(self) -> None:
        self.limit = limits().connections
        self._silent: dict[asyncio.StreamWriter, None] = {}
        self._heard: set[asyncio.StreamWriter] = set()

    def add(self, writer: asyncio.StreamWriter) -> bool:
        """Add a new connection. Returns whether there is a place for it."""
        if len(self._silent) + len(self._heard) >= self.limit:
            if not self._silent:
                return False
            oldest = next(iter(self._silent))
            del self._silent[oldest]
            oldest.transport.abort()
        self._silent[writer] = None
        return True

    def note_heard(self, writer: asyncio.StreamWriter) -> None:
        """Note that a connection has begun to speak, and keeps its place."""
        if writer in self._silent:
            del self._silent[writer]
            self._heard.add(writer)

    def remove(self, writer: asyncio.StreamWriter) -> None:
        self._silent.pop(writer, None)
        self._heard.discard(writer)

    def close(self) -> None:
        """Close all connections."""
        for writer in (*self._silent, *self._heard):
            writer.close()
