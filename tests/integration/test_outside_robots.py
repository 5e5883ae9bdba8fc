"""Simulated robots that programs of their own drive, which take part in traffic by messages: straight lines, and velocities."""

from __future__ import annotations

import math

import pytest

from somrs.devices.simulator.link.commands import (
    Approach,
    Command,
    CommandDone,
    CommandGivenUp,
    DriveAlong,
    DriveTo,
    Grip,
    Place,
    PutDown,
    Velocity,
)
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support.simulator_room import Run, Start, box, room


def outside(world: WorldKind = WorldKind.KINEMATIC, start: Start = (1.5, 1.5, 0.0), second_start: Start = (6.5, 4.5, math.pi)) -> Run:
    """A room in which Robot1 takes part in traffic from outside."""
    run = Run(room(start, second_start), world)
    run.simulation.set_outside("Robot1", True)
    return run


def end_of(run: Run, command: Command, robot: str = "Robot1", limit: float = 60.0) -> CommandDone | CommandGivenUp:
    ends = run.start(robot, command)
    run.run_until(lambda: bool(ends), limit)
    return ends[0]


def test_it_drives_in_straight_lines_through_points_and_turns(world: WorldKind) -> None:
    run = outside(world)
    end = end_of(run, DriveAlong(points=((3.0, 1.5), (3.0, 3.0)), yaw=math.pi))
    assert isinstance(end, CommandDone), end
    assert math.dist((end.state.x, end.state.y), (3.0, 3.0)) < 0.03
    assert abs(math.remainder(end.state.yaw - math.pi, math.tau)) < 0.03


def test_it_drives_backwards_and_no_faster_than_it_is_told() -> None:
    run = outside()
    started = run.simulation.time
    end = end_of(run, DriveAlong(points=((0.9, 1.5),), speed=0.1, backward=True))
    assert isinstance(end, CommandDone)
    assert abs(end.state.yaw) < 0.05
    assert run.simulation.time - started > 5.0


def test_it_drives_with_velocities_that_lapse(world: WorldKind) -> None:
    run = outside(world)
    end = end_of(run, Velocity(forward=0.3, lasts=2.0))
    assert isinstance(end, CommandDone)
    assert 1.9 < end.state.x < 2.2
    turned = end_of(run, Velocity(turning=0.5, lasts=2.0))
    assert 0.7 < turned.state.yaw < 1.1
    run.run_for(2.0)
    assert run.simulation.state("Robot1").x == pytest.approx(turned.state.x, abs=0.01)


def test_what_stands_in_the_way_stops_it_and_it_says_so() -> None:
    run = outside()
    run.start("Robot1", Velocity(forward=-0.4, lasts=30.0))
    run.run_for(20.0)
    state = run.simulation.state("Robot1")
    assert state.obstructed
    assert state.x > 0.2
    assert not run.collisions
    end = end_of(run, DriveAlong(points=((-0.5, 1.5),)))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "blocked"


def test_it_waits_for_a_robot_that_stands_in_its_way() -> None:
    run = outside(second_start=(3.5, 1.5, 0.0))
    ends = run.start("Robot1", DriveAlong(points=((5.5, 1.5),)))
    run.run_for(10.0)
    assert not ends
    assert run.simulation.state("Robot1").obstructed
    assert isinstance(end_of(run, DriveTo(x=3.5, y=4.0), "Robot2"), CommandDone)
    run.run_until(lambda: bool(ends), 30.0)
    assert isinstance(ends[0], CommandDone)
    assert not run.collisions


def test_it_grips_what_is_within_reach_and_drives_nowhere_by_itself() -> None:
    run = outside()
    far = end_of(run, Grip(object="Jar002"))
    assert isinstance(far, CommandGivenUp)
    assert far.reason == "unreachable"
    assert isinstance(end_of(run, DriveAlong(points=((1.0, 3.0), (1.0, 3.9)))), CommandDone)
    assert isinstance(end_of(run, Grip(object="Jar002")), CommandDone)
    assert isinstance(end_of(run, Place(support="Cupboard001")), CommandDone)
    for command in (DriveTo(x=2.0, y=2.0), Approach(object="Platform001")):
        assert isinstance(end_of(run, command), CommandGivenUp)


@pytest.mark.parametrize("y", [3.7, 4.0, 4.2])
def test_it_puts_things_where_it_looks(y: float) -> None:
    """Its program does not hear where they are."""
    run = outside()
    assert isinstance(end_of(run, DriveAlong(points=((1.0, 3.0), (1.0, 3.9)))), CommandDone)
    assert isinstance(end_of(run, Grip(object="Jar002")), CommandDone)
    assert isinstance(end_of(run, DriveAlong(points=((1.0, y),), yaw=math.pi)), CommandDone)
    end = end_of(run, Place(support="Cupboard001"))
    assert isinstance(end, CommandDone)
    (jar,) = (state for state in end.object_states if state.object == "Jar002")
    assert math.dist((jar.x, jar.y), (0.55 - 0.1, y)) < 0.06


def test_it_lays_things_down_where_it_looks_also_near_furniture() -> None:
    run = outside()
    for command in (DriveAlong(points=((1.0, 3.0), (1.0, 3.9))), Grip(object="Jar002"), DriveAlong(points=((3.6, 4.0),), yaw=math.pi / 2)):
        assert isinstance(end_of(run, command), CommandDone)
    end = end_of(run, PutDown())
    assert isinstance(end, CommandDone)
    (jar,) = (state for state in end.object_states if state.object == "Jar002")
    assert math.dist((jar.x, jar.y), (3.6, 4.56)) < 0.1  # a quarter of a metre before a table


def test_a_simulated_robot_does_not_drive_so() -> None:
    run = Run(room())
    end = end_of(run, Velocity(forward=0.3))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "not-possible"


def test_others_drive_around_it_while_its_program_takes_no_part() -> None:
    run = outside(start=(3.5, 3.0, 0.0), second_start=(6.5, 3.0, math.pi))
    assert isinstance(end_of(run, DriveTo(x=1.5, y=3.0), "Robot2"), CommandDone)
    assert not run.collisions
    assert "Robot1" not in run.simulation.traffic().robots or not run.simulation.traffic().robots["Robot1"].granted


def test_it_stays_outside_when_something_is_built() -> None:
    run = outside()
    run.simulation.add(box("Wall9", "Wall", (5.0, 3.0, 0.0), (0.1, 1.0, 2.5)))
    run.run_for(5.0)
    assert isinstance(end_of(run, DriveAlong(points=((2.5, 1.5),))), CommandDone)
    run.simulation.set_outside("Robot1", False)
    assert isinstance(end_of(run, DriveTo(x=1.5, y=1.5)), CommandDone)
