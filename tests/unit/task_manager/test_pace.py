"""Time limits follow how late everybody is, and not one alone."""

from __future__ import annotations

from somrs.task_manager.pace import REMEMBERED, Pace


def test_on_an_idle_system_limits_are_as_they_are() -> None:
    pace = Pace()
    assert (pace.answer_time(10.0), pace.silence(20.0), pace.stretch(30.0)) == (10.0, 20.0, 30.0)
    for _ in range(REMEMBERED):
        pace.answered(0.2)
        pace.heard(5.0)
        pace.completed(29.0, 30.0)
    assert (pace.answer_time(10.0), pace.silence(20.0), pace.stretch(30.0)) == (10.0, 20.0, 30.0)


def test_when_all_are_late_limits_are_longer() -> None:
    pace = Pace()
    for _ in range(5):
        pace.answered(6.0)
        pace.heard(15.0)
        pace.completed(60.0, 20.0)
    assert (pace.answer_time(10.0), pace.silence(20.0), pace.stretch(30.0)) == (24.0, 45.0, 90.0)


def test_one_that_is_slow_among_many_changes_nothing() -> None:
    pace = Pace()
    for delay in (0.2, 0.3, 90.0, 0.2, 0.1):
        pace.answered(delay)
    assert pace.answer_time(10.0) == 10.0


def test_what_was_long_ago_is_forgotten() -> None:
    pace = Pace()
    for _ in range(REMEMBERED):
        pace.answered(30.0)
    for _ in range(REMEMBERED):
        pace.answered(0.1)
    assert pace.answer_time(10.0) == 10.0
    assert len(pace.answers) == REMEMBERED


def test_work_that_was_promised_to_take_no_time_is_no_measure() -> None:
    pace = Pace()
    for _ in range(5):
        pace.completed(5.0, 0.0)
    assert pace.stretch(30.0) == 30.0
