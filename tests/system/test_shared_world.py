"""Two owners with a system each, whose buildings are in one simulated world: what one brings over, the other takes on."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import ObjectState
from somrs.devices.simulator.link.link import OperatorLink
from somrs.errors import UsageError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from tests.support.hang import HANG_TIME
from tests.support.shared_yard import barn_and_yard

pytestmark = pytest.mark.long


async def accomplish(system: System, effect: str) -> TaskView:
    view: TaskView | None = None
    async with Client(system.addresses) as client:
        task = await client.submit(Submit(effect=effect))
        async for news in client.news(task):
            view = news.view
    assert view is not None
    return view


async def observe(operator: OperatorLink, name: str) -> ObjectState:
    """What stands in the world under this name, as soon as the simulator knows of it."""
    while True:
        try:
            return await operator.observe(name)
        except UsageError:
            await asyncio.sleep(0.05)


def test_a_robot_takes_on_what_the_neighbour_s_robot_has_brought(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with (
            asyncio.timeout(HANG_TIME),
            barn_and_yard(tmp_path) as (barn, yard, simulator),
            OperatorLink.at(simulator) as operator,
            OperatorLink.at(f"{simulator}/Barn") as barn_operator,
        ):
            assert set(await operator.robots()) == {"Barn:BarnRobot", "Yard:YardRobot"}
            assert set(await barn_operator.robots()) == {"BarnRobot", "Yard:YardRobot"}
            view = await accomplish(barn, "Jar1 isOn Yard:Ramp")
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert [work.service for work in view.work] == ["BarnRobot.TransferObject"]
            assert (await observe(barn_operator, "Yard:Jar1")).support == "Yard:Ramp"
            view = await accomplish(yard, "Jar1 isOn YardTable")
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert [work.service for work in view.work] == ["YardRobot.TransferObject"]
            assert (await operator.observe("Yard:Jar1")).support == "Yard:YardTable"

    asyncio.run(scenario())
