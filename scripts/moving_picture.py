"""Records the moving picture of README: Scenario 1b from the simulator's camera, with the messages as they are exchanged.

    .venv/bin/python scripts/moving_picture.py docs/images/scenario-1b.webp

It needs OpenGL, and takes about two minutes.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import tempfile
from pathlib import Path

from somrs.client.client import Client
from somrs.client.message_chart import SETBACKS
from somrs.client.simulator_link import operator_link
from somrs.client.trace import Follower, Line
from somrs.demo.film import Film, Frame
from somrs.demo.scenarios import CHEAP_ROBOT, REQUEST, prepare
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink

SPEED = "2"
"""Simulated seconds per second: slow, so that the pictures, each of which takes the simulator a moment, have equal distances."""

SIMULATED_INTERVAL = 0.5
"""Simulated seconds between two pictures."""

ROOM = 0.017, 0.211, 0.7, 0.778
"""The part of the camera's picture that shows the room where the scenario takes place."""

MESSAGE_ROWS = 4
"""Rows of messages below the picture."""


class Recording:
    """The film, and the messages so far."""

    def __init__(self, messages: Follower) -> None:
        self.film, self._follower, self._messages = Film(), messages, list[Line]()

    def add_frame(self, png: bytes) -> None:
        """Add a picture of the simulator's camera, with the last messages below it, and the last setback among all."""
        self._messages += (line for line in self._follower.new() if line.type != "Progress")
        rows = [(message.type, _ends(message)) for message in self._messages[-MESSAGE_ROWS:]]
        setback = next((message for message in reversed(self._messages) if message.type in SETBACKS), None)
        caption = f"{setback.type} {_ends(setback)}" if setback is not None else REQUEST.effect
        blank_rows = [("", "")] * (MESSAGE_ROWS - len(rows))
        self.film.add(Frame(pictures={"": png}, caption=caption, rows=(*rows, *blank_rows), view=ROOM))


def _ends(message: Line) -> str:
    return f"from {message.sender} to {message.recipient}"


async def record(folder: Path) -> Recording:
    """Play the scenario in a system of its own, with its files in `folder`."""
    site, distance = prepare("1b", folder, seed=None)
    system = System([site], folder / "run", speed=SPEED)
    recording = Recording(Follower(system.data / "messages.jsonl"))
    try:
        await system.start()
        async with Client(system.addresses) as client, operator_link(system.addresses) as operator:
            await operator.schedule(CHEAP_ROBOT, Fault.DRIVE, carried=distance)
            task = await client.submit(REQUEST)
            camera = asyncio.create_task(take_pictures(operator, recording))
            async for _news in client.news(task):
                pass
            await operator.idle()
            camera.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await camera
            recording.add_frame(await operator.picture())
    finally:
        await system.stop()
    return recording


async def take_pictures(operator: OperatorLink, recording: Recording) -> None:
    """Take a picture at each interval of simulated time, until cancelled."""
    due = (await operator.clock()).time
    while True:
        now = (await operator.clock()).time
        if now < due:
            await asyncio.sleep(0.01)
            continue
        due += SIMULATED_INTERVAL
        recording.add_frame(await operator.picture())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", type=Path, help="the WebP file to write")
    target: Path = parser.parse_args().target
    with tempfile.TemporaryDirectory() as folder:
        recording = asyncio.run(record(Path(folder)))
    if not recording.film.save(target):
        raise SystemExit("no picture was taken")
    print(f"{target}: {target.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
