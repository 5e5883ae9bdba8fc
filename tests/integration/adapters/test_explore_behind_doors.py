"""A robot explores two rooms with a shut door between them that has a drive: it has the door opened and closed by tasks of its own."""

from __future__ import annotations

import asyncio
from pathlib import Path

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.ontology.map import Map
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.submission import Submit
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


async def explore(client: Client) -> tuple[Map, str]:
    """Have the floor explored. Returns the map, and what was noted."""
    task = await client.submit(Submit(effect="Ground wasExploredBy Scout"))
    outcome, notes = None, ""
    async for news in client.news(task):
        outcome = news.view.outcome
        notes += str(news.events)
    assert outcome is Outcome.ACCOMPLISHED
    return await client.map(), notes


async def explored(folder: Path) -> None:
    world_file, site = sites(folder)
    async with (
        world(world_file) as address,
        System([site], folder / "data", world_address=address, certificates=False, secure=False) as system,
        Client(system.addresses) as client,
    ):
        await client.update(UpdateMap(situation="Gate.InService = FALSE", author="Engineer"))
        map, notes = await explore(client)
        assert count(map, "Room") == 1
        assert "cannot have opened: Gate" in notes
        await client.update(UpdateMap(situation="Gate.InService = TRUE AND NOT Ground wasExploredBy Scout", author="Engineer"))
        map, notes = await explore(client)
    assert "cannot have opened" not in notes
    assert map.objects["Gate"].values["Open"] is False
    assert [count(map, kind) for kind in ("Room", "PoweredDoor", "Door")] == [2, 1, 0]


def test_a_robot_has_a_door_opened_to_explore_what_is_behind_when_it_can_be_opened(tmp_path: Path) -> None:
    asyncio.run(explored(tmp_path))
