"""Pioneer robots come to where they are sent: within 5 cm and 3 degrees, through lost bytes, and around nothing that is in the way."""

from __future__ import annotations

import itertools
import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from somrs.adapters.arcos.events import ActionDone, Broken, Follow, GaveUp, Passed, TurnTo
from somrs.adapters.arcos.odometry import wrap
from somrs.adapters.arcos.simulated.body import Obstacle
from tests.support.pioneers import Pioneer, damaged, way

POINTS = st.tuples(st.floats(-4, 4), st.floats(-4, 4))


@pytest.mark.parametrize("subclass", ["p3dx", "p3dx-sh"])
def test_a_robot_drives_along_its_way_and_stops_at_its_end(subclass: str) -> None:
    pioneer = Pioneer(1.0, 0.8, math.pi / 2, subclass=subclass).ready()
    assert pioneer.drive(way((1.0, 0.8), (3.0, 0.8), (3.0, 4.0)))
    assert pioneer.distance_to(3.0, 4.0) < 0.05
    assert [effect.number for effect in pioneer.effects if isinstance(effect, Passed)] == [2, 3]


@settings(max_examples=60, deadline=None)
@given(POINTS, st.floats(-math.pi, math.pi), st.lists(POINTS, min_size=1, max_size=4))
def test_every_goal_is_reached_within_five_centimetres(start: tuple[float, float], yaw: float, points: list[tuple[float, float]]) -> None:
    pioneer = Pioneer(*start, yaw).ready()
    assert pioneer.drive(way(start, *points))
    assert pioneer.distance_to(*points[-1]) < 0.05


@settings(max_examples=60, deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(-10, 10))
def test_every_turn_ends_within_three_degrees(yaw: float, goal: float) -> None:
    pioneer = Pioneer(yaw=yaw).ready()
    assert isinstance(pioneer.act(TurnTo(goal)), ActionDone)
    assert abs(wrap(pioneer.body.place.yaw - goal)) < math.radians(3)
    assert pioneer.distance_to(0, 0) < 0.01


def test_a_robot_stays_on_the_lines_of_its_way() -> None:
    points = ((0.0, 0.0), (2.0, 0.2), (4.0, 0.0), (4.0, 2.0))
    pioneer = Pioneer().ready()
    pioneer.give(Follow(way(*points)))
    farthest = 0.0
    for _ in range(3000):
        pioneer.run(0.02)
        place = pioneer.body.place
        farthest = max(farthest, min(_distance((place.x, place.y), *line) for line in itertools.pairwise(points)))
    assert pioneer.distance_to(4.0, 2.0) < 0.05
    assert farthest < 0.06


def _distance(point: tuple[float, float], start: tuple[float, float], end: tuple[float, float]) -> float:
    dx, dy = end[0] - start[0], end[1] - start[1]
    share = ((point[0] - start[0]) * dx + (point[1] - start[1]) * dy) / (dx * dx + dy * dy)
    share = min(1.0, max(0.0, share))
    return math.dist(point, (start[0] + share * dx, start[1] + share * dy))


def test_what_is_not_released_is_not_driven() -> None:
    pioneer = Pioneer().ready()
    points = ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 0.0))
    assert pioneer.drive(way(*points, released=2))
    pioneer.run(20)
    assert pioneer.distance_to(1.0, 0.0) < 0.05
    pioneer.give(Follow(way(*points[1:], released=3, start=2)))
    assert pioneer.run(60, lambda: Passed(4) in pioneer.effects and pioneer.stands())
    assert pioneer.distance_to(3.0, 0.0) < 0.05


def test_a_robot_does_not_stop_where_more_is_released_in_time() -> None:
    pioneer = Pioneer().ready()
    points = ((0.0, 0.0), (2.0, 0.0), (4.0, 0.0))
    pioneer.give(Follow(way(*points, released=2)))
    assert pioneer.run(20, lambda: pioneer.body.place.x > 0.8)
    pioneer.give(Follow(way(*points)))
    assert pioneer.run(20, lambda: pioneer.body.place.x > 1.9)
    assert not pioneer.run(10, lambda: pioneer.stands() and pioneer.body.place.x < 3.9)
    assert pioneer.distance_to(4.0, 0.0) < 0.05


def test_the_way_may_change_and_lead_back() -> None:
    pioneer = Pioneer().ready()
    pioneer.give(Follow(way((0.0, 0.0), (2.0, 0.0), (4.0, 0.0))))
    assert pioneer.run(30, lambda: Passed(2) in pioneer.effects)
    assert pioneer.drive(way((2.0, 0.0), (4.0, 0.0), (2.0, 0.0), (2.0, 1.0), start=2))
    assert pioneer.distance_to(2.0, 1.0) < 0.05


def test_a_robot_drives_backwards_where_it_has_to() -> None:
    pioneer = Pioneer().ready()
    assert pioneer.drive(way((0.0, 0.0), (-2.0, 0.0), travel="Backward"))
    assert pioneer.distance_to(-2.0, 0.0) < 0.05
    assert abs(wrap(pioneer.body.place.yaw)) < math.radians(3)


def test_a_robot_turns_to_the_heading_that_it_is_to_have_at_its_stop() -> None:
    pioneer = Pioneer().ready()
    *points, stop = way((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    assert pioneer.drive((*points, replace(stop, yaw=-2.0)))
    assert pioneer.distance_to(1.0, 1.0) < 0.05
    assert abs(wrap(pioneer.body.place.yaw + 2.0)) < math.radians(3)


def test_a_heading_of_a_place_on_the_way_does_not_matter() -> None:
    pioneer = Pioneer().ready()
    start, middle, stop = way((0.0, 0.0), (1.0, 0.0), (2.0, 0.0))
    assert pioneer.drive((start, replace(middle, yaw=math.pi), stop), 12)
    assert abs(wrap(pioneer.body.place.yaw)) < math.radians(3)


def test_a_robot_keeps_to_the_speed_limit() -> None:
    pioneer = Pioneer().ready()
    pioneer.give(Follow(tuple(replace(waypoint, speed_limit=0.15) for waypoint in way((0.0, 0.0), (2.0, 0.0)))))
    fastest = 0.0
    while not pioneer.run(0.1, lambda: Passed(2) in pioneer.effects):
        fastest = max(fastest, pioneer.firmware.velocity[0])
    assert 140 < fastest <= 151


def test_a_told_halt_stops_the_robot_within_its_braking_distance() -> None:
    pioneer = Pioneer().ready()
    pioneer.give(Follow(way((0.0, 0.0), (4.0, 0.0))))
    assert pioneer.run(20, lambda: pioneer.body.place.x > 1.0)
    pioneer.halt()
    assert pioneer.stands()
    assert pioneer.body.place.x < 1.6
    pioneer.run(10)
    assert pioneer.body.place.x < 1.6


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_lost_and_damaged_bytes_delay_a_robot_and_do_no_harm(seed: int) -> None:
    """One byte of two hundred is lost or damaged in each direction."""
    chance = random.Random(seed)
    pioneer = Pioneer().ready()
    pioneer.to_robot = pioneer.from_robot = lambda data: damaged(data, chance, 0.005)
    pioneer.give(Follow(way((0.0, 0.0), (2.0, 0.0), (2.0, 1.5))))
    assert pioneer.run(240, lambda: Passed(3) in pioneer.effects and pioneer.stands())
    assert pioneer.distance_to(2.0, 1.5) < 0.06
    assert not [effect for effect in pioneer.effects if isinstance(effect, GaveUp | Broken)]


def test_a_robot_stops_for_what_stands_in_its_way_and_goes_on_when_it_is_gone() -> None:
    pioneer = Pioneer().ready()
    pioneer.body.obstacles = (Obstacle(x=2.0, y=0.1, radius=0.2),)
    pioneer.give(Follow(way((0.0, 0.0), (4.0, 0.0))))
    assert pioneer.run(30, lambda: pioneer.body.place.x > 0.9 and pioneer.stands())
    assert pioneer.body.place.x < 2.0 - 0.2 - 0.25
    assert pioneer.body.contact is None
    pioneer.body.obstacles = ()
    assert pioneer.run(60, lambda: Passed(2) in pioneer.effects)


def test_a_robot_says_what_is_in_its_way() -> None:
    pioneer = Pioneer().ready()
    pioneer.body.obstacles = (Obstacle(x=2.0, y=0.1, radius=0.2),)
    pioneer.give(Follow(way((0.0, 0.0), (4.0, 0.0))))
    assert pioneer.run(60, lambda: any(isinstance(effect, GaveUp) for effect in pioneer.effects))
    (refusal,) = [effect for effect in pioneer.effects if isinstance(effect, GaveUp)]
    assert "in the way" in refusal.description
    assert pioneer.body.contact is None
    position = pioneer.body.place.x
    pioneer.run(10)
    assert pioneer.body.place.x == position


def test_a_robot_drives_up_to_what_stands_beyond_its_goal() -> None:
    """A stand at a table is as near to it as the robot's radius."""
    pioneer = Pioneer().ready()
    pioneer.body.obstacles = (Obstacle(x=2.0 + 0.3 + 0.25 + 0.02, y=0.0, radius=0.3),)
    assert pioneer.drive(way((0.0, 0.0), (2.0, 0.0)))
    assert pioneer.distance_to(2.0, 0.0) < 0.05


def test_an_obstacle_beside_the_way_is_passed() -> None:
    pioneer = Pioneer().ready()
    pioneer.body.obstacles = (Obstacle(x=1.0, y=0.6, radius=0.2), Obstacle(x=1.0, y=-0.6, radius=0.2))
    assert pioneer.drive(way((0.0, 0.0), (2.0, 0.0)))


def test_a_robot_drives_through_doorways() -> None:
    """Sonar hears the posts of a door that is 0.9 m wide in front of the robot, and not beside it."""
    posts = tuple(Obstacle(x=2.0, y=side * (0.45 + 0.1 + 0.2 * index), radius=0.1) for side in (-1, 1) for index in range(8))
    pioneer = Pioneer(obstacles=posts).ready()
    assert pioneer.drive(way((0.0, 0.0), (4.0, 0.0)), 30)
    assert pioneer.distance_to(4.0, 0.0) < 0.05


def test_wheels_slip_and_the_robot_is_near_its_goal_all_the_same() -> None:
    pioneer = Pioneer(slip=0.02).ready()
    assert pioneer.drive(way((0.0, 0.0), (3.0, 0.0), (3.0, 2.0)))
    assert pioneer.distance_to(3.0, 2.0) < 0.05
