"""Many tasks at once on symbolic robots, while other processes load the machine: all are accomplished."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from tests.support import warm
from tests.support.hang import HANG_TIME

ROBOTS, TASKS, BURNERS = 6, 30, 2

ONTOLOGY = """
ontology: Depot
types:
  Carrier: {parent: Device, driver: "somrs.devices.symbolic.device:SymbolicDevice"}
  Yard: {parent: AbstractObject}
  Box: {parent: PhysicalObject}
services:
  Carry:
    inputs: {Item: Box, To: Place}
    precondition: "?Item isOn ?From AND ?Provider: Carrier isAt ?Somewhere"
    effect: "?Item isOn ?To"
"""


def depot() -> str:
    """A map with a box, and two places for it, for each task."""
    places = [
        f"      {side}{number}: {{type: Place, at: [{number}, {y}]}}" for side, y in (("From", 0), ("To", 9)) for number in range(TASKS)
    ]
    carriers = [f"  Carrier{number}: {{type: Carrier, at: [{number}, 5]}}" for number in range(ROBOTS)]
    boxes = [f"  Box{number}: {{type: Box}}" for number in range(TASKS)]
    facts = [f"  - Carrier{number} isAt From0" for number in range(ROBOTS)] + [
        f"  - Box{number} isOn From{number}" for number in range(TASKS)
    ]
    return "\n".join(["map: Depot", "objects:", "  Depot:", "    type: Yard", "    parts:", *places, *carriers, *boxes, "facts:", *facts])


@contextmanager
def busy_machine() -> Iterator[None]:
    """Other processes that use all the time that they get."""
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(BURNERS)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


@pytest.mark.slow
def test_thirty_tasks_at_once_are_all_accomplished_on_a_busy_machine(tmp_path: Path) -> None:
    files = tmp_path / "ontology.yaml", tmp_path / "map.yaml"
    files[0].write_text(ONTOLOGY)
    files[1].write_text(depot())

    async def finished(client: Client, number: int) -> TaskView:
        task = await client.submit(Submit(effect=f"Box{number} isOn To{number}"), patience=HANG_TIME)
        view = None
        async for news in client.news(task):
            view = news.view
        assert view is not None
        return view

    async def run() -> list[TaskView]:
        async with (
            System(files, tmp_path / "run", speed="20", world=WorldKind.KINEMATIC, launcher=warm.launcher()) as system,
            Client(system.addresses) as client,
        ):
            with busy_machine():
                async with asyncio.timeout(HANG_TIME):
                    return await asyncio.gather(*(finished(client, number) for number in range(TASKS)))

    views = asyncio.run(run())
    assert [view.explanation for view in views if view.outcome is not Outcome.ACCOMPLISHED] == []
