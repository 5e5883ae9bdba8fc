"""Robots that ride in lifts: one at a time, and never through a shut door."""

from __future__ import annotations

import math

from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, DriveTo, Fault, Grip, Place
from somrs.devices.simulator.link.lines import Break
from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.server.faults import Schedule
from somrs.devices.simulator.server.poses import Table
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactAdded, FactRemoved
from tests.support.simulated_tower import CABIN, HEIGHT, tower
from tests.support.simulator_room import Run, box, thing


def height(run: Run, robot: str) -> float:
    z = run.simulation.state(robot).z
    assert z is not None
    return z


def test_a_lift_takes_a_robot_to_another_storey(world: WorldKind) -> None:
    run = Run(tower((2, 2, 0)), world)
    run.execute_all("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    state = run.simulation.state("Robot1")
    assert state.z == HEIGHT
    assert math.dist((state.x, state.y), (3, 3)) < 0.03
    assert not run.collisions


def test_a_robot_takes_a_thing_to_a_table_upstairs(world: WorldKind) -> None:
    run = Run(tower((2, 2, 0), extra_objects=[thing("Jar1", "Jar", 2.0, 5.0, 0.74)]), world)
    run.execute_all("Robot1", Grip(object="Jar1"), Place(support="Table2"))
    assert run.simulation.observe("Jar1").support == "Table2"
    assert not run.collisions


def test_robots_that_go_up_and_down_take_turns(world: WorldKind) -> None:
    run = Run(tower((2, 2, 0), (3, 4, 0), (6, 3, 0)), world)
    run.execute_all("Robot2", DriveTo(x=4, y=3, z=HEIGHT))
    goals = {"Robot1": (3, 2, HEIGHT), "Robot2": (3, 3, 0.0), "Robot3": (5, 4, HEIGHT)}
    ends = {name: run.start(name, DriveTo(x=x, y=y, z=z)) for name, (x, y, z) in goals.items()}

    def step() -> bool:
        inside = [name for name in goals if math.dist(run.simulation.scene.pose(name)[:2], CABIN) < 0.9]
        assert len(inside) <= 1, inside
        return all(ends.values())

    run.run_until(step, 200)
    assert all(isinstance(end[0], CommandDone) for end in ends.values()), ends
    assert {name: run.simulation.state(name).z for name in goals} == {name: z for name, (_, _, z) in goals.items()}
    assert not run.collisions


def test_a_lift_that_breaks_keeps_its_robot_until_it_is_mended(world: WorldKind) -> None:
    run = Run(tower((7, 3, 0)), world)
    end = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.run_until(lambda: height(run, "Robot1") > 1)
    run.simulation.fault("Lift1", Fault.DRIVE)
    stuck_at = height(run, "Robot1")
    run.run_for(30)
    assert height(run, "Robot1") == stuck_at
    assert not end
    assert run.simulation.state("Robot1").hindrance == "Lift1 does not work"
    run.simulation.repair("Lift1", Fault.DRIVE)
    assert run.simulation.state("Robot1").hindrance is None
    run.simulation.linked.set_paused("Lift1", True)
    run.run_for(10)
    assert height(run, "Robot1") == stuck_at
    assert run.simulation.state("Robot1").hindrance == "Lift1 is stopped"
    run.simulation.linked.set_paused("Lift1", False)
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandDone), end
    assert run.simulation.state("Robot1").z == HEIGHT


def test_a_lift_breaks_when_it_has_carried_a_robot_for_the_distance_that_was_planned(world: WorldKind) -> None:
    run = Run(tower((7, 3, 0)), world)
    schedule = Schedule(run.simulation)
    schedule.add(Break(robot="Lift1", fault=Fault.DRIVE, carried=1.5))
    run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    due: list[tuple[str, Fault]] = []

    def is_due() -> bool:
        due.extend(schedule.due())
        return bool(due)

    run.run_until(is_due)
    assert due == [("Lift1", Fault.DRIVE)]
    state = run.simulation.state("Lift1")
    assert state.holding == "Robot1"
    assert state.z == height(run, "Robot1")
    assert 1.5 <= state.z < 1.7


def test_a_robot_does_not_enter_a_lift_that_does_not_work(world: WorldKind) -> None:
    run = Run(tower((2, 2, 0)), world)
    run.simulation.fault("Lift1", Fault.DRIVE)
    end = run.execute("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    assert isinstance(end, CommandGivenUp)
    assert end.reason in ("unreachable", "blocked")
    assert "lift" in end.description.lower()
    assert run.simulation.state("Robot1").x < 8


def test_a_robot_that_was_granted_a_lift_does_not_enter_it_when_it_is_taken_out_of_order(world: WorldKind) -> None:
    run = Run(tower((7, 3, 0)), world)
    end = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.run_until(lambda: run.simulation.robots["Robot1"].road.next_zone == "Lift1")
    run.simulation.close_passages(("Lift1",))
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandGivenUp), end
    assert "lift" in end[0].description.lower()
    assert run.simulation.state("Robot1").z == 0.0
    run.simulation.close_passages(())
    run.execute_all("Robot1", DriveTo(x=3, y=3, z=HEIGHT))


def test_a_robot_gets_out_of_a_lift_that_is_taken_out_of_order(world: WorldKind) -> None:
    run = Run(tower((7, 3, 0)), world)
    end = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.run_until(lambda: height(run, "Robot1") > 1)
    run.simulation.close_passages(("Lift1",))
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandDone), end
    assert height(run, "Robot1") == HEIGHT


def test_a_robot_that_was_granted_a_lift_takes_it_after_everything_was_stopped_for_long(world: WorldKind) -> None:
    run = Run(tower((2, 2, 0)), world)
    simulation = run.simulation
    end = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.run_for(2)
    for device in simulation.devices():
        simulation.linked.set_paused(device, True)
    run.run_until(lambda: simulation.rest(simulation.time + 60))
    for device in simulation.devices():
        simulation.linked.set_paused(device, False)
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandDone), end


def test_a_lift_that_breaks_on_the_way_to_it_sends_the_robot_back(world: WorldKind) -> None:
    run = Run(tower((2, 2, 0)), world)
    end = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.run_until(lambda: run.simulation.state("Robot1").x > 5)
    run.simulation.fault("Lift1", Fault.DRIVE)
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandGivenUp), end


def test_a_robot_that_breaks_in_the_cabin_is_taken_where_it_was_going(world: WorldKind) -> None:
    run = Run(tower((7, 3, 0), (2, 2, 0)), world)
    end = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.run_until(lambda: height(run, "Robot1") > 1)
    run.simulation.fault("Robot1", Fault.DRIVE)
    run.run_until(lambda: end)
    assert isinstance(end[0], CommandGivenUp)
    assert end[0].reason == "drive-dead"
    run.run_until(lambda: run.simulation.state("Robot1").z == HEIGHT)
    second = run.execute("Robot2", DriveTo(x=3, y=3, z=HEIGHT))
    assert isinstance(second, CommandGivenUp)
    assert "Robot1" in second.description
    run.simulation.repair("Robot1", Fault.DRIVE)
    run.execute_all("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.execute_all("Robot2", DriveTo(x=5, y=3, z=HEIGHT))


def test_a_way_to_another_storey_counts_the_ride() -> None:
    run = Run(tower((2, 2, 0), extra_objects=[thing("Jar1", "Jar", 2.0, 5.0, 0.74)]), WorldKind.KINEMATIC)
    legs = find_legs(run.simulation, "Robot1", ("Table1", "Table2", "Table1"))
    there, up, down = legs.lengths
    assert there is not None
    assert up is not None
    assert down is not None
    assert there < 4
    assert abs(up - down) < 1
    assert up > 2 * 6 + 0.8 * HEIGHT
    assert legs.shut == legs.open == ()
    run.simulation.fault("Lift1", Fault.DRIVE)
    broken = find_legs(run.simulation, "Robot1", ("Jar1", "Table2", "Table1"))
    assert broken.lengths[1:] == (None, None)
    assert broken.out_of_order == ("Lift1",)


def test_a_quote_names_all_lifts_of_which_one_would_do() -> None:
    run = Run(tower((2, 2, 0), has_western_lift=True), WorldKind.KINEMATIC)
    run.simulation.fault("Lift1", Fault.DRIVE)
    other_way = find_legs(run.simulation, "Robot1", ("Table2",))
    assert None not in other_way.lengths
    run.simulation.fault("Lift2", Fault.DRIVE)
    assert find_legs(run.simulation, "Robot1", ("Table2",)).out_of_order == ("Lift1", "Lift2")
    run.simulation.repair("Lift1", Fault.DRIVE)
    assert None not in find_legs(run.simulation, "Robot1", ("Table2",)).lengths


def test_a_quote_names_the_door_that_every_way_needs_and_all_lifts_behind_it() -> None:
    walls = [box("LeftWall", "Wall", (0.7, 1.5, 0), (1.4, 0.1, 2.5)), box("RightWall", "Wall", (5.25, 1.5, 0), (5.5, 0.1, 2.5))]
    door = box("Door1", "Door", (1.95, 1.5, 0), (1.1, 0.1, 2.1), Open=True)
    run = Run(tower((2, 0.7, 0), extra_objects=[*walls, door], has_western_lift=True), WorldKind.KINEMATIC)
    assert None not in find_legs(run.simulation, "Robot1", ("Table2",)).lengths
    run.simulation.close_passages(("Door1", "Lift1", "Lift2"))
    assert find_legs(run.simulation, "Robot1", ("Table2",)).out_of_order == ("Door1", "Lift1", "Lift2")
    run.simulation.close_passages(("Door1", "Lift1"))
    assert find_legs(run.simulation, "Robot1", ("Table2",)).out_of_order == ("Door1",)


def test_a_point_is_on_the_floor_of_its_height() -> None:
    run = Run(tower((2, 2, 0)), WorldKind.KINEMATIC)
    (near,) = find_legs(run.simulation, "Robot1", ((6.0, 2.0),)).lengths
    (far,) = find_legs(run.simulation, "Robot1", ((6.0, 2.0, HEIGHT),)).lengths
    (nowhere,) = find_legs(run.simulation, "Robot1", ((6.0, 2.0, 3 * HEIGHT),)).lengths
    assert near is not None
    assert far is not None
    assert near < 5 < far
    assert nowhere is None
    for height in (0.0, HEIGHT):
        (over_the_table,) = find_legs(run.simulation, "Robot1", ((2.0, 4.95, height),)).lengths
        assert over_the_table is not None, "the arm reaches over the table of that floor"


def test_a_promised_robot_starts_from_another_storey() -> None:
    run = Run(tower((2, 2, 0)), WorldKind.KINEMATIC)
    promise = f"Robot1.PositionX = 4 AND Robot1.PositionY = 3 AND Robot1.PositionZ = {HEIGHT}"
    (length,) = find_legs(run.simulation, "Robot1", ("Table2",), promise).lengths
    assert length is not None
    assert length < 4


def test_the_cabin_is_among_what_moves(world: WorldKind) -> None:
    run = Run(tower((7, 3, 0)), world)
    table = Table(run.simulation)
    (lift,) = (number for number, mover in enumerate(table.movers) if mover.name == "Lift1")
    assert table.movers[lift].numbers == 4

    def cabin() -> list[float]:
        values: list[float] = table.row()[table.owners == lift].tolist()
        return values

    assert cabin() == [*CABIN, 0, 0]
    end = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.run_until(lambda: height(run, "Robot1") > 1)
    assert cabin() == [*CABIN, height(run, "Robot1"), 0]
    run.run_until(lambda: end)
    assert cabin() == [*CABIN, HEIGHT, 0]


def test_a_lift_that_is_put_on_the_map_is_used() -> None:
    whole = tower((2, 2, 0))
    without_lift = Map([object for object in whole.objects.values() if object.type not in ("Lift", "LiftDoor")])
    run = Run(without_lift, WorldKind.KINEMATIC)
    assert find_legs(run.simulation, "Robot1", ("Table2",)).lengths == (None,)
    for object in whole.objects.values():
        if object.name not in without_lift.objects:
            run.simulation.add(object)
    for fact in whole.facts():
        run.simulation.relate(FactAdded(fact))
    run.execute_all("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.simulation.relate(FactRemoved(Fact("stopsAt", ("Lift1", "Storey1"))))
    assert find_legs(run.simulation, "Robot1", ("Table1",)).lengths == (None,)
