"""A fire in a whole system: robots are under way, stand still, and arrive when it is over."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.objects import ValueSet
from somrs.ontology.types import MODE
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import Phase
from tests.support.building import building
from tests.system.test_system import running

pytestmark = pytest.mark.long

DRIVERS = ("Robot1", "Robot2", "Robot3")
LENGTH = 60
"""The length of the hall, m."""


def hall() -> str:
    """A hall with places at both ends, and a robot at each place in the west."""
    lines = [building("Hall", LENGTH, 8)]
    for number in range(1, 5):
        lines.append(f"  West{number}: {{type: Place, at: [2, {1.6 * number}]}}")
        lines.append(f"  East{number}: {{type: Place, at: [{LENGTH - 2}, {1.6 * number}]}}")
        lines.append(f"  Robot{number}: {{type: PioneerP3DX, at: [2, {1.6 * number}, 0], Price: 10 EUR, Charge: 100}}")
    return "\n".join([*lines, ""])


async def set_mode(client: Client, mode: str) -> None:
    await client.report(UpdateMap(changes=(ValueSet("Building1", MODE, mode),), author="the operator"))


async def places(operator: OperatorLink) -> dict[str, tuple[float, float]]:
    return {name: (state.x, state.y) for name, state in (await operator.robots()).items()}


async def standing(operator: OperatorLink, seconds: float) -> dict[str, tuple[float, float]]:
    """Wait until no robot has moved for so many seconds of simulated time, and return where they are."""
    begun_at, there = (await operator.clock()).time, await places(operator)
    while (await operator.clock()).time < begun_at + seconds:
        await asyncio.sleep(0.05)
        now_there = await places(operator)
        if any(math.dist(now_there[name], there[name]) > 0.01 for name in there):
            begun_at, there = (await operator.clock()).time, now_there
    return there


async def under_way(client: Client, operator: OperatorLink) -> list[str]:
    """Send the robots to the other end, and state a fire when all are on their way. Returns the tasks.

    If one has arrived meanwhile, because this program had to wait for the processor, they are sent back, and so on.
    """
    end, way_back = "East", "West"
    while True:
        tasks = [await client.submit(Submit(effect=f"{robot} isAt {end}{robot[-1]}")) for robot in DRIVERS]
        before = await places(operator)
        while True:
            there = await places(operator)
            if all(math.dist(there[robot], before[robot]) > 1.0 for robot in DRIVERS):
                break
            await asyncio.sleep(0.02)
        await set_mode(client, "Fire")
        await standing(operator, 10.0)
        running_tasks = {view.task for view in await client.tasks(running=True)}
        if running_tasks.issuperset(tasks):
            return tasks
        await set_mode(client, "Normal")
        for task in tasks:
            await ended(client, task)
        end, way_back = way_back, end


async def ended(client: Client, task: str) -> Outcome | None:
    return [news.view async for news in client.news(task)][-1].outcome


def test_in_a_fire_robots_stand_still_and_tasks_wait_and_all_arrive_afterwards(tmp_path: Path) -> None:
    site = tmp_path / "hall.yaml"
    site.write_text(hall(), "utf-8")

    async def test() -> None:
        async with running(tmp_path / "data", site, world=WorldKind.KINEMATIC, speed="4") as (_, client, operator):
            tasks = await under_way(client, operator)
            there = await places(operator)
            waiting = await client.submit(Submit(effect="Robot4 isAt East4"))
            while (view := (await client.read_task(waiting)).view).phase is not Phase.WAITING:
                await asyncio.sleep(0.05)
            assert "fire alarm in Building1" in view.explanation
            later = await standing(operator, 60.0)
            assert max(math.dist(later[robot], there[robot]) for robot in there) < 0.01, "nobody has moved"
            await set_mode(client, "Normal")
            assert [await ended(client, task) for task in (*tasks, waiting)] == [Outcome.ACCOMPLISHED] * 4
            assert (await places(operator))["Robot4"][0] > LENGTH - 4

    asyncio.run(test())
