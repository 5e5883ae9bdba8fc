"""Doors that open by themselves for robots that were granted the way through them, and shut behind the last one."""

from __future__ import annotations

import pytest

from somrs.devices.simulator.link.commands import Close, CommandDone, CommandGivenUp, DriveTo, Fault, Open
from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.space.doorways import DOOR_ROOM
from tests.support.rooms_with_door import DOOR, two_rooms
from tests.support.simulator_room import Run, box, thing


def is_open(run: Run) -> bool:
    return run.simulation.observe(DOOR).open is True


def test_a_door_opens_for_a_robot_and_shuts_behind_it(world: WorldKind) -> None:
    run = Run(two_rooms((1.0, 1.0, 0.0)), world)
    (leaf,) = run.simulation.scene.leaves(DOOR)
    run.run_for(5)
    assert not is_open(run)
    end = run.start("Robot1", DriveTo(x=7, y=4.5))
    state = run.simulation.robots["Robot1"]
    opened = False

    def step() -> bool:
        nonlocal opened
        opened |= is_open(run)
        if state.solid.distance(*state.pose()[:2]) < 0 and abs(state.pose()[0] - 4) < state.size.radius + 0.05:
            assert leaf.is_open(run.simulation.scene.leaf_position(leaf)), "it is never in a doorway that is not open"
        return bool(end)

    run.run_until(step)
    assert isinstance(end[0], CommandDone), end
    assert opened
    run.run_until(lambda: not run.simulation.busy)
    assert leaf.is_shut(run.simulation.scene.leaf_position(leaf))
    assert not is_open(run)
    assert not run.collisions


def test_a_door_stays_open_until_the_last_of_several_robots_is_through(world: WorldKind) -> None:
    run = Run(two_rooms((1.0, 1.0, 0.0), (1.0, 2.9, 0.0), (7.0, 4.5, 3.1)), world)
    goals = {"Robot1": (6.0, 1.0), "Robot2": (7.0, 3.0), "Robot3": (1.0, 5.0)}
    ends = {name: run.start(name, DriveTo(x=x, y=y)) for name, (x, y) in goals.items()}
    run.run_until(lambda: all(ends.values()), 200)
    assert all(isinstance(end[0], CommandDone) for end in ends.values()), ends
    run.run_until(lambda: not run.simulation.busy)
    assert not is_open(run)
    assert not run.collisions


def test_a_robot_that_breaks_in_the_doorway_keeps_the_door_open(world: WorldKind) -> None:
    run = Run(two_rooms((2.0, 2.9, 0.0)), world)
    run.start("Robot1", DriveTo(x=7, y=2.9))
    run.run_until(lambda: abs(run.simulation.state("Robot1").x - 4) < 0.1)
    run.simulation.fault("Robot1", Fault.DRIVE)
    run.run_for(30)
    assert is_open(run)
    assert not run.simulation.busy, "the simulator rests meanwhile"
    run.simulation.repair("Robot1", Fault.DRIVE)
    run.execute_all("Robot1", DriveTo(x=6.5, y=2.9))
    run.run_until(lambda: not is_open(run))
    assert not run.collisions


def test_a_person_opens_a_door_for_good_and_shuts_it_again(world: WorldKind) -> None:
    run = Run(two_rooms((1.0, 1.0, 0.0)), world)
    run.execute_all(DOOR, Open(object=DOOR))
    run.run_for(20)
    assert is_open(run)
    run.execute_all("Robot1", DriveTo(x=6, y=3))
    run.run_for(20)
    assert is_open(run)
    run.execute_all(DOOR, Close(object=DOOR))
    assert not is_open(run)
    run.execute_all("Robot1", DriveTo(x=1, y=3))
    assert not run.collisions


def test_who_opens_it_on_the_map_keeps_it_open() -> None:
    run = Run(two_rooms((1.0, 1.0, 0.0)), WorldKind.KINEMATIC)
    for opened in (True, False):
        run.simulation.renew(box(DOOR, "AutomaticDoor", (4, 2.9, 0), (0.1, 1.4, 2.1), Open=opened))
        run.run_for(20)
        assert is_open(run) is opened


def test_a_robot_waits_for_a_door_that_an_operator_has_stopped(world: WorldKind) -> None:
    run = Run(two_rooms((2.0, 2.9, 0.0)), world)
    run.simulation.linked.set_paused(DOOR, True)
    end = run.start("Robot1", DriveTo(x=7, y=2.9))
    run.run_for(30)
    assert not end
    assert run.simulation.state("Robot1").hindrance == "Door1 is stopped"
    assert run.simulation.state("Robot1").x < 4 - run.simulation.robots["Robot1"].size.radius - DOOR_ROOM
    run.simulation.linked.set_paused(DOOR, False)
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandDone), end


@pytest.mark.parametrize("is_broken", [True, False])
def test_a_door_that_does_not_work_or_is_out_of_order_is_named(world: WorldKind, is_broken: bool) -> None:
    run = Run(two_rooms((2.0, 2.9, 0.0)), world)
    end = run.start("Robot1", DriveTo(x=7, y=2.9))
    run.run_until(lambda: run.simulation.state("Robot1").x > 2.2)
    if is_broken:
        run.simulation.fault(DOOR, Fault.DRIVE)
    else:
        run.simulation.close_passages((DOOR,))
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandGivenUp), end
    assert "Door1 is out of order" in end[0].description
    assert run.simulation.state("Robot1").x < 4
    if is_broken:
        run.simulation.repair(DOOR, Fault.DRIVE)
    else:
        run.simulation.close_passages(())
    run.execute_all("Robot1", DriveTo(x=7, y=2.9))
    assert not run.collisions


def test_a_thing_in_the_doorway_keeps_the_door_open_and_the_simulator_rests(world: WorldKind) -> None:
    run = Run(two_rooms((1.0, 1.0, 0.0), extra=(thing("Jar1", "Jar", 2.0, 1.0, 0.0),)), world)
    run.execute_all(DOOR, Open(object=DOOR))
    run.simulation.move("Jar1", 4.0, 3.2, 0.0)
    run.simulation.renew(box(DOOR, "AutomaticDoor", (4, 2.9, 0), (0.1, 1.4, 2.1), Open=False))
    run.run_for(20)
    assert is_open(run)
    assert not run.simulation.busy
    run.simulation.move("Jar1", 2.0, 1.0, 0.0)
    run.run_until(lambda: not is_open(run))


def test_a_quote_counts_the_wait_and_demands_nothing() -> None:
    automatic, gap = (
        Run(two_rooms((2.0, 2.9, 0.0), type=type, Open=opened), WorldKind.KINEMATIC)
        for type, opened in (("AutomaticDoor", False), ("Door", True))
    )
    legs = find_legs(automatic.simulation, "Robot1", ((7.0, 2.9),))
    open_legs = find_legs(gap.simulation, "Robot1", ((7.0, 2.9),))
    assert (legs.shut, legs.open, open_legs.open) == ((), (), (DOOR,))
    assert legs.lengths[0] is not None
    assert open_legs.lengths[0] is not None
    assert 3 * 0.8 - 0.3 < legs.lengths[0] - open_legs.lengths[0] < 3 * 0.8 + 0.3
    automatic.simulation.fault(DOOR, Fault.DRIVE)
    assert find_legs(automatic.simulation, "Robot1", ((7.0, 2.9),)).out_of_order == (DOOR,)
