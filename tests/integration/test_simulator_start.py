"""The simulator's start: it waits for the map, and makes its world, however long that takes."""

from __future__ import annotations

import asyncio
import os
import time

import pytest

from somrs.deployment import programs
from somrs.deployment.programs import simulated
from somrs.devices.simulator.server.follower import Followed
from somrs.devices.simulator.server.simulated_world import SimulatedWorld
from somrs.devices.simulator.server.simulation import Simulation
from somrs.errors import RemoteError
from tests.support.hang import HANG_TIME
from tests.support.lab import contents

REPOSITORY = "http://nowhere"


def test_a_world_that_takes_long_to_make_is_not_taken_for_a_map_that_does_not_come(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario() -> None:
        monkeypatch.setattr(programs, "REMINDER", 0.05)
        world, site = SimulatedWorld(), contents()
        waiting = asyncio.create_task(simulated(Followed(world, [REPOSITORY])))
        await asyncio.sleep(0)
        time.sleep(0.1)  # the event loop stands while the world of a large building is made
        world.simulation = Simulation(site.map, site.ontology)
        world.read.set()
        assert await waiting is world.simulation

    asyncio.run(scenario())


def test_a_repository_that_is_not_there_yet_is_named_and_waited_for(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario() -> None:
        monkeypatch.setattr(programs, "REMINDER", 0.1)
        monkeypatch.setattr(programs, "PARENT_CHECK", 0.05)
        world, site = SimulatedWorld(), contents()
        waiting = asyncio.create_task(simulated(Followed(world, [REPOSITORY])))
        async with asyncio.timeout(HANG_TIME):
            while caplog.text.count("no map came from http://nowhere yet; is the Repository running?") < 2:
                await asyncio.sleep(0.01)
        assert not waiting.done()
        world.simulation = Simulation(site.map, site.ontology)
        world.read.set()
        assert await waiting is world.simulation

    asyncio.run(scenario())


def test_a_program_that_waits_ends_with_the_process_that_started_it(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario() -> None:
        monkeypatch.setattr(programs, "PARENT_CHECK", 0.05)
        waiting = asyncio.create_task(simulated(Followed(SimulatedWorld(), [REPOSITORY])))
        await asyncio.sleep(0.01)
        monkeypatch.setattr(os, "getppid", lambda: 1)
        with pytest.raises(RemoteError, match="the process that started it has ended"):
            await waiting

    asyncio.run(scenario())
