"""Records the moving picture of README: Scenario 1b from the simulator's camera, with the messages as they are exchanged.

    .venv/bin/python scripts/moving_picture.py docs/images/scenario-1b.gif

It needs OpenGL, and takes about two minutes.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import io
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from somrs.client.client import Client
from somrs.client.message_chart import SETBACKS
from somrs.client.trace import Follower, Line
from somrs.demo.scenarios import CHEAP_ROBOT, REQUEST, prepare
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink

SPEED = "2"
"""Simulated seconds per second: slow, so that the pictures, each of which takes the simulator a moment, have equal distances."""

SIMULATED_INTERVAL, FRAME_DURATION = 0.5, 80
"""Between two pictures: simulated seconds in the scenario, and milliseconds in the moving picture."""

LAST_FRAME_DURATION = 3000
"""Milliseconds for which the end is shown."""

ROOM = 20, 190, 840, 700
"""The part of the camera's picture that shows the room where the scenario takes place: left, top, right and bottom, in pixels."""

MESSAGE_ROWS, ROW, COLOURS = 4, 24, 160
"""Rows of messages below the picture, their height in pixels, and the size of a frame's palette."""

INK, ALERT, FAINT, PAPER = "#1c2733", "#b3261e", "#6b7a88", "#ffffff"


@dataclass(slots=True)
class Recording:
    """The frames of the moving picture. `messages` are those exchanged so far."""

    messages: list[Line] = field(default_factory=list)
    frames: list[Image.Image] = field(default_factory=list)

    def add_frame(self, png: bytes) -> None:
        """Add a picture of the simulator's camera, with the last messages below it."""
        picture = Image.open(io.BytesIO(png)).convert("RGB")
        picture = picture.crop(ROOM)
        frame = Image.new("RGB", (picture.width, picture.height + MESSAGE_ROWS * ROW + 12), PAPER)
        frame.paste(picture, (0, 0))
        draw, font = ImageDraw.Draw(frame), ImageFont.load_default(size=16)
        for row, message in enumerate(self.messages[-MESSAGE_ROWS:]):
            y = picture.height + 8 + row * ROW
            draw.text((24, y), message.type, fill=ALERT if message.type in SETBACKS else INK, font=font)
            draw.text((140, y), f"from {message.sender} to {message.recipient}", fill=FAINT, font=font)
        self.frames.append(frame)

    def save(self, target: Path) -> None:
        """Write the frames as a GIF that repeats for ever."""
        frames = [frame.quantize(COLOURS, dither=Image.Dither.NONE) for frame in self.frames]
        durations = [FRAME_DURATION] * (len(frames) - 1) + [LAST_FRAME_DURATION]
        frames[0].save(target, save_all=True, append_images=frames[1:], duration=durations, loop=0, optimize=True)


async def record(folder: Path) -> Recording:
    """Play the scenario in a system of its own, with its files in `folder`."""
    site, distance = prepare("1b", folder, seed=None)
    system = System([site], folder / "run", speed=SPEED)
    recording, trace = Recording(), Follower(system.data / "messages.jsonl")
    try:
        await system.start()
        assert system.addresses.simulator is not None, "the scenario's robots are simulated"
        host, _, port = system.addresses.simulator.rpartition(":")
        async with Client(system.addresses) as client, OperatorLink(host, int(port)) as operator:
            await operator.schedule(CHEAP_ROBOT, Fault.DRIVE, carried=distance)
            task = await client.submit(REQUEST)
            camera = asyncio.create_task(take_pictures(operator, trace, recording))
            async for _news in client.news(task):
                pass
            await operator.idle()
            camera.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await camera
            recording.messages += relevant(trace.new())
            recording.add_frame(await operator.picture())
    finally:
        await system.stop()
    return recording


async def take_pictures(operator: OperatorLink, trace: Follower, recording: Recording) -> None:
    """Take a picture at each interval of simulated time, until cancelled."""
    due = (await operator.clock()).time
    while True:
        now = (await operator.clock()).time
        if now < due:
            await asyncio.sleep(0.01)
            continue
        due += SIMULATED_INTERVAL
        recording.messages += relevant(trace.new())
        recording.add_frame(await operator.picture())


def relevant(lines: Iterable[Line]) -> list[Line]:
    """The messages without the heartbeats."""
    return [line for line in lines if line.type != "Progress"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", type=Path, help="the GIF to write")
    target: Path = parser.parse_args().target
    with tempfile.TemporaryDirectory() as folder:
        recording = asyncio.run(record(Path(folder)))
    recording.save(target)
    print(f"{target}: {len(recording.frames)} pictures, {target.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
