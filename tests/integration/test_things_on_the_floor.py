"""Things that are put down where robots drive: nobody drives into them, and robots get at them."""

from __future__ import annotations

import math

import pytest

from somrs.devices.simulator.link.commands import Approach, CommandDone, DriveTo, Fault, Grip, PutDown, Stop
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support.simulator_room import Run, room

TOUCHING = 0.27 + 0.04
"""The distance of the middles of a robot and a jar that touch each other, m."""


def stopped_with_a_jar_at_its_feet(world: WorldKind, seconds: float) -> Run:
    """Robot1 was stopped after so many seconds of its way with a jar, and has put it down where it stands."""
    run = Run(room(), world)
    run.execute_all("Robot1", Grip(object="Jar002"))
    run.start("Robot1", Approach(object="Platform001"))
    run.run_for(seconds)
    run.execute_all("Robot1", Stop(), PutDown())
    return run


def distance_to_jar(run: Run, robot: str) -> float:
    state, jar = run.simulation.state(robot), run.simulation.observe("Jar002")
    return math.dist((state.x, state.y), (jar.x, jar.y))


@pytest.mark.parametrize("seconds", [1.75, 4.25])
def test_a_robot_fetches_what_another_one_has_put_down_at_its_own_feet(world: WorldKind, seconds: float) -> None:
    run = stopped_with_a_jar_at_its_feet(world, seconds)
    ends = run.start("Robot2", Approach(object="Jar002"))
    while not ends:
        run.step()
        assert run.simulation.time < 100.0
        assert distance_to_jar(run, "Robot1") > TOUCHING - 0.01
    run.execute_all("Robot2", Grip(object="Jar002"))
    assert not run.collisions


@pytest.mark.parametrize("seconds", [2.25, 4.25])
def test_a_robot_drives_away_from_what_it_has_put_down_in_its_way(seconds: float) -> None:
    run = stopped_with_a_jar_at_its_feet(WorldKind.KINEMATIC, seconds)
    ends = run.start("Robot1", DriveTo(x=6.5, y=3.0))
    while not ends:
        run.step()
        assert run.simulation.time < 100.0
        assert distance_to_jar(run, "Robot1") > TOUCHING - 0.01
    assert isinstance(ends[0], CommandDone), ends


def test_a_robot_that_is_repaired_on_its_way_comes_to_its_goal() -> None:
    run = Run(room(), WorldKind.KINEMATIC)
    ends = run.start("Robot1", DriveTo(x=6.5, y=3.0))
    run.run_for(3.0)
    run.simulation.repair("Robot1", Fault.GRIPPER)
    run.run_until(lambda: ends, 60.0)
    assert isinstance(ends[0], CommandDone), ends
