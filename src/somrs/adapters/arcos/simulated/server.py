"""Simulated controllers on real lines: a TCP port, or a pseudo-terminal in place of a serial line."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import tty
from collections.abc import AsyncIterator, Callable

from somrs.adapters.arcos.simulated.firmware import Firmware
from somrs.ports import listen_at

HOST = "127.0.0.1"
STEP = 0.02
"""Seconds between two steps of a controller."""
MOST_STEPS = 50
"""Steps that a controller makes up for, when this program was held up."""


class SimulatedRobot:
    """A controller that runs in real time, and the line to it. Like a real one, it does not notice who is at the other end of the line, nor
    that somebody else is.

    `loss`: the share of bytes that the line loses, in both directions; all, while it has no contact (`has_contact`).
    """

    def __init__(self, firmware: Firmware, *, has_contact: Callable[[], bool] = lambda: True) -> None:
        self.firmware = firmware
        self.loss, self._has_contact = 0.0, has_contact
        self._random = random.Random(0)
        self._send: Callable[[bytes], None] | None = None

    async def run(self) -> None:
        """Let time pass, until cancelled."""
        loop = asyncio.get_running_loop()
        time = loop.time()
        while True:
            await asyncio.sleep(STEP)
            time = max(time, loop.time() - MOST_STEPS * STEP)
            while time + STEP <= loop.time():
                time += STEP
                data = self._through_line(self.firmware.step(STEP))
                if data and self._send is not None:
                    self._send(data)

    def receive(self, data: bytes) -> None:
        self.firmware.receive(self._through_line(data))

    def attach(self, send: Callable[[bytes], None] | None) -> None:
        """Connect another line; None: no line."""
        self._send = send

    def _through_line(self, data: bytes) -> bytes:
        if not self._has_contact():
            return b""
        if not self.loss:
            return data
        return bytes(byte for byte in data if self._random.random() >= self.loss)

    async def converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve a TCP client, until it is gone or another one comes."""
        send = writer.write
        self.attach(send)
        try:
            while data := await reader.read(1024):
                if self._send is not send:
                    break
                self.receive(data)
        except OSError:
            pass
        finally:
            if self._send is send:
                self.attach(None)
            writer.close()


@contextlib.asynccontextmanager
async def serving_tcp(robot: SimulatedRobot, port: int = 0) -> AsyncIterator[str]:
    """Run a controller behind a TCP port of this computer; yields its address for the settings, `tcp://...`. Port 0: any."""
    server = await asyncio.start_server(robot.converse, sock=listen_at(HOST, port))
    running = asyncio.create_task(robot.run())
    try:
        yield f"tcp://{HOST}:{server.sockets[0].getsockname()[1]}"
    finally:
        running.cancel()
        server.close()
        await asyncio.wait({running})


@contextlib.asynccontextmanager
async def serving_terminal(robot: SimulatedRobot) -> AsyncIterator[str]:
    """Run a controller behind a pseudo-terminal; yields its path, which is opened like a serial line."""
    controller, terminal = os.openpty()
    tty.setraw(terminal)
    os.set_blocking(controller, False)
    loop = asyncio.get_running_loop()

    def send(data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):  # nobody reads: a serial line loses what is not read
            os.write(controller, data)

    def read() -> None:
        with contextlib.suppress(BlockingIOError):
            robot.receive(os.read(controller, 1024))

    loop.add_reader(controller, read)
    robot.attach(send)
    running = asyncio.create_task(robot.run())
    try:
        yield os.ttyname(terminal)
    finally:
        running.cancel()
        loop.remove_reader(controller)
        os.close(controller)
        os.close(terminal)
        await asyncio.wait({running})
