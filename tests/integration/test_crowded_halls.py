"""Trips across halls in which many robots stand at tables: none waits for long behind those that only stand there."""

from __future__ import annotations

import pytest

from tests.support.halls import Crowd, Hall

HALL = Hall(side=48.0, aisle=4.0)
ROOMS = Hall(side=24.0, aisle=4.0, has_wall=True)
"""Two rooms with one door."""
NARROW = Hall(side=24.0, aisle=2.4)
"""Between its tables, two robots pass each other only in places, so that ways are searched for."""
BUSY = Hall(side=24.0, aisle=4.0)
LONGEST = 300.0
SLOW = pytest.mark.slow
"""For crowds that show nothing else than the first one."""


@pytest.mark.parametrize("seed", [3, pytest.param(5, marks=SLOW)])
def test_the_last_trips_among_two_hundred_robots_take_little_longer_than_alone(seed: int) -> None:
    journeys = Crowd(HALL, robots=200, travellers=12, trips=2, work=5.0, seed=seed).run(LONGEST)
    assert len(journeys) == 24
    assert [journey for journey in journeys if journey.seconds > 1.5 * journey.alone + 15.0] == []


@pytest.mark.parametrize("seed", [2, pytest.param(6, marks=SLOW)])
def test_robots_come_through_a_door_between_two_rooms_with_many_others(seed: int) -> None:
    journeys = Crowd(ROOMS, robots=60, travellers=10, trips=2, work=5.0, seed=seed).run(LONGEST)
    assert len(journeys) == 20
    assert [journey for journey in journeys if journey.seconds > 1.5 * journey.alone + 15.0] == []


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=SLOW) for seed in range(1, 20))])
def test_robots_at_the_same_tables_do_not_shut_each_other_in(seed: int) -> None:
    """Each is in the way of others, which go to points between those at which they stand."""
    journeys = Crowd(BUSY, robots=50, travellers=50, trips=2, work=5.0, seed=seed, busy_tables=10).run(LONGEST)
    assert len(journeys) == 100
    assert max(journey.seconds for journey in journeys) < 90.0


def test_others_go_on_while_robots_follow_ways_that_were_searched_for() -> None:
    journeys = Crowd(NARROW, robots=60, travellers=10, trips=2, work=5.0, seed=1).run(LONGEST)
    assert len(journeys) == 20
    assert sum(journey.seconds for journey in journeys) < 1.5 * sum(journey.alone for journey in journeys)
