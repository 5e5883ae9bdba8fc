"""Things of the map that a robot does not see any more are gone; those that it cannot see, or that a robot may hold, are not."""

from __future__ import annotations

from somrs.adapters.mapping.expected import ExpectedThings
from somrs.devices.simulator.link.commands import CommandDone, Point, RobotState, Sighting

STATE = RobotState(time=0.0, x=0.0, y=0.0, yaw=0.0, holding=None, activity=None, faults=())


def _things() -> ExpectedThings:
    return ExpectedThings({"Jar1": Point(x=1.0, y=0.0, z=0.8), "Jar2": Point(x=5.0, y=0.0, z=0.8)})


def _view(*sightings: Sighting, clear: tuple[int, ...]) -> CommandDone:
    return CommandDone(state=STATE, sightings=sightings, clear=clear)


def _sighting(x: float, *, robot: bool = False) -> Sighting:
    return Sighting(type="Jar", x=x, y=0.0, z=0.75, yaw=0.0, robot=robot)


def test_a_thing_whose_place_is_clear_and_empty_in_two_looks_is_gone() -> None:
    things = _things()
    assert things.gone(_view(clear=(0,))) == []
    assert things.gone(_view(clear=())) == []
    assert things.gone(_view(clear=(0,))) == ["Jar1"]
    assert things.points == (Point(x=5.0, y=0.0, z=0.8),)
    assert things.gone(_view(clear=())) == []


def test_a_thing_that_is_seen_in_between_is_not_gone() -> None:
    things = _things()
    views = [_view(clear=(0,)), _view(_sighting(1.1), clear=(0,)), _view(clear=(0,))]
    assert [things.gone(view) for view in views] == [[], [], []]


def test_a_thing_beside_a_robot_may_be_in_its_hand() -> None:
    things = _things()
    assert [things.gone(_view(_sighting(2.2, robot=True), clear=(0,))) for _ in range(3)] == [[], [], []]
