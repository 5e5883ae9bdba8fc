"""An operator stops devices and lets them go on, and takes them out of service and back."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import pytest

from somrs.api.device_state import DeviceState
from somrs.api.remote import LiveApi
from somrs.client.refusals import NotFound
from somrs.devices.simulator.link.commands import CommandDone, DriveTo
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import Phase
from tests.support.hang import HANG_TIME
from tests.support.simulator_room import Run, room
from tests.support.small_system import Porter, SmallSystem, running

GOAL = "Jar002 isOn Platform001"


def test_a_stopped_robot_stands_within_a_second_and_goes_on_to_its_goal(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0), (6.5, 1, math.pi)), world)
    end = run.start("Robot1", DriveTo(x=6, y=3))
    robot = run.simulation.robots["Robot1"]
    run.run_until(lambda: robot.speed > 0.3)
    run.simulation.set_paused("Robot1", True)
    run.run_for(1.0)
    place = robot.pose()
    run.run_for(20.0)
    assert math.dist(robot.pose()[:2], place[:2]) < 0.005
    assert not end
    run.simulation.set_paused("Robot1", False)
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandDone)
    assert math.dist(robot.pose()[:2], (6, 3)) < 0.1


def test_another_robot_works_while_one_is_stopped(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0), (6.5, 1, math.pi)), world)
    run.simulation.set_paused("Robot1", True)
    assert isinstance(run.execute("Robot2", DriveTo(x=2, y=1)), CommandDone)


def play(data: Path, scenario: object, *porters: Porter) -> None:
    async def run() -> None:
        async with asyncio.timeout(HANG_TIME), running(data, *porters) as (system, api):
            await scenario(system, api)  # type: ignore[operator]

    asyncio.run(run())


async def state_of(api: LiveApi, device: str) -> DeviceState:
    return next(view.state for view in (await api.fleet.devices()).devices if view.name == device)


async def wait_for(api: LiveApi, task: str, *phases: Phase) -> None:
    while (await api.tasks.read(task)).view.phase not in phases:
        await asyncio.sleep(0.02)


def test_a_device_out_of_service_gets_no_work_until_it_is_back(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        await api.control.service("Robot1", active=False, by="Ada")
        assert await state_of(api, "Robot1") is DeviceState.OUT_OF_SERVICE
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        await wait_for(api, task, Phase.WAITING)
        await api.control.service("Robot1", active=True, by="Ada")
        await wait_for(api, task, Phase.ENDED)
        assert (await api.tasks.read(task)).view.outcome == "accomplished"

    play(tmp_path, scenario, Porter("Robot1"))


def test_the_dearer_device_works_while_the_other_is_out_of_service(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        await api.control.service("Robot1", active=False)
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        await wait_for(api, task, Phase.ENDED)
        assert {work.service for work in (await api.tasks.read(task)).view.work} == {"Robot2.TransferObject"}

    play(tmp_path, scenario, Porter("Robot1"), Porter("Robot2", 20.0))


def test_all_devices_are_stopped_and_released_at_once(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        stopping = await api.control.stop(by="Ada")
        assert stopping.all
        assert {"Robot1", "Robot2"} <= {*stopping.stopped}
        assert await state_of(api, "Robot1") is DeviceState.STOPPED
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        await wait_for(api, task, Phase.WAITING)
        assert (await api.control.release(by="Ada")).stopped == ()
        await wait_for(api, task, Phase.ENDED)
        with pytest.raises(NotFound, match="no device Robot9"):
            await api.control.stop(device="Robot9")
        with pytest.raises(UsageError, match="not both"):
            await api.control.stop(device="Robot1", storey="Storey1")

    play(tmp_path, scenario, Porter("Robot1"), Porter("Robot2", 20.0))
