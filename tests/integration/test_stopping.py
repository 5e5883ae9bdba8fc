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
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import UpdateMap
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
    run.simulation.linked.set_paused("Robot1", True)
    run.run_for(1.0)
    place = robot.pose()
    run.run_for(20.0)
    assert math.dist(robot.pose()[:2], place[:2]) < 0.005
    assert not end
    run.simulation.linked.set_paused("Robot1", False)
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandDone)
    assert math.dist(robot.pose()[:2], (6, 3)) < 0.1


def test_another_robot_works_while_one_is_stopped(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0), (6.5, 1, math.pi)), world)
    run.simulation.linked.set_paused("Robot1", True)
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


def test_a_storey_is_stopped_with_the_robots_on_it(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        storey = next(name for name, object in api.context.map.objects.items() if object.type == "Storey")
        assert {"Robot1", "Robot2"} <= {*(await api.control.stop(storey=storey)).stopped}
        assert (await api.control.release(storey=storey)).stopped == ()
        await api.map.change(UpdateMap(changes=(ValueSet(storey, "Elevation", 4.0), ValueSet("Robot2", "PositionZ", 4.0))))
        while api.context.map.objects[storey].values.get("Elevation") != 4.0:
            await asyncio.sleep(0.02)
        assert {"Robot1", "Robot2"} & {*(await api.control.stop(storey=storey)).stopped} == {"Robot2"}

    play(tmp_path, scenario, Porter("Robot1"), Porter("Robot2", 20.0))


BOTH = "Jar002 isOn Platform001 AND Jar001 isOn Platform001"


async def steps_done(api: LiveApi, task: str, count: int) -> None:
    while sum(step.state is State.COMPLETED for step in (await api.tasks.read(task)).view.steps) < count:
        await asyncio.sleep(0.02)


def paused_for(api: LiveApi, device: str) -> object:
    return api.context.map.objects[device].values.get("PausedFor")


def test_a_paused_task_begins_nothing_and_goes_on_where_it_was(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=BOTH))).task
        await wait_for(api, task, Phase.EXECUTING)
        assert (await api.tasks.pause(task, by="Ada")).paused
        await steps_done(api, task, 1)
        while paused_for(api, "Robot1") != task:
            await asyncio.sleep(0.02)
        assert await state_of(api, "Robot1") is DeviceState.STOPPED
        await asyncio.sleep(1.0)
        view = (await api.tasks.read(task)).view
        assert [step.state for step in view.steps].count(State.COMPLETED) == 1
        assert view.pause is not None
        assert view.pause.by == "Ada"
        assert view.reasons[0].startswith("paused by Ada")
        assert (await api.map.history("Robot1")).events[0].author == "Ada"
        assert not (await api.tasks.resume(task, by="Ben")).paused
        await wait_for(api, task, Phase.ENDED)
        details = await api.tasks.read(task)
        assert details.view.outcome == "accomplished"
        texts = [event.text for event in details.events]
        assert texts.index("paused by Ada") < texts.index("going on, says Ben")
        while paused_for(api, "Robot1") is not None:
            await asyncio.sleep(0.02)

    play(tmp_path, scenario, Porter("Robot1", seconds=0.6))


def test_other_tasks_go_on_while_one_is_paused(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        paused = (await api.tasks.submit(Submit(effect="Jar002 isOn Platform001"))).task
        await api.tasks.pause(paused)
        going_on = (await api.tasks.submit(Submit(effect="Jar001 isOn Platform001"))).task
        await wait_for(api, going_on, Phase.ENDED)
        assert (await api.tasks.read(going_on)).view.outcome == "accomplished"
        assert (await api.tasks.read(paused)).view.phase is not Phase.ENDED

    play(tmp_path, scenario, Porter("Robot1"), Porter("Robot2", 20.0))


def test_an_operators_stop_outlasts_the_pause_of_a_task(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=BOTH))).task
        await wait_for(api, task, Phase.EXECUTING)
        await api.tasks.pause(task)
        await api.control.stop(device="Robot1", by="Ada")
        await api.tasks.resume(task)
        while paused_for(api, "Robot1") is not None or api.context.map.objects["Robot1"].values.get("Paused") is not True:
            await asyncio.sleep(0.02)
        assert await state_of(api, "Robot1") is DeviceState.STOPPED

    play(tmp_path, scenario, Porter("Robot1", seconds=0.6))


def test_a_paused_task_that_is_cancelled_ends_and_frees_its_devices(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=BOTH))).task
        await wait_for(api, task, Phase.EXECUTING)
        await api.tasks.pause(task)
        await api.tasks.cancel(task)
        await wait_for(api, task, Phase.ENDED)
        while paused_for(api, "Robot1") is not None:
            await asyncio.sleep(0.02)
        assert not (await api.tasks.pause(task)).paused, "it has ended"

    play(tmp_path, scenario, Porter("Robot1", seconds=0.6))


def test_a_pause_survives_a_restart_of_the_task_manager(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=BOTH))).task
        await wait_for(api, task, Phase.EXECUTING)
        await api.tasks.pause(task, by="Ada")
        await steps_done(api, task, 1)
        await system.stop_manager()
        await system.start_manager()
        await asyncio.sleep(1.0)
        view = (await api.tasks.read(task)).view
        assert (view.pause is not None, view.phase is Phase.ENDED) == (True, False)
        await api.tasks.resume(task)
        await wait_for(api, task, Phase.ENDED)
        assert (await api.tasks.read(task)).view.outcome == "accomplished"

    play(tmp_path, scenario, Porter("Robot1", seconds=0.6))
