"""Two owners with a system each, whose buildings are in one simulated world: what one brings over, the other takes on."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault, ObjectState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import OperatorLink, RobotLink
from somrs.errors import UsageError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.task_views import TaskView
from somrs.trust.credentials import FOLDER, Credentials
from tests.support.accomplishing import accomplish
from tests.support.hang import HANG_TIME
from tests.support.two_sites import barn_and_yard

pytestmark = pytest.mark.long


async def accomplish_in(system: System, effect: str) -> TaskView:
    async with Client(system.addresses) as client:
        return await accomplish(client, effect)


def client_of(system: System) -> Credentials:
    return Credentials(system.data / FOLDER / "programs" / "client.pem")


async def observe(operator: OperatorLink, name: str) -> ObjectState:
    """What stands in the world under this name, as soon as the simulator knows of it."""
    while True:
        try:
            return await operator.observe(name)
        except UsageError:
            await asyncio.sleep(0.05)


async def what_is_not_for_the_yard(yard: System, simulator: str) -> None:
    """The simulator is of the barn: programs of the yard look at its world, and control their own robots."""
    async with OperatorLink.at(f"{simulator}/Yard", client_of(yard)) as operator:
        assert set(await operator.robots()) == {"Barn:BarnRobot", "YardRobot"}
        with pytest.raises(UsageError, match="client may not do this: this is for the site of the simulator"):
            await operator.fault("YardRobot", Fault.LINK)
    robot = Credentials(yard.data / FOLDER / "programs" / "YardRobot.pem")
    host, port = simulator.removeprefix("tls://").split(":")
    for name in ("Barn:BarnRobot", "Yard:Truck"):
        with pytest.raises(RobotGaveUp, match=r"Yard:YardRobot may not"):
            async with RobotLink(host, int(port), name, credentials=robot):
                pass


def test_a_robot_takes_on_what_the_neighbour_s_robot_has_brought(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with (
            asyncio.timeout(HANG_TIME),
            barn_and_yard(tmp_path) as (barn, yard, simulator),
            OperatorLink.at(simulator, client_of(barn)) as operator,
            OperatorLink.at(f"{simulator}/Barn", client_of(barn)) as barn_operator,
        ):
            assert set(await operator.robots()) == {"Barn:BarnRobot", "Yard:YardRobot"}
            assert set(await barn_operator.robots()) == {"BarnRobot", "Yard:YardRobot"}
            view = await accomplish_in(barn, "Jar1 isOn Yard:Ramp")
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert [work.service for work in view.work] == ["BarnRobot.TransferObject"]
            assert (await observe(barn_operator, "Yard:Jar1")).support == "Yard:Ramp"
            view = await accomplish_in(yard, "Jar1 isOn YardTable")
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert [work.service for work in view.work] == ["YardRobot.TransferObject"]
            assert (await operator.observe("Yard:Jar1")).support == "Yard:YardTable"
            await what_is_not_for_the_yard(yard, simulator)

    asyncio.run(scenario())
