"""How far a robot would have to drive, in the situation in which it is to start."""

from __future__ import annotations

import math

import pytest

from somrs.devices.simulator.link.commands import Approach, CommandDone
from somrs.devices.simulator.link.lines import Legs
from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.protocol.messages.traffic import EnterTraffic, LeaveTraffic, Mobility, TrafficEntered
from tests.support.simulator_room import ONTOLOGY, Run, box, robot, shell, thing


def door(name: str, y: float, *, is_open: bool) -> Object:
    return box(name, "Door", (4, y, 0), (0.1, 1.2, 2.1), Open=is_open)


def two_rooms(*doors: Object) -> Simulation:
    """Two rooms with a wall between them, which has gaps for doors at y = 1.5 and y = 4.5. The robot and the jar are in different rooms."""
    walls = [
        box("WallA", "Wall", (4, 0.45, 0), (0.1, 0.9, 2.5)),
        box("WallB", "Wall", (4, 3.0, 0), (0.1, 1.8, 2.5)),
        box("WallC", "Wall", (4, 5.55, 0), (0.1, 0.9, 2.5)),
    ]
    furniture = [
        box("Table1", "Table", (7.5, 3, 0), (0.6, 1, 0.7)),
        box("Table2", "Table", (1, 5.5, 0), (1, 0.6, 0.7)),
        thing("Jar1", "Jar", 7.35, 3, 0.7),
    ]
    return Simulation(Map([*shell(), *walls, *doors, *furniture, robot("Robot1", (1, 1.5, 0))]), ONTOLOGY)


BOTH_SHUT = (door("Door1", 1.5, is_open=False), door("Door2", 4.5, is_open=False))


def legs(simulation: Simulation, situation: str | None, *stops: str) -> Legs:
    return find_legs(simulation, "Robot1", stops or ("Jar1",), situation)


def test_a_door_that_will_be_open_is_driven_through() -> None:
    simulation = two_rooms(*BOTH_SHUT)
    through_first = legs(simulation, "Door1.Open = TRUE")
    through_second = legs(simulation, "Door2.Open = TRUE")
    assert (through_first.shut, through_second.shut) == ((), ())
    (near,), (far,) = through_first.lengths, through_second.lengths
    assert near is not None
    assert far is not None
    assert near < far - 1
    assert legs(simulation, None).shut == ("Door1",), "nothing has changed in the world"


def test_a_robot_of_another_make_is_in_the_way_if_it_does_not_move() -> None:
    simulation = two_rooms(door("Door1", 1.5, is_open=True), door("Door2", 4.5, is_open=True))
    office = simulation.shared_traffic.office
    (near,), (far,) = legs(simulation, None).lengths, legs(simulation, "Door1.Open = FALSE").lengths
    place = min(office.roadmap.roadmap.places, key=lambda place: math.dist((place.x, place.y), (4, 1.5)))

    def enter(lease: float, mobility: Mobility = Mobility.FREE) -> None:
        answer = office.tell("Foreigner", EnterTraffic(robot="Foreigner", place=place.name, lease=lease, mobility=mobility))
        assert isinstance(answer, TrafficEntered), answer

    enter(1000.0)
    assert legs(simulation, None).lengths == (near,), "it makes room"
    enter(1000.0, Mobility.IMMOBILE)
    assert legs(simulation, None).lengths == (far,)
    enter(1.0)
    assert legs(simulation, None).lengths == (near,)
    while not office.component.state.robots["Foreigner"].silent:
        simulation.step()
    assert legs(simulation, None).lengths == (far,), "nobody knows whether it moves"
    office.tell("Foreigner", LeaveTraffic(robot="Foreigner"))
    assert legs(simulation, None).lengths == (near,)


def test_a_door_that_will_be_shut_is_in_the_way() -> None:
    simulation = two_rooms(door("Door1", 1.5, is_open=True), door("Door2", 4.5, is_open=True))
    (near,), (far,) = legs(simulation, None).lengths, legs(simulation, "Door1.Open = FALSE").lengths
    assert near is not None
    assert far is not None
    assert near < far - 1
    assert legs(simulation, "Door1.Open = FALSE AND Door2.Open = FALSE").shut == ("Door1",)


def test_the_shut_doors_on_the_only_way_are_named_and_counted_as_open() -> None:
    simulation = two_rooms(*BOTH_SHUT)
    there_and_back = legs(simulation, None, "Jar1", "Table2")
    through_second = legs(simulation, "Door2.Open = TRUE", "Jar1", "Table2").lengths
    assert there_and_back == Legs(lengths=through_second, shut=("Door2",)), "shorter with both doors, but one is enough"
    assert legs(simulation, None, "Table2").shut == (), "the table is in the same room"


def test_a_door_that_is_out_of_order_is_not_driven_through_and_named_if_there_is_no_other_way() -> None:
    simulation = two_rooms(door("Door1", 1.5, is_open=True), door("Door2", 4.5, is_open=True))
    (near,), (far,) = legs(simulation, None).lengths, legs(simulation, "Door1.Open = FALSE").lengths
    simulation.close_passages(("Door1",))
    assert legs(simulation, None) == Legs(lengths=(far,), open=("Door2",), carries=False)
    assert legs(simulation, "Door2.Open = FALSE").shut == ("Door2",)
    simulation.close_passages(("Door1", "Door2"))
    assert legs(simulation, None) == Legs(lengths=(None,), carries=False, out_of_order=("Door1", "Door2"))
    assert legs(simulation, None, "Table2").out_of_order == (), "the table is in the same room"
    simulation.close_passages(())
    assert legs(simulation, None).lengths == (near,)


def test_no_door_helps_where_there_is_no_way_at_all() -> None:
    simulation = two_rooms(*BOTH_SHUT)
    assert find_legs(simulation, "Robot1", ((30.0, 30.0),)) == Legs(lengths=(None,), out_of_reach=True)
    walled_in = two_rooms(box("Wall1", "Wall", (4, 1.5, 0), (0.1, 1.2, 2.5)), box("Wall2", "Wall", (4, 4.5, 0), (0.1, 1.2, 2.5)))
    assert not legs(walled_in, None).out_of_reach, "from where it would reach the jar there is room, but no way leads there"


def test_there_is_no_way_to_what_is_on_another_storey() -> None:
    upstairs = [
        box("UpperFloor", "Floor", (6, 3, 3), (4, 6, 0.02)),
        box("UpperTable", "Table", (7.5, 3, 3.02), (0.6, 1, 0.7)),
        box("UpperShelf", "Table", (6, 5, 3.02), (0.6, 0.6, 0.4)),
        thing("UpperJar", "Jar", 7.35, 3, 3.72),
    ]
    simulation = Simulation(
        Map([*shell(), *upstairs, box("Table1", "Table", (3, 5, 0), (0.6, 1, 0.7)), robot("Robot1", (6, 1.5, 0))]), ONTOLOGY
    )
    assert legs(simulation, None, "Table1").lengths != (None,)
    for stop in ("UpperFloor", "UpperTable", "UpperShelf", "UpperJar"):
        assert legs(simulation, None, stop) == Legs(lengths=(None,), carries=stop != "UpperJar"), stop
    assert legs(simulation, "UpperJar isOn Table1", "UpperJar").lengths == legs(simulation, None, "Table1").lengths


def test_what_will_have_been_moved_is_looked_for_where_it_will_be() -> None:
    simulation = two_rooms(*BOTH_SHUT)
    assert legs(simulation, "Jar1 isOn Table2").shut == ()
    assert legs(simulation, "Jar1 isOn Table2").lengths == legs(simulation, None, "Table2").lengths
    (at_point,) = legs(simulation, "Jar1.PositionX = 1.6 AND Jar1.PositionY = 1.5").lengths
    assert at_point is not None
    assert at_point < 1
    moved_robot = legs(simulation, "Robot1.PositionX = 6 AND Robot1.PositionY = 3")
    assert moved_robot.shut == ()
    assert moved_robot.lengths[0] is not None
    assert moved_robot.lengths[0] < 2


def test_a_situation_that_is_no_formula() -> None:
    with pytest.raises(UsageError, match="no formula"):
        legs(two_rooms(), "Jar1 isOn")


def test_there_is_a_way_only_to_what_the_robot_would_reach_when_it_is_there() -> None:
    """The quote looks for the same stands as the robot itself, which carries its arm above what it reaches over."""
    tables = [
        box("Table1", "Table", (2, 3, 0), (0.6, 0.6, 0.5)),
        box("Shelf1", "Bin", (2, 3.5, 0), (2.6, 0.3, 1.4)),
        box("Shelf2", "Bin", (2, 2.5, 0), (2.6, 0.3, 1.4)),
        box("Shelf3", "Bin", (0.85, 3, 0), (0.3, 0.7, 1.4)),
        box("Shelf4", "Bin", (2.75, 3, 0), (0.4, 0.7, 0.85)),
        box("Table2", "Table", (6, 3, 0), (0.6, 0.6, 0.5)),
    ]
    things = [thing("Jar1", "Jar", 2.0, 3.0, 0.5), thing("Jar2", "Jar", 6.0, 3.0, 0.5)]
    run = Run(Map([*shell(), *tables, *things, robot("Robot1", (4.5, 1.5, 0))]), WorldKind.KINEMATIC)
    for jar in ("Jar1", "Jar2"):
        there = find_legs(run.simulation, "Robot1", (jar,))
        (length,) = there.lengths
        assert there.out_of_reach == (length is None)
        result = run.execute("Robot1", Approach(object=jar))
        assert (length is not None) == isinstance(result, CommandDone), (jar, length, result)
    assert find_legs(run.simulation, "Robot1", ("Jar1",)).lengths == (None,)
