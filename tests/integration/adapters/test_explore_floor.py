"""A system that knows nothing of a building but where its robot stands has it explored: the map in the Repository grows, and is valid."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactAdded, Object, ObjectAdded, ObjectRemoved
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import ReadEvents, RenameObject, UpdateMap
from somrs.protocol.messages.submission import Submit
from somrs.space.findings import find_mistakes
from tests.support.map_comparison import compare
from tests.support.paths import ROOT

KINDS = ("Chair", "Door", "Wall")
EXAMPLE = ROOT / "examples" / "unknown_floor"


@asynccontextmanager
async def world(site: Path = EXAMPLE / "world.yaml") -> AsyncIterator[str]:
    """A simulator with the world as it is. Yields its address."""
    options = ["--site", str(site), "--speed", "30", "--world", "kinematic"]
    command = [sys.executable, "-m", "somrs.cli.main", "run", "simulator", *options]
    process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    try:
        assert process.stdout is not None
        line = await process.stdout.readline()
        yield line.decode().rpartition('"at":"')[2].rstrip('"}\n')
    finally:
        process.terminate()
        await process.wait()


async def explore(client: Client) -> Map:
    """Have the floor explored, and return the map."""
    task = await client.submit(Submit(effect="Ground wasExploredBy ?Robot"))
    views = [news.view async for news in client.news(task)]
    assert views[-1].outcome is Outcome.ACCOMPLISHED
    return await client.map()


async def growth_count(client: Client) -> int:
    """How often the number of objects on the map has changed."""
    newest = (await client.read_events(ReadEvents(limit=1))).events[0].version
    counts = [len((await client.map(version)).objects) for version in range(newest + 1)]
    return sum(number != earlier_number for earlier_number, number in pairwise(counts))


def count(map: Map, kind: str) -> int:
    return sum(object.type == kind for object in map.objects.values())


async def explored(data: Path) -> None:
    async with (
        world() as address,
        System([EXAMPLE / "site.yaml"], data, world_address=address, certificates=False, secure=False) as system,
        Client(system.addresses) as client,
    ):
        map, ontology = await explore(client), await client.ontology()
        assert await growth_count(client) > 2, "it grew while the robot went"
        # What a person gets wrong: a chair is elsewhere, a door is shut, a wall is missing, and a room has a name.
        (chair, *_), (door,), (wall, *_) = ([name for name, object in map.objects.items() if object.type == kind] for kind in KINDS)
        mistakes = f"NOT Ground wasExploredBy Scout AND {door}.Open = FALSE AND {chair}.PositionX = 9.0 AND {chair}.PositionY = 4.5"
        table = next(name for name, object in map.objects.items() if object.type == "Table")
        place = map.objects[table].values
        at_table = {path: place[path] for path in ("PositionX", "PositionY")}
        height = sum(float(place[path]) for path in ("PositionZ", "Shape.Height") if isinstance(place[path], int | float))
        taken = Object(name="Taken", type="Jar", values={**at_table, "PositionZ": height})
        changes = (ObjectRemoved(wall), ObjectAdded(taken), FactAdded(Fact("isOn", ("Taken", table))))
        await client.update(UpdateMap(situation=mistakes, changes=changes, author="Engineer"))
        room = next(name for name, object in map.objects.items() if object.type == "Room")
        await client.rename(RenameObject(name=room, to="Laboratory", author="Engineer"))
        corrected = await explore(client)
    assert find_mistakes(map, ontology) == []
    loaded = load([EXAMPLE / "world.yaml"])
    assert loaded.map is not None
    comparison = compare(map, loaded.map, loaded.ontology)
    print(comparison)
    assert comparison.walls >= 0.95
    assert comparison.rooms == (2, 2)
    assert comparison.furniture == (8, 8)
    assert comparison.things == (3, 3)
    assert corrected.objects[door].values["Open"] is True
    assert corrected.objects[chair].values["Unknown"] is True
    assert corrected.objects["Taken"].values["Unknown"] is True
    later = compare(corrected, loaded.map, loaded.ontology)  # the wall and a chair have come again
    assert later.walls >= 0.95
    assert later.invented == pytest.approx(comparison.invented, abs=0.01), "it has seen the floor from other points"
    assert (later.rooms, later.furniture, later.things) == (comparison.rooms, comparison.furniture, comparison.things)
    counts = [count(corrected, kind) - count(map, kind) for kind in ("Wall", "Room", "Door", "Chair", "Table", "Jar")]
    assert counts == [0, 0, 0, 1, 0, 1]
    assert "Laboratory" in corrected.objects


@pytest.mark.long
def test_a_robot_explores_a_floor_for_a_task_and_corrects_the_map_when_it_does_so_again(tmp_path: Path) -> None:
    asyncio.run(explored(tmp_path / "data"))
