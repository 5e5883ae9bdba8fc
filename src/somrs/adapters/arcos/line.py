"""The line to a robot: TCP or serial. It feeds the driver, and opens again what is lost."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable

from somrs.adapters.arcos.driver import Driver
from somrs.adapters.arcos.events import Connected, Disconnected, Effect, Input, Quit, Received, Tick, Transmit
from somrs.adapters.wires import WireRecord
from somrs.errors import UsageError

log = logging.getLogger(__name__)

TICK = 0.05
"""Seconds between two ticks."""
RETRY = 1.0
"""Seconds after which a line that could not be opened is tried again."""
LARGEST_BACKLOG = 1024
"""Bytes that may wait to be sent. A line on which more waits is closed: what waits is old, and a robot must not follow it."""

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


async def open_line(port: str, baud: int) -> Streams:
    """Open `tcp://HOST:PORT`, or a serial line. Raises OSError; UsageError if what serial lines need is not installed."""
    if port.startswith("tcp://"):
        host, _, number = port.removeprefix("tcp://").rpartition(":")
        return await asyncio.open_connection(host, int(number))
    try:
        import serial_asyncio_fast  # type: ignore[import-not-found,unused-ignore]  # only who has a serial line needs it
    except ImportError:
        raise UsageError("serial lines need another package: pip install 'somrs[arcos]'") from None
    streams: Streams = await serial_asyncio_fast.open_serial_connection(url=port, baudrate=baud)
    return streams


class RobotLine:
    """Joins a driver with its robot. `on_effect` is called with all effects but Transmit."""

    def __init__(self, driver: Driver, port: str, baud: int, on_effect: Callable[[Effect], None]) -> None:
        self.driver, self._port, self._baud, self._on_effect = driver, port, baud, on_effect
        self._writer: asyncio.StreamWriter | None = None
        self._record = WireRecord(f"arcos-{port.rpartition('/')[2].replace(':', '-')}")

    def give(self, input: Input) -> None:
        """Give the driver an input, and carry its effects out."""
        for effect in self.driver.handle(input, asyncio.get_running_loop().time()):
            if not isinstance(effect, Transmit):
                self._on_effect(effect)
            elif self._writer is not None:
                self._transmit(self._writer, effect.data)

    def _transmit(self, writer: asyncio.StreamWriter, data: bytes) -> None:
        if writer.transport.get_write_buffer_size() > LARGEST_BACKLOG:
            log.warning("%s takes nothing any more; the line is opened anew", self._port)
            writer.transport.abort()
        elif not writer.is_closing():
            self._record.note(">", data)
            writer.write(data)

    async def run(self) -> None:
        """Keep the line open, until cancelled; then stop the robot."""
        ticking = asyncio.create_task(self._tick())
        failure = ""
        try:
            while True:
                try:
                    reader, self._writer = await open_line(self._port, self._baud)
                except OSError as error:
                    if str(error) != failure:
                        failure = str(error)
                        self.give(Disconnected(f"{self._port} cannot be opened, and is tried again: {failure}"))
                    await asyncio.sleep(RETRY)
                    continue
                failure = ""
                await self._serve(reader)
                await asyncio.sleep(RETRY)
        finally:
            ticking.cancel()

    async def _serve(self, reader: asyncio.StreamReader) -> None:
        """Read from an open line until it is lost."""
        writer, problem = self._writer, None
        assert writer is not None, "the line is open"
        try:
            self.give(Connected())
            while data := await reader.read(1024):
                self._record.note("<", data)
                self.give(Received(data))
            problem = f"the other end has closed {self._port}"
        except OSError as error:
            problem = f"{self._port} is lost: {error}"
        except asyncio.CancelledError:
            self.give(Quit())
            raise
        finally:
            self._writer = None
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()
            self.give(Disconnected(problem))

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(TICK)
            self.give(Tick())
