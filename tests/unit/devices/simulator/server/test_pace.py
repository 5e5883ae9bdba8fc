"""A simulation that is too slow says so once, and again only after it was fast enough."""

from __future__ import annotations

import pytest

from somrs.devices.simulator.server.pace import WINDOW, Pace


def test_only_the_first_slow_window_is_told() -> None:
    pace, simulated, told = Pace(speed=2.0), 0.0, list[tuple[int, float]]()
    for window, actual_speed in enumerate((2.0, 1.5, 1.0, 0.5, 2.0, 0.1, 0.1)):
        for tenth in range(10):
            speed = pace.measure((window + tenth / 10) * WINDOW, simulated)
            if speed is not None:
                told.append((window - 1, speed))
            simulated += actual_speed * WINDOW / 10
    assert [window for window, _ in told] == [2, 5]
    assert [speed for _, speed in told] == pytest.approx([1.0, 0.1])


def test_a_simulation_in_time_says_nothing() -> None:
    pace = Pace(speed=1.0)
    assert [pace.measure(now, now) for now in range(100)] == [None] * 100
