"""An operator states a fire, an emergency, or that a door is out of order; and what follows from it."""

from __future__ import annotations

import asyncio
import json
import math
import urllib.request
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
from msgspec.structs import replace

from somrs.api.control import ObjectMode
from somrs.api.remote import LiveApi
from somrs.client.refusals import NotFound
from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, DriveTo
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.modes import Mode
from somrs.protocol.messages.events import ServiceOverdue
from somrs.protocol.messages.frp import Outcome
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Order, Refusal, WorkDone
from tests.support.building import building
from tests.support.command import somrs
from tests.support.hang import HANG_TIME
from tests.support.robot_lab import run as run_in_room
from tests.support.simulated_device_harness import simulated
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import Run, box, robot, room, shell
from tests.support.small_system import Porter, SmallSystem, api_at, running
from tests.support.virtual_system import Robot, VirtualSystem, transfer_effect

BUILDING = "Building001"
GOAL = "Jar002 isOn Platform001"

Scenario = Callable[[SmallSystem, LiveApi], Awaitable[None]]


def play(data: Path, scenario: Scenario, *porters: Porter) -> None:
    async def run() -> None:
        async with asyncio.timeout(HANG_TIME), running(data, *porters) as (system, api):
            await scenario(system, api)

    asyncio.run(run())


def test_a_fire_is_stated_and_ended_and_the_history_has_its_author(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        assert (await api.control.modes()).modes == (ObjectMode(object=BUILDING, mode=Mode.NORMAL),)
        fire = ObjectMode(object=BUILDING, mode=Mode.FIRE, reason="fire alarm in Building001")
        assert (await api.control.set_mode(Mode.FIRE, by="Ada")).modes == (fire,)
        while (await api.control.modes()).modes != (fire,):
            await asyncio.sleep(0.01)
        assert (await api.map.history(BUILDING)).events[0].author == "Ada"
        assert (await api.control.set_mode(Mode.NORMAL, building=BUILDING, by="Ada")).modes[0].mode is Mode.NORMAL

    play(tmp_path, scenario)


def test_in_a_fire_robots_drive_no_further_than_they_were_granted_and_all_arrive_afterwards(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0), (6.5, 3, math.pi)), world)
    ends = {"Robot1": run.start("Robot1", DriveTo(x=6.5, y=3)), "Robot2": run.start("Robot2", DriveTo(x=1.5, y=3))}
    robots = run.simulation.robots
    run.run_until(lambda: robots["Robot1"].speed > 0.3)
    run.simulation.hold("fire alarm in Building1")
    granted = {name: [robot.pose()[:2], *robot.plan] for name, robot in robots.items()}
    run.run_for(20.0)
    places = {name: robot.pose()[:2] for name, robot in robots.items()}
    assert all(min(math.dist(places[name], point) for point in granted[name]) < 0.1 for name in robots)
    run.run_for(100.0)
    assert all(math.dist(robot.pose()[:2], places[name]) < 0.01 for name, robot in robots.items())
    assert not any(ends.values())
    run.simulation.hold("")
    run.run_until(lambda: all(ends.values()))
    assert all(isinstance(end[0], CommandDone) for end in ends.values()), ends


def test_a_robot_in_a_lift_leaves_it_in_a_fire_where_the_lift_takes_it_and_goes_on_afterwards(world: WorldKind) -> None:
    run = Run(tower((7, 3, 0), (3, 3, 0)), world)
    end, waiting = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT)), run.start("Robot2", DriveTo(x=3, y=4, z=HEIGHT))
    robot = run.simulation.robots["Robot1"]
    run.run_until(lambda: robot.solid.z > 1)
    run.simulation.hold("fire alarm in Tower")
    run.run_for(60.0)
    assert robot.solid.z == HEIGHT
    assert robot.road.zone is None, "outside of the lift"
    assert not end
    places = {name: robot.pose()[:2] for name, robot in run.simulation.robots.items()}
    run.run_for(60.0)
    assert all(math.dist(robot.pose()[:2], places[name]) < 0.01 for name, robot in run.simulation.robots.items())
    assert run.simulation.robots["Robot2"].solid.z == 0.0, "nobody enters the lift"
    run.simulation.hold("")
    run.run_until(lambda: end and waiting, 200)
    assert isinstance(end[0], CommandDone)
    assert isinstance(waiting[0], CommandDone)


def two_doors() -> Map:
    """Two rooms, with a door between them on the straight way of the robot, and another one aside."""
    walls = [
        box(f"Wall{number}", "Wall", (4, y, 0), (0.1, depth, 2.5)) for number, y, depth in ((1, 0.45, 0.9), (2, 3, 1.8), (3, 5.55, 0.9))
    ]
    doors = [box(name, "Door", (4, y, 0), (0.1, 1.2, 2.1), Open=True) for name, y in (("Door1", 1.5), ("Door2", 4.5))]
    return Map([*shell(), *walls, *doors, robot("Robot1", (1, 1.5, 0))])


def test_a_robot_goes_another_way_if_a_door_is_out_of_order_and_is_told_which_if_there_is_none(world: WorldKind) -> None:
    run = Run(two_doors(), world)
    run.simulation.close_passages(("Door1",))
    end, pose = run.start("Robot1", DriveTo(x=7, y=1.5)), run.simulation.robots["Robot1"].pose
    northernmost = 0.0
    while not end:
        run.run_for(0.5)
        northernmost = max(northernmost, pose()[1])
    assert isinstance(end[0], CommandDone)
    assert northernmost > 4, "through the other door"
    run.simulation.close_passages(("Door1", "Door2"))
    refused = run.execute("Robot1", DriveTo(x=1, y=1.5))
    assert isinstance(refused, CommandGivenUp)
    assert "Door1 is out of order" in refused.description
    run.simulation.close_passages(())
    assert isinstance(run.execute("Robot1", DriveTo(x=1, y=1.5)), CommandDone)


def test_a_robot_under_way_is_told_that_the_only_door_is_out_of_order(world: WorldKind) -> None:
    run = Run(two_doors(), world)
    run.simulation.close_passages(("Door2",))
    end = run.start("Robot1", DriveTo(x=7, y=4.5))
    run.run_for(2.0)
    run.simulation.close_passages(("Door1", "Door2"))
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandGivenUp)
    assert end[0].reason == "blocked"
    assert "out of order" in end[0].description


def test_a_mistake_in_a_mode_is_answered_with_what_there_is(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        with pytest.raises(NotFound, match="no building Building01 on the map"):
            await api.control.set_mode(Mode.FIRE, building="Building01")
        with pytest.raises(UsageError, match="a building is in one of the modes Normal, Fire, Emergency, and not in OutOfOrder"):
            await api.control.set_mode(Mode.OUT_OF_ORDER, building=BUILDING)
        with pytest.raises(UsageError, match="a lift or a door is out of order; name it"):
            await api.control.set_mode(Mode.OUT_OF_ORDER)
        with pytest.raises(UsageError, match="one of them at a time"):
            await api.control.set_mode(Mode.OUT_OF_ORDER, lift="Lift1", door="Door1")

    play(tmp_path, scenario)


def test_the_command_and_the_request_do_the_same(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with asyncio.timeout(HANG_TIME), AsyncExitStack() as stack:
            system = SmallSystem(tmp_path, ())
            stack.push_async_callback(system.stop)
            await system.start()
            url = await stack.enter_async_context(api_at(system))
            replace(system.addresses, api=url).write(tmp_path)
            shown = await asyncio.to_thread(somrs, "mode", "fire", "--building", BUILDING, "--data", tmp_path)
            assert (shown.returncode, "fire alarm in Building001" in shown.stdout) == (0, True), shown
            request = urllib.request.Request(f"{url}/control/mode?mode=Normal&building={BUILDING}", method="POST")
            answer = json.loads(await asyncio.to_thread(lambda: urllib.request.urlopen(request).read()))
            assert answer == {"modes": [{"object": BUILDING, "mode": "Normal", "reason": ""}]}
            while "fire" in (shown := await asyncio.to_thread(somrs, "mode", "--data", tmp_path)).stdout:
                await asyncio.sleep(0.01)
            assert "Building001" in shown.stdout
            assert "normal" in shown.stdout
            wrong = await asyncio.to_thread(somrs, "mode", "fire", "--door", "Door1", "--data", tmp_path)
            assert wrong.returncode
            assert "no door Door1 on the map" in wrong.stderr

    asyncio.run(scenario())


LAB = (
    building("Lab", 8, 6)
    + """
  Entrance: {type: Place, at: [6, 4]}
  Robot1: {type: PioneerP3DX, at: [3, 3, 0], Price: 10 EUR, Charge: 80}
"""
)


@pytest.mark.parametrize("service", ["MoveTo", "ChargeBattery"])
def test_a_robot_that_is_asked_for_terms_in_a_fire_says_so_and_not_now(service: str) -> None:
    async def test() -> None:
        site = LAB.replace("type: Building\n", "type: Building\n    Mode: Fire\n")
        async with simulated(Manipulator, "Robot1", site) as harness:
            with pytest.raises(Refusal, match=r"^fire alarm in Building1$") as caught:
                await harness.quote(service, **({"Place": "Entrance"} if service == "MoveTo" else {}))
            assert caught.value.not_now

    run_in_room(test())


def test_a_task_waits_for_the_end_of_a_fire_with_the_reason_and_begins_at_once_then() -> None:
    robot = Robot("Robot1", price=10, duration=60, refuses="fire alarm in Building001", not_now=True)
    system = VirtualSystem(robot)
    system.change("Building001.Mode = Fire")
    task = system.submit(GOAL)
    system.world.run(3000)
    assert "fire alarm in Building001" in system.view(task).explanation
    robot.refuses = ""
    ended_at = system.world.now
    system.change("Building001.Mode = Normal")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.work[0].began < ended_at + 5


@pytest.mark.parametrize("mode", ["Fire", "Emergency", "Normal"])
def test_work_that_stands_still_in_a_fire_is_not_too_late(mode: str) -> None:
    def drive(order: Order) -> Work:
        yield 2300.0, WorkDone(situation=transfer_effect(order))

    system = VirtualSystem(Robot("Robot1", price=10, duration=60, works=drive))
    task = system.submit(GOAL)
    system.world.run(10)
    system.change(f"Building001.Mode = {mode}")
    system.world.run(2000)
    system.change("Building001.Mode = Normal")
    overdue = [event for event in events_of(system, task) if isinstance(event, ServiceOverdue)]
    assert bool(overdue) is (mode == "Normal")
    if mode != "Normal":
        (view,) = system.finish(task)
        assert view.outcome is Outcome.ACCOMPLISHED
        assert len(view.work) == 1


def events_of(system: VirtualSystem, task: str) -> list[object]:
    return [noted.event for noted in system.manager.state.tasks[task].events]
