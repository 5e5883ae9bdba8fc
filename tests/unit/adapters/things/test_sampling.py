"""Of what things say, the map learns what is news to it, at the rate that it can use."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.things.sampling import Sampler

KEY = ("Sensor1", "Temperature")


def test_changes_within_the_dead_band_are_no_news() -> None:
    sampler = Sampler()
    sampler.offer(KEY, 20.0, 0, dead_band=0.5)
    assert sampler.take_due(0) == {KEY: 20.0}
    sampler.offer(KEY, 20.5, 1, dead_band=0.5)
    assert sampler.take_due(1) == {}
    sampler.offer(KEY, 20.6, 2, dead_band=0.5)
    assert sampler.take_due(2) == {KEY: 20.6}


def test_slow_changes_add_up_until_they_are_news() -> None:
    sampler = Sampler()
    reports: list[object] = []
    for step in range(11):
        sampler.offer(KEY, 20 + step * 0.25, step, dead_band=0.5)
        reports += sampler.take_due(step).values()
    assert reports == [20.0, 20.75, 21.5, 22.25]


def test_the_newest_value_is_reported_when_the_interval_is_over() -> None:
    sampler = Sampler()
    sampler.offer(KEY, 20.0, 0, interval=10)
    sampler.take_due(0)
    sampler.offer(KEY, 21.0, 3, interval=10)
    sampler.offer(KEY, 22.0, 4, interval=10)
    assert sampler.take_due(9.9) == {}
    assert sampler.next_due() == 10
    assert sampler.take_due(10) == {KEY: 22.0}
    assert sampler.next_due() is None


def test_a_value_that_comes_back_before_its_report_is_no_news() -> None:
    sampler = Sampler()
    sampler.offer(KEY, True, 0)
    sampler.take_due(0)
    sampler.offer(KEY, False, 1)
    sampler.offer(KEY, True, 2)
    assert sampler.take_due(3) == {}


def test_true_is_not_one() -> None:
    sampler = Sampler()
    sampler.offer(KEY, 1.0, 0, dead_band=2)
    sampler.take_due(0)
    sampler.offer(KEY, True, 1, dead_band=2)
    assert sampler.take_due(1) == {KEY: True}


readings = st.lists(st.tuples(st.floats(0.01, 30), st.floats(-50, 50)), min_size=1, max_size=60)


@given(readings, st.floats(0, 5), st.floats(0, 60))
def test_in_the_end_the_map_has_what_was_read_as_far_as_the_dead_band_allows(
    steps: list[tuple[float, float]], dead_band: float, interval: float
) -> None:
    sampler, now = Sampler(), 0.0
    times: list[float] = []
    on_map: float | None = None
    for pause, value in steps:
        now += pause
        sampler.offer(KEY, value, now, dead_band=dead_band, interval=interval)
        for reported in sampler.take_due(now).values():
            assert isinstance(reported, float)
            on_map = reported
            times.append(now)
    for reported in sampler.take_due(sampler.next_due() or now).values():
        assert isinstance(reported, float)
        on_map = reported
    assert on_map is not None
    assert abs(on_map - steps[-1][1]) <= dead_band
    assert all(later - earlier >= interval - 1e-9 for earlier, later in itertools.pairwise(times))


def test_the_same_news_waits_no_longer_when_it_comes_again() -> None:
    sampler = Sampler()
    for now in (5.0, 6.0, 7.0):
        sampler.offer(("Lamp1", "Problem"), "cannot be reached", now)
    assert sampler.next_due() == 5.0
