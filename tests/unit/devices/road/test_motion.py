"""How long robots are expected to take for their ways."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from somrs.devices.road.motion import LEAST, MOST, TRIP, TURN, Experience, Motion

MOTION = Motion(acceleration=0.5, turning=1.0, settling=0.5)
TURNS_AT_ENDS = 2 * (TURN / 1.0 + 0.5)

points = st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), max_size=12)


def test_a_straight_way_takes_its_length_at_full_speed_and_the_time_to_set_off_and_stop() -> None:
    time = MOTION.time([(0, 0), (4, 0), (10, 0)], 0.5)
    assert math.isclose(time, TRIP + TURNS_AT_ENDS + 10 / 0.5 + 0.5 / 0.5)


def test_a_short_way_ends_before_full_speed() -> None:
    """It accelerates for half of it, and brakes for the other half."""
    assert math.isclose(MOTION.time([(0, 0), (0.5, 0)], 2.0), TRIP + TURNS_AT_ENDS + 2 * math.sqrt(0.5 / 0.5))


def test_a_corner_costs_a_stop_and_a_turn() -> None:
    straight, bent = MOTION.time([(0, 0), (4, 0), (8, 0)], 0.5), MOTION.time([(0, 0), (4, 0), (4, 4)], 0.5)
    assert math.isclose(bent - straight, 0.5 / 0.5 + math.pi / 2 + 0.5)


def test_who_rounds_corners_is_slower_there_and_does_not_stop() -> None:
    rounding = Motion(acceleration=0.5, turning=1.0, settling=0.5, rounds_corners=True)
    right_angle, bend = [(0, 0), (4, 0), (4, 4)], [(0, 0), (4, 0), (8, 2)]
    assert rounding.time(bend, 0.5) < rounding.time(right_angle, 0.5) < MOTION.time(right_angle, 0.5)
    assert math.isclose(rounding.time(right_angle, 0.5) - rounding.time([(0, 0), (8, 0)], 0.5), 0.5 / 0.5)


def test_who_is_there_takes_no_time() -> None:
    assert MOTION.time([], 0.5) == MOTION.time([(1, 1)], 0.5) == MOTION.time([(1, 1), (1, 1)], 0.5) == 0.0


@given(points, st.floats(0.1, 3))
def test_no_way_is_driven_faster_than_at_full_speed(places: list[tuple[float, float]], speed: float) -> None:
    assert MOTION.detour(places, speed) >= -1e-6


def test_a_robot_is_as_fast_as_the_map_says_if_it_is_not_slower() -> None:
    assert Motion(speed=0.5).speed_on(0.8) == 0.5
    assert Motion(speed=1.2).speed_on(0.8) == 0.8
    assert Motion().speed_on(0.8) == 0.8


def test_a_robot_learns_how_long_it_takes() -> None:
    experience = Experience()
    for _ in range(20):
        experience.learn(reckoned=20, taken=30)
    assert abs(experience.ratio - 1.5) < 0.01


@given(st.lists(st.tuples(st.floats(0, 1000), st.floats(0, 10_000))))
def test_what_is_learned_is_bounded(trips: list[tuple[float, float]]) -> None:
    experience = Experience()
    for reckoned, taken in trips:
        experience.learn(reckoned, taken)
    assert LEAST <= experience.ratio <= MOST


def test_a_trip_of_no_length_teaches_nothing() -> None:
    experience = Experience()
    experience.learn(reckoned=0.0, taken=2.0)
    assert experience.ratio == 1.0
