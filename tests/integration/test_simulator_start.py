"""The simulator's start: it waits for the map as long as a Repository needs at most, and makes its world as long as that takes."""

from __future__ import annotations

import asyncio
import time

import pytest

from somrs.deployment import programs
from somrs.deployment.programs import simulated
from somrs.devices.simulator.server.follower import Followed
from somrs.devices.simulator.server.simulated_world import SimulatedWorld
from somrs.devices.simulator.server.simulation import Simulation
from somrs.errors import RemoteError
from tests.support.lab import contents

REPOSITORY = "http://nowhere"


def test_a_world_that_takes_long_to_make_is_not_taken_for_a_map_that_does_not_come(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario() -> None:
        monkeypatch.setattr(programs, "MAP_TIME", 0.05)
        world, site = SimulatedWorld(), contents()
        waiting = asyncio.create_task(simulated(Followed(world, [REPOSITORY])))
        await asyncio.sleep(0)
        time.sleep(0.1)  # the event loop stands while the world of a large building is made
        world.simulation = Simulation(site.map, site.ontology)
        world.read.set()
        assert await waiting is world.simulation

    asyncio.run(scenario())


def test_a_repository_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario() -> None:
        monkeypatch.setattr(programs, "MAP_TIME", 0.05)
        with pytest.raises(RemoteError, match=r"no map came from http://nowhere within .* is the Repository running"):
            await simulated(Followed(SimulatedWorld(), [REPOSITORY]))

    asyncio.run(scenario())
