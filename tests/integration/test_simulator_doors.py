"""Robots open and close doors and containers by their handles, and put things into containers and take them out."""

from __future__ import annotations

import math

import pytest

from somrs.devices.simulator.link.commands import (
    Charge,
    Close,
    Command,
    CommandDone,
    CommandGivenUp,
    DriveTo,
    Fault,
    Grip,
    Insert,
    Open,
    Place,
    Stop,
)
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.space.leaves import leaves_of
from tests.support.simulator_room import Run, box, robot, shell, thing


def _two_rooms(*extra: Object, door_open: bool = False) -> Map:
    """Two rooms with a door between them, and a robot in the left room."""
    walls = [box("WallA", "Wall", (4, 1.1, 0), (0.1, 2.2, 2.5)), box("WallB", "Wall", (4, 4.8, 0), (0.1, 2.4, 2.5))]
    door = box("Door1", "Door", (4, 2.9, 0), (0.1, 1.4, 2.1), Open=door_open)
    return Map([*shell(), *walls, door, robot("Robot1", (1.5, 1.5, 0.0), 0.8), *extra])


def _cupboard(y: float = 4.0, **values: bool | float) -> Object:
    return box("Cupboard1", "Cupboard", (0.3, y, 0), (0.5, 1.2, 0.8), **values)


def _done(run: Run, command: Command, robot: str = "Robot1") -> CommandDone:
    end = run.execute(robot, command)
    assert isinstance(end, CommandDone), end
    return end


def _is_open(run: Run, owner: str) -> bool:
    return run.simulation.observe(owner).open is True


def test_a_shut_door_is_opened_passed_and_closed_from_the_other_side(world: WorldKind) -> None:
    run = Run(_two_rooms(), world)
    end = run.execute("Robot1", DriveTo(x=6, y=3))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "unreachable", "a shut door is an obstacle"
    end = _done(run, Open(object="Door1"))
    (state,) = end.object_states
    assert (state.object, state.open) == ("Door1", True)
    run.execute_all("Robot1", DriveTo(x=6, y=3), Close(object="Door1"))
    assert not _is_open(run, "Door1")
    assert run.simulation.state("Robot1").x > 4, "it closed the door from the side on which it was"
    end = run.execute("Robot1", DriveTo(x=1.5, y=1.5))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "unreachable"
    assert not run.collisions


def test_a_container_is_opened_and_closed(world: WorldKind) -> None:
    run = Run(_two_rooms(_cupboard()), world)
    leaves = run.simulation.scene.leaves("Cupboard1")
    _done(run, Open(object="Cupboard1"))
    assert _is_open(run, "Cupboard1")
    assert all(leaf.is_open(run.simulation.scene.leaf_position(leaf)) for leaf in leaves)
    _done(run, Close(object="Cupboard1"))
    assert not _is_open(run, "Cupboard1")
    assert all(leaf.is_shut(run.simulation.scene.leaf_position(leaf)) for leaf in leaves)
    assert not run.collisions


@pytest.mark.parametrize(
    ("size", "place", "yaw"),
    [((0.4, 0.5, 1.8), (0.25, 3.0), 0.0), ((0.6, 1.6, 0.9), (2.0, 5.65), -math.pi / 2), ((0.5, 1.0, 1.2), (3.65, 4.9), math.pi)],
    ids=["tall and narrow", "wide", "in a corner"],
)
def test_containers_of_other_sizes_are_opened(
    size: tuple[float, float, float], place: tuple[float, float], yaw: float, world: WorldKind
) -> None:
    run = Run(_two_rooms(box("Cupboard1", "Cupboard", (*place, 0), size, RotationZ=yaw)), world)
    run.execute_all("Robot1", Open(object="Cupboard1"), Close(object="Cupboard1"))
    assert not run.collisions


def test_things_are_put_into_an_open_container_and_taken_out(world: WorldKind) -> None:
    table = box("Table1", "Table", (2.5, 5.4, 0), (1.4, 0.8, 0.74))
    run = Run(
        _two_rooms(_cupboard(Open=True), table, thing("Carton1", "Carton", 2.3, 5.2, 0.74), thing("Jar1", "Jar", 0.4, 4.2, 0.06)), world
    )
    run.execute_all("Robot1", Grip(object="Carton1"), Insert(container="Cupboard1"))
    assert run.simulation.observe("Carton1").container == "Cupboard1"
    run.execute_all("Robot1", Grip(object="Jar1"), Place(support="Table1"))
    assert run.simulation.observe("Jar1").support == "Table1"
    assert not run.collisions


def test_nothing_is_taken_out_of_a_shut_container_or_put_into_it(world: WorldKind) -> None:
    run = Run(_two_rooms(_cupboard(), thing("Jar1", "Jar", 0.4, 4.2, 0.06), thing("Jar2", "Jar", 0.4, 3.8, 0.8)), world)
    end = run.execute("Robot1", Grip(object="Jar1"))
    assert isinstance(end, CommandGivenUp)
    assert (end.reason, end.description) == ("shut", "Cupboard1 is shut")
    _done(run, Grip(object="Jar2"))
    end = run.execute("Robot1", Insert(container="Cupboard1"))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "shut"
    end = run.execute("Robot1", Open(object="Cupboard1"))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "holding"


def test_a_robot_that_is_stopped_lets_the_handle_go_and_says_whether_it_is_open(world: WorldKind) -> None:
    run = Run(_two_rooms(), world)
    ends = run.start("Robot1", Open(object="Door1"))
    (leaf,) = run.simulation.scene.leaves("Door1")
    run.run_until(lambda: run.simulation.scene.leaf_position(leaf) > 0.3)
    (state,) = _done(run, Stop()).object_states
    assert (state.object, state.open) == ("Door1", False)
    assert isinstance(ends[0], CommandGivenUp)
    assert ends[0].reason == "stopped"
    assert not run.simulation.scene.hands.pulled
    _done(run, Open(object="Door1"))
    assert _is_open(run, "Door1"), "it goes on from where the door is"


def test_a_door_does_not_close_on_a_robot_or_a_thing(world: WorldKind) -> None:
    run = Run(_two_rooms(thing("Jar1", "Jar", 4.0, 2.9, 0.0), door_open=True), world)
    end = run.execute("Robot1", Close(object="Door1"))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "blocked"
    assert "Jar1 stands in the way" in end.description
    run = Run(_two_rooms(robot("Robot2", (4.0, 2.9, 0.0)), door_open=True), world)
    run.simulation.linked.set_paused("Robot2", True)
    run.start("Robot1", Close(object="Door1"))
    run.run_until(lambda: run.simulation.time > 30)
    assert _is_open(run, "Door1")
    run.simulation.linked.set_paused("Robot2", False)  # so that it makes room
    _done(run, Close(object="Door1"))
    assert not _is_open(run, "Door1")
    assert not run.collisions


def test_only_robots_with_a_gripper_move_doors_and_only_doors_move(world: WorldKind) -> None:
    patrol = robot("Patrol1", (2.5, 1.5, 0.0), type="PatrolRobot")
    run = Run(_two_rooms(patrol, box("Table1", "Table", (2.5, 5.4, 0), (1.4, 0.8, 0.74))), world)
    for name, object, reason in (
        ("Patrol1", "Door1", "not-possible"),
        ("Robot1", "Table1", "not-possible"),
        ("Robot1", "It", "unknown-object"),
    ):
        end = run.execute(name, Open(object=object))
        assert isinstance(end, CommandGivenUp)
        assert end.reason == reason


def test_the_map_opens_and_closes_doors_too(world: WorldKind) -> None:
    run = Run(_two_rooms(_cupboard(), thing("Jar1", "Jar", 0.4, 4.2, 0.06)), world)
    run.simulation.renew(_cupboard(Open=True))
    assert _is_open(run, "Cupboard1")
    run.execute_all("Robot1", Grip(object="Jar1"))
    for leaf in leaves_of(run.simulation.scene.world.solids["Cupboard1"]):
        assert leaf.is_open(run.simulation.scene.leaf_position(leaf))


def test_a_battery_is_used_by_driving_and_filled_at_a_charger(world: WorldKind) -> None:
    charger = thing("Charger1", "Charger", 3.0, 1.0, 0.0)
    run = Run(_two_rooms(charger, robot("Robot2", (2.0, 3.0, 0.0), Charge=99.0)), world)
    _done(run, DriveTo(x=1.5, y=4.5), "Robot2")
    used = 99.0 - (run.simulation.state("Robot2").charge or 0.0)
    assert used == pytest.approx(0.02 * math.dist((2.0, 3.0), (1.5, 4.5)) + 0.005 * math.pi, abs=0.02)
    end = run.execute("Robot2", Charge())
    assert isinstance(end, CommandGivenUp)
    assert end.description == "Robot2 does not stand at a charger"
    _done(run, DriveTo(x=3.0, y=1.0), "Robot2")
    assert _done(run, Charge(), "Robot2").state.charge == pytest.approx(100.0, abs=0.001)


def test_an_empty_battery_stops_a_robot(world: WorldKind) -> None:
    run = Run(Map([*shell(), robot("Robot1", (1.5, 1.5, 0.0), Charge=0.01)]), world)
    end = run.execute("Robot1", DriveTo(x=6, y=4))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "battery-empty"


def _powered_door(**values: bool) -> Map:
    walls = [box("WallA", "Wall", (4, 1.1, 0), (0.1, 2.2, 2.5)), box("WallB", "Wall", (4, 4.8, 0), (0.1, 2.4, 2.5))]
    door = box("Door1", "PoweredDoor", (4, 2.9, 0), (0.1, 1.4, 2.1), **values)
    return Map([*shell(), *walls, door, robot("Robot1", (1.5, 2.9, 0.0), 0.8)])


def test_a_powered_door_opens_and_closes_itself(world: WorldKind) -> None:
    run = Run(_powered_door(Open=False), world)
    _done(run, Open(object="Door1"), "Door1")
    assert _is_open(run, "Door1")
    run.execute_all("Robot1", DriveTo(x=6, y=3))
    _done(run, Close(object="Door1"), "Door1")
    assert not _is_open(run, "Door1")
    end = run.execute("Robot1", DriveTo(x=1.5, y=2.9))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "unreachable"
    end = run.execute("Robot1", Open(object="Door1"))
    assert isinstance(end, CommandGivenUp)
    assert end.description == "Door1 has a drive, which opens and closes it"


def test_a_powered_door_waits_for_robots_in_the_doorway(world: WorldKind) -> None:
    run = Run(_powered_door(Open=True), world)
    _done(run, DriveTo(x=4, y=2.9))
    run.start("Door1", Close(object="Door1"))
    run.run_until(lambda: run.simulation.time > 20)
    assert _is_open(run, "Door1")
    _done(run, DriveTo(x=6, y=4))
    run.run_until(lambda: not _is_open(run, "Door1"))
    assert not run.collisions


def test_a_powered_door_stops_where_it_is(world: WorldKind) -> None:
    run = Run(_powered_door(Open=False), world)
    (leaf,) = run.simulation.scene.leaves("Door1")
    ends = run.start("Door1", Open(object="Door1"))
    run.run_until(lambda: run.simulation.scene.leaf_position(leaf) > 0.5)
    run.simulation.fault("Door1", Fault.DRIVE)
    (end,) = ends
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "drive-dead"
    position = run.simulation.scene.leaf_position(leaf)
    run.run_for(2)
    assert run.simulation.scene.leaf_position(leaf) == pytest.approx(position, abs=0.02)
    assert not _is_open(run, "Door1")
