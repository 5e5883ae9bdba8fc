"""A robot explores two rooms with a shut door between them that has a drive: it has the door opened and closed by tasks of its own."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from tests.integration.adapters.test_explore_floor import EXAMPLE, count, world

SITE = """
uses: [ROBOT]
map: NAME
objects:
  House:
    type: Building
    parts:
      Ground:
        type: Storey
        Elevation: 0
        parts:
          Start: {type: Floor, at: [X, 3, -0.1], Shape: {Form: Box, Width: WIDTH, Depth: DEPTH, Height: 0.1}}
          Gate: {type: PoweredDoor, at: [4, 2.9, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.4, Height: 2.1}, Open: false, Price: 1 EUR}
  Scout: {type: MappingRobot, at: [1.5, 3, 0], Speed: 0.8 m/s, Price: 5 EUR}
""".replace("ROBOT", str(EXAMPLE / "robot.yaml"))
WALLS = [("S", 4, -0.05, 8.2, 0.1), ("N", 4, 6.05, 8.2, 0.1), ("W", -0.05, 3, 0.1, 6), ("E", 8.05, 3, 0.1, 6)]
WALLS += [("A", 4, 1.1, 0.1, 2.2), ("B", 4, 4.8, 0.1, 2.4)]


def filled(**values: object) -> str:
    """The site's file with these values."""
    text = SITE
    for name, value in values.items():
        text = text.replace(name, str(value))
    return text


def sites(folder: Path) -> tuple[Path, Path]:
    """The files of the world as it is, and of what is known of it at first: the robot, the door, and the floor under the robot."""
    walls = [
        f"  Wall{name}: {{type: Wall, at: [{x}, {y}, 0], Shape: {{Form: Box, Width: {width}, Depth: {depth}, Height: 2.5}}}}\n"
        for name, x, y, width, depth in WALLS
    ]
    files = folder / "world.yaml", folder / "site.yaml"
    files[0].write_text(filled(NAME="World", X=4, WIDTH=8.2, DEPTH=6.2) + "".join(walls))
    files[1].write_text(filled(NAME="Unknown", X=1.5, WIDTH=1, DEPTH=1))
    return files


async def explored(folder: Path, *, is_broken: bool) -> None:
    world_file, site = sites(folder)
    async with (
        world(world_file) as address,
        System([site], folder / "data", world_address=address, certificates=False, secure=False) as system,
        Client(system.addresses) as client,
    ):
        if is_broken:
            await client.update(UpdateMap(situation="Gate.InService = FALSE", author="Engineer"))
        task = await client.submit(Submit(effect="Ground wasExploredBy Scout"))
        view: TaskView | None = None
        notes = ""
        async for news in client.news(task):
            view = news.view
            notes += str(news.events)
        map = await client.map()
        assert view is not None
        assert view.outcome is Outcome.ACCOMPLISHED
    assert map.objects["Gate"].values["Open"] is False
    assert count(map, "Room") == (1 if is_broken else 2)
    assert count(map, "PoweredDoor") == 1
    assert count(map, "Door") == 0
    assert ("cannot have opened: Gate" in notes) is is_broken


@pytest.mark.parametrize("is_broken", [False, True])
def test_a_robot_has_a_door_opened_to_explore_what_is_behind(tmp_path: Path, is_broken: bool) -> None:
    asyncio.run(explored(tmp_path, is_broken=is_broken))
