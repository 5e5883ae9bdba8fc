"""Saves the map of a robot (nav_msgs/OccupancyGrid) as files that `somrs import` and Nav2's map server read:

python -m somrs.adapters.ros2.save_map --topic /map --out floor
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import binascii
import sys
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from somrs.adapters.ros2.frames import pose_of
from somrs.adapters.ros2.lines import Values
from somrs.adapters.ros2.process import BridgeProcess
from somrs.adapters.ros2.settings import read_settings
from somrs.errors import InputError, SomrsError

OCCUPIED, FREE = 65, 25
"""From which probability on, in percent, a cell is occupied, and up to which it is free: those of Nav2's map saver."""
OCCUPIED_GREY, FREE_GREY, UNKNOWN_GREY = 0, 254, 205


class _MetaData(Struct, frozen=True):
    resolution: float
    width: int
    height: int
    origin: dict[str, Any]


class _Grid(Struct, frozen=True):
    info: _MetaData
    data: str


def map_files(message: Values, image: str) -> tuple[str, bytes]:
    """The text of map.yaml and the PGM image of a nav_msgs/OccupancyGrid. `image`: the name of the image's file.

    Rows of the message begin at its origin, those of the image at the top. Raises InputError if it is no map.
    """
    try:
        grid = msgspec.convert(message, _Grid)
        cells = base64.b64decode(grid.data, validate=True)
    except (msgspec.ValidationError, binascii.Error) as error:
        raise InputError(f"this is not a map: {error}; the topic has to be of the type nav_msgs/msg/OccupancyGrid") from None
    info, origin = grid.info, pose_of(grid.info.origin)
    if origin is None or len(cells) != info.width * info.height or not cells:
        raise InputError(f"the map has {len(cells)} cells, and should have {info.width} × {info.height}, with an origin: is it whole?")
    rows = [cells[row * info.width : (row + 1) * info.width] for row in reversed(range(info.height))]
    header = f"P5\n{info.width} {info.height}\n255\n".encode()
    description = {
        "image": image,
        "mode": "trinary",
        "resolution": float(f"{info.resolution:.6g}"),
        "origin": [origin.x, origin.y, origin.yaw],
        "negate": 0,
        "occupied_thresh": OCCUPIED / 100,
        "free_thresh": 0.196,  # the grey of unknown cells is just above it
    }
    text = "".join(f"{name}: {value}\n" for name, value in description.items())
    return text, header + b"".join(rows).translate(_GREYS)


def _grey(cell: int) -> int:
    """The grey of a cell. Unknown cells are -1, which is 255 as a byte."""
    if cell > 100:
        return UNKNOWN_GREY
    return OCCUPIED_GREY if cell >= OCCUPIED else FREE_GREY if cell <= FREE else UNKNOWN_GREY


_GREYS = bytes(map(_grey, range(256)))


async def receive_map(bridge: BridgeProcess, topic: str) -> Values:
    """The map of a topic, as soon as there is one."""
    maps: asyncio.Queue[Values] = asyncio.Queue()
    subscription = bridge.session.subscribe(topic, "nav_msgs/msg/OccupancyGrid", maps.put_nowait, latched=True)
    running = asyncio.create_task(bridge.run())
    try:
        return await maps.get()
    finally:
        bridge.session.unsubscribe(subscription)
        running.cancel()
        await asyncio.wait({running})


def main(arguments: list[str] | None = None) -> None:
    """Save a map, as the arguments of the command line say."""
    parser = argparse.ArgumentParser(prog="python -m somrs.adapters.ros2.save_map", description="Save the map of a robot with ROS 2.")
    parser.add_argument("--topic", default="/map")
    parser.add_argument("--out", type=Path, required=True, help="the name of both files, without .yaml and .pgm")
    parser.add_argument("--python", default="python3", help="the Python of the installed ROS")
    parser.add_argument("--setup", help="the file to source before, such as /opt/ros/jazzy/setup.bash")
    parser.add_argument("--domain", type=int)
    parser.add_argument("--discovery", help="OFF, LOCALHOST, SUBNET or SYSTEM_DEFAULT")
    options = vars(parser.parse_args(arguments))
    topic, out = options.pop("topic"), options.pop("out")
    settings = read_settings({**options, "robots": {"any": {"binding": "none"}}})
    print(f"waiting for a map on {topic} ...", flush=True)
    text, image = map_files(asyncio.run(receive_map(BridgeProcess(settings, Path.cwd()), topic)), f"{out.name}.pgm")
    out.with_name(f"{out.name}.pgm").write_bytes(image)
    out.with_name(f"{out.name}.yaml").write_text(text, "utf-8")
    print(f"saved {out}.yaml and {out}.pgm; next: somrs import {out}.yaml -o site.yaml")


if __name__ == "__main__":
    try:
        main()
    except SomrsError as problem:
        sys.exit(str(problem))
