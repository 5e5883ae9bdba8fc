"""Robots of any make get rid of what they must not keep, and know what they hold, whenever their program or their connection ends."""

from __future__ import annotations

import asyncio
import contextlib
import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from somrs.devices.simulator.drivers.manipulator import Spot
from somrs.devices.simulator.link.commands import ObjectState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.service_manager.sdk.device import Task
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Order
from tests.support.road_lab import LabRobot, RoadLab, in_lab, in_virtual_time


async def carrying(lab: RoadLab, robot: LabRobot) -> None:
    """Have a robot take the jar from the table."""
    await robot.link.approach("Jar1")
    (state,) = (await robot.link.grip("Jar1")).object_states
    assert state.held_by == robot.name
    lab.report("Jar1 isHeldBy Robot1")


async def put_down_place(robot: LabRobot) -> str | None:
    """Have a robot put down what it holds. Returns where that is, as it reports."""
    (state,) = (await robot.link.put_down_object()).object_states
    assert robot.holding is None
    return state.support


@in_lab
async def test_a_thing_is_put_down_on_the_floor_where_the_robot_stands(lab: RoadLab, robot: LabRobot) -> None:
    await carrying(lab, robot)
    assert await put_down_place(robot) == "Floor1" == lab.places["Jar1"]


@in_lab
async def test_what_is_laid_down_over_a_piece_of_furniture_is_on_it(lab: RoadLab, robot: LabRobot) -> None:
    """Seen with a Pioneer that stood before a cupboard: the map had the jar under it, where no robot could reach it."""

    robot.reach = -0.7  # to where the table is
    await carrying(lab, robot)
    (state,) = (await robot.link.put_down_object()).object_states
    assert (state.support, state.z) == ("Table1", 0.7)


async def put_on_platform(robot: LabRobot) -> ObjectState:
    """Have a robot put what it holds on the platform, and say so on the map."""
    await robot.link.approach("Platform1")
    (state,) = (await robot.link.place("Platform1")).object_states
    return state


@in_lab
async def test_no_thing_is_put_where_another_one_is(lab: RoadLab, robot: LabRobot) -> None:
    await carrying(lab, robot)
    jar = await put_on_platform(robot)
    lab.report(f"Jar1 isOn Platform1 AND Jar1.PositionX = {jar.x} AND Jar1.PositionY = {jar.y} AND Jar1.PositionZ = {jar.z}")
    await robot.link.approach("Anvil1")
    await robot.link.grip("Anvil1")
    anvil = await put_on_platform(robot)
    size = sum(robot.building.solids[thing].extent for thing in ("Jar1", "Anvil1"))
    assert math.dist((jar.x, jar.y), (anvil.x, anvil.y)) > size


@in_lab
async def test_where_another_robot_has_put_something_meanwhile_nothing_is_put(lab: RoadLab, robot: LabRobot) -> None:
    await carrying(lab, robot)
    await robot.link.approach("Platform1")
    x, y = robot.building.spot_on("Platform1", (robot.body.x, robot.body.y))
    lab.report(f"Anvil1 isOn Platform1 AND Anvil1.PositionX = {x} AND Anvil1.PositionY = {y} AND Anvil1.PositionZ = 0.3")
    (jar,) = (await robot.link.place("Platform1")).object_states
    assert math.dist((jar.x, jar.y), (x, y)) > robot.building.solids["Anvil1"].extent


@in_lab
async def test_a_robot_that_carries_something_keeps_its_task_longer_while_it_cannot_be_reached(lab: RoadLab, robot: LabRobot) -> None:
    """Seen with vehicles whose broker was started anew: the task failed, because no plan takes a thing out of a gripper."""

    assert robot.lost_link_patience < 10
    await carrying(lab, robot)
    robot.go_away()
    returning = asyncio.create_task(asyncio.sleep(60))
    returning.add_done_callback(lambda _: robot.return_back())
    assert await robot.link.wait_reconnected(robot.lost_link_patience)


@in_lab
async def test_a_robot_that_puts_nothing_down_where_it_stands_brings_it_back(lab: RoadLab, robot: LabRobot) -> None:
    robot.floor = False
    await carrying(lab, robot)
    await robot.link.approach("Platform1")
    assert await put_down_place(robot) == "Table1" == lab.places["Jar1"]


@in_lab
async def test_where_there_is_no_room_any_more_it_goes_to_the_nearest_support_that_has_some(lab: RoadLab, robot: LabRobot) -> None:
    robot.floor = False
    await carrying(lab, robot)
    lab.full.add("Table1")
    assert await put_down_place(robot) == "Platform1" == lab.places["Jar1"]


@in_lab
async def test_a_robot_that_can_put_it_nowhere_keeps_it_and_says_why(lab: RoadLab, robot: LabRobot) -> None:
    robot.floor = False
    await carrying(lab, robot)
    lab.full |= {"Table1", "Platform1"}
    with pytest.raises(RobotGaveUp, match=r"Robot1 can put Jar1 down nowhere: there is .* no room for it"):
        await robot.link.put_down_object()
    assert robot.holding == "Jar1"
    lab.full.clear()
    assert await put_down_place(robot) == "Table1"


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(moment=st.floats(0.1, 40.0), senses=st.booleans(), floor=st.booleans(), is_killed=st.booleans(), outage=st.floats(0.0, 20.0))
def test_it_is_known_where_a_thing_is_whenever_a_program_or_a_connection_ends(
    tmp_path_factory: pytest.TempPathFactory, moment: float, senses: bool, floor: bool, is_killed: bool, outage: float
) -> None:
    """A program that is killed, or a robot that cannot be reached, at any moment of a transfer: what was begun goes on meanwhile."""

    async def transfer(robot: LabRobot) -> None:
        await robot.link.approach("Jar1")
        await robot.link.grip("Jar1")
        await robot.link.approach("Platform1")
        await robot.link.place("Platform1")

    async def test() -> None:
        lab = RoadLab(tmp_path_factory.mktemp("data"))
        robot = lab.robots["Robot1"]
        robot.senses, robot.floor = senses, floor
        await lab.start()
        work = asyncio.create_task(transfer(robot))
        await asyncio.sleep(moment)
        robot.go_away()
        with contextlib.suppress(RobotGaveUp):
            await work
        lab.report("NOT Jar1 isOn Table1")  # nobody knows, while nobody answers
        await asyncio.sleep(outage)
        if is_killed:
            robot = await lab.restart("Robot1")
        else:
            robot.return_back()
        states = (await robot.link.stop()).object_states
        if robot.holding is not None:
            assert await put_down_place(robot) == lab.places["Jar1"]
        else:
            (state,) = states
            assert state.support == lab.places["Jar1"]
        assert robot.body.held_thing is None

    in_virtual_time(test())


@in_lab
async def test_what_was_put_down_unnoticed_is_taken_from_there_to_be_brought_back(lab: RoadLab, robot: LabRobot) -> None:
    """Seen with ROS 2, whose gripper says nothing: the robot looked for the thing where it had been before."""

    robot.senses = False
    await carrying(lab, robot)
    await robot.link.approach("Platform1")
    placing = asyncio.create_task(robot.link.place("Platform1"))
    await asyncio.sleep(0.75 * robot.body.handling)
    robot = await lab.restart("Robot1")
    placing.cancel()
    assert lab.places["Jar1"] == "Platform1"
    await robot.link.approach("Table1")
    (state,) = (await robot.link.place("Table1")).object_states
    assert state.support == "Table1" == lab.places["Jar1"]


@in_lab
async def test_a_command_waits_until_a_robot_whose_program_was_started_anew_takes_part_in_traffic(lab: RoadLab, robot: LabRobot) -> None:
    """Seen with vehicles and ROS 2: undoing at once what had been begun failed, and no plan takes a thing out of a gripper."""

    await carrying(lab, robot)
    restart = asyncio.create_task(lab.restart("Robot1"))
    while (restarted := lab.robots["Robot1"]) is robot or not restarted.link.connected:
        await asyncio.sleep(0.01)
    restarted.link.gripper.load([])
    assert (await restarted.link.stop()).state.holding == "Jar1", "who stops its work learns that it is to be put down"
    assert not restarted.road.entered.is_set()
    await restarted.link.approach("Table1")
    await restarted.link.place("Table1")
    assert lab.places["Jar1"] == "Table1"
    await restart


@pytest.mark.parametrize("is_gripped", [False, True])
@in_lab
async def test_what_nobody_knows_of_a_pick_is_made_sure_of_afterwards(lab: RoadLab, robot: LabRobot, is_gripped: bool) -> None:
    """Seen with ROS 2, whose gripper's program had ended: the task waited for somebody to look for a jar that had not been touched."""

    robot.senses = False
    await robot.link.approach("Jar1")
    robot.ends_at = 0.75 if is_gripped else 0.25
    with pytest.raises(RobotGaveUp, match="its gripper has ended") as failure:
        await robot.link.grip("Jar1")
    assert (failure.value.reason, failure.value.object_states) == ("link-lost", ())
    assert robot.lost_link_patience == robot.carrying_patience
    with pytest.raises(RobotGaveUp, match="its gripper has ended"):
        await robot.link.put_down_object()
    assert robot.holding == "Jar1", "nobody can tell"
    robot.ends_at = None
    assert await put_down_place(robot) == "Table1" == lab.places["Jar1"]


@in_lab
async def test_a_robot_that_was_gone_while_it_picked_goes_on_when_it_is_back(lab: RoadLab, robot: LabRobot) -> None:
    await robot.link.approach("Jar1")
    picking = asyncio.create_task(robot.link.grip("Jar1"))
    await asyncio.sleep(0.1)
    robot.go_away()
    with pytest.raises(RobotGaveUp, match="cannot be reached"):
        await picking
    assert robot.lost_link_patience == robot.carrying_patience


@pytest.mark.parametrize("share", [0.25, 0.75])
@in_lab
async def test_what_is_stopped_while_it_is_put_down_is_in_the_gripper_or_there(lab: RoadLab, robot: LabRobot, share: float) -> None:
    await carrying(lab, robot)
    putting_down = asyncio.create_task(robot.link.put_down_object())
    await asyncio.sleep(share * robot.body.handling)
    await robot.link.stop()
    with pytest.raises(RobotGaveUp):
        await putting_down
    assert await put_down_place(robot) == "Floor1" == lab.places["Jar1"]


@in_lab
async def test_a_service_waits_until_the_idle_robot_has_put_down_what_it_held(lab: RoadLab, robot: LabRobot) -> None:
    """Seen with a vehicle: it was told to undo its work in the middle of that, and nobody knew any more where the jar was."""

    robot.map = MapReader(lab.answer)
    robot.observer = lambda situation, observation: lab.report(str(situation))
    await robot.open()
    await carrying(lab, robot)
    while robot.body.held_thing is not None:
        await asyncio.sleep(0.1)
    assert robot.holding == "Jar1", "it is about to say that it has put it down"
    order = Order(participant="Robot1.TransferObject", method="transfer", inputs={}, effect="Jar1 isOn Platform1")
    await robot._carry_out_transfer(Task(robot.name, order, lab.answer, lambda advance: None), "Jar1", Spot(support="Platform1"))
    assert lab.places["Jar1"] == "Platform1"
    await robot.close()


def test_a_robot_that_is_back_says_where_the_thing_is_that_the_map_has_forgotten(tmp_path: Path) -> None:
    """Seen with vehicles that were away for 38 s while they picked: the task waited for ever, and the jar was where it had been."""

    async def test() -> None:
        lab = RoadLab(tmp_path)
        robot = lab.robots["Robot1"]
        observed: list[str | None] = []
        robot.observer = lambda situation, observation: observed.append(situation)
        robot.map = MapReader(lab.answer)
        await lab.start()
        robot._link, robot._last_observations, robot._weights, robot._reported_pose, robot._kept = robot.link, {}, {}, None, None
        await robot.link.approach("Jar1")
        picking = asyncio.create_task(robot.link.grip("Jar1"))
        await asyncio.sleep(0.1)
        robot.go_away()
        with pytest.raises(RobotGaveUp):
            await picking
        await asyncio.sleep(10.0)
        robot.body.held_thing, lab.places["Jar1"] = None, "Table1"  # it has let go of it
        lab.report("NOT Jar1 isOn Table1")
        robot.return_back()
        await robot.link.stop()
        for _ in range(2):
            state = robot.link.state
            assert state is not None
            await robot._notice_idle(state, (state.x, state.y, state.yaw))
        situations = [situation for situation in observed if situation is not None and "Jar1" in situation]
        assert len(situations) == 1
        assert "Jar1 isOn Table1" in situations[0]

    in_virtual_time(test())
