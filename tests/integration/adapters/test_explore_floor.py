"""A system that knows nothing of a building but where its robot stands has it explored: the map in the Repository grows, and is valid."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.ontology.files.loading import load
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.space.findings import find_mistakes
from tests.support.map_comparison import compare
from tests.support.paths import ROOT

EXAMPLE = ROOT / "examples" / "unknown_floor"


@asynccontextmanager
async def world() -> AsyncIterator[str]:
    """A simulator with the world as it is. Yields its address."""
    options = ["--site", str(EXAMPLE / "world.yaml"), "--speed", "30", "--world", "kinematic"]
    command = [sys.executable, "-m", "somrs.cli.main", "run", "simulator", *options]
    process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    try:
        assert process.stdout is not None
        line = await process.stdout.readline()
        yield line.decode().rpartition('"at":"')[2].rstrip('"}\n')
    finally:
        process.terminate()
        await process.wait()


async def explored(data: Path) -> None:
    async with (
        world() as address,
        System([EXAMPLE / "site.yaml"], data, world_address=address, certificates=False, secure=False) as system,
        Client(system.addresses) as client,
    ):
        task = await client.submit(Submit(effect="Ground wasExploredBy ?Robot"))
        wall_counts = []
        outcome = None
        async for news in client.news(task):
            map = await client.map()
            wall_counts.append(sum(object.type == "Wall" for object in map.objects.values()))
            outcome = news.view.outcome
        map, ontology = await client.map(), await client.ontology()
    assert outcome is Outcome.ACCOMPLISHED
    assert wall_counts[0] == 0
    assert len(set(wall_counts)) > 2  # it grew while the robot went
    assert find_mistakes(map, ontology) == []
    loaded = load([EXAMPLE / "world.yaml"])
    assert loaded.map is not None
    comparison = compare(map, loaded.map, loaded.ontology)
    print(comparison)
    assert comparison.walls >= 0.95
    assert comparison.rooms == (2, 2)
    assert comparison.furniture == (8, 8)
    assert comparison.things == (3, 3)


def test_a_robot_explores_a_floor_for_a_task(tmp_path: Path) -> None:
    asyncio.run(explored(tmp_path / "data"))
