"""When standing orders are due: held against walking through every minute, over changes of the clock."""

from __future__ import annotations

from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import UsageError
from somrs.protocol.messages.orders import Daily, Every, Once, Schedule
from somrs.scheduling.recurrence import check_recurrence, due_after, due_between, in_words

WARSAW = ZoneInfo("Europe/Warsaw")
MINUTE = 60.0


def stamp(text: str, zone: ZoneInfo = WARSAW) -> float:
    return datetime.fromisoformat(text).replace(tzinfo=zone).timestamp()


def dues(recurrence: Schedule, start: str, count: int) -> list[str]:
    times, time = list[str](), stamp(start)
    while len(times) < count and (due := due_after(recurrence, time, WARSAW)) is not None:
        times.append(f"{datetime.fromtimestamp(due, WARSAW):%a %m-%d %H:%M}")
        time = due
    return times


def test_on_chosen_days_at_a_time_of_day() -> None:
    assert dues(Daily(at="07:30", days=(0, 2)), "2026-11-23T07:30", 3) == ["Wed 11-25 07:30", "Mon 11-30 07:30", "Wed 12-02 07:30"]
    assert dues(Daily(at="07:30", days=(0,)), "2026-11-23T07:29:59", 1) == ["Mon 11-23 07:30"]
    assert dues(Daily(at="07:30"), "2026-11-23T08:00", 2) == ["Tue 11-24 07:30", "Wed 11-25 07:30"]


def test_it_stays_the_same_time_of_day_when_the_clock_changes() -> None:
    assert dues(Daily(at="08:00"), "2026-03-28T00:00", 3) == ["Sat 03-28 08:00", "Sun 03-29 08:00", "Mon 03-30 08:00"]
    assert dues(Daily(at="08:00"), "2026-10-24T00:00", 3) == ["Sat 10-24 08:00", "Sun 10-25 08:00", "Mon 10-26 08:00"]


def test_a_time_that_the_clock_skips_comes_once_all_the_same_and_one_that_it_shows_twice_only_once() -> None:
    assert dues(Daily(at="02:30"), "2026-03-28T12:00", 2) == ["Sun 03-29 03:30", "Mon 03-30 02:30"]
    assert dues(Daily(at="02:30"), "2026-10-24T12:00", 2) == ["Sun 10-25 02:30", "Mon 10-26 02:30"]


def test_every_so_often_is_counted_from_the_beginning() -> None:
    begin = stamp("2026-11-23T08:00")
    recurrence = Every(minutes=90, since=begin)
    assert due_after(recurrence, begin - 1) == begin
    assert due_after(recurrence, begin) == begin + 90 * MINUTE
    assert due_after(recurrence, begin + 200 * MINUTE) == begin + 270 * MINUTE


def test_once_is_once() -> None:
    assert due_after(Once(at=5.0), 4.0) == 5.0
    assert due_after(Once(at=5.0), 5.0) is None


@given(
    recurrence=st.one_of(
        st.builds(
            Daily,
            at=st.tuples(st.integers(0, 23), st.integers(0, 59)).map(lambda time: f"{time[0]:02}:{time[1]:02}"),
            days=st.sets(st.integers(0, 6), max_size=7).map(lambda days: tuple(sorted(days))),
        ),
        st.builds(
            Every, minutes=st.integers(1, 2000).map(float), since=st.integers(0, 5000).map(lambda m: stamp("2026-03-24T00:00") + m * MINUTE)
        ),
    ),
    start_minute=st.integers(0, 20_000),
    length=st.integers(0, 20_000),
)
def test_against_looking_at_the_clock_every_minute(recurrence: Schedule, start_minute: int, length: int) -> None:
    start = stamp("2026-03-22T00:00") + start_minute * MINUTE  # the clock is put forward on the 29th
    naive: list[float] = []
    for minute in range(length + 1):
        moment = start + minute * MINUTE
        if minute > 0 and _is_due(recurrence, moment):
            naive.append(moment)
    count, last_due = due_between(recurrence, start, start + length * MINUTE, WARSAW)
    assert (count, last_due) == (len(naive), naive[-1] if naive else None)
    first = due_after(recurrence, start, WARSAW)
    assert first is not None
    assert not naive or first == naive[0]


def _is_due(recurrence: Schedule, moment: float) -> bool:
    match recurrence:
        case Every(minutes=minutes, since=anchor):
            return anchor is not None and moment >= anchor and (moment - anchor) % (minutes * MINUTE) == 0
        case Daily(at=time, days=days):
            local = datetime.fromtimestamp(moment, WARSAW)
            wall_time = local.replace(tzinfo=None)
            skipped = wall_time.date() == datetime(2026, 3, 29).date() and "02:00" <= time < "03:00"
            nominal_time = wall_time - timedelta(hours=1) if skipped else wall_time
            return f"{nominal_time:%H:%M}" == time and local.fold == 0 and (not days or nominal_time.weekday() in days)
        case _:
            raise AssertionError(recurrence)


@pytest.mark.parametrize(
    ("recurrence", "wrong"),
    [
        (Once(at=9.0), "that time is in the past"),
        (Every(minutes=0), "a number of minutes, at least 0.1; 0 is not"),
        (Every(minutes=float("nan")), "nan is not"),
        (Daily(at="24:00"), "'24:00' is not a time of day"),
        (Daily(at="8"), "is not a time of day"),
        (Daily(at="08:00", days=(7,)), "7 is not a day of the week"),
    ],
)
def test_what_is_no_time_is_refused(recurrence: Schedule, wrong: str) -> None:
    with pytest.raises(UsageError, match=wrong):
        check_recurrence(recurrence, 10.0)


def test_as_it_is_kept_and_as_people_say_it() -> None:
    assert check_recurrence(Daily(at="7:05", days=(4, 0, 0)), 0.0) == Daily(at="07:05", days=(0, 4))
    assert check_recurrence(Every(minutes=5), 100.0) == Every(minutes=5, since=100.0)
    assert in_words(Daily(at="07:05", days=(0, 4))) == "Mon, Fri at 07:05"
    assert in_words(Daily(at="07:05", days=tuple(range(7)))) == "daily at 07:05"
    assert in_words(Every(minutes=120)) == "every 2 h"
    assert in_words(Every(minutes=90)) == "every 90 min"
    assert in_words(Once(at=stamp("2026-11-23T08:00")), WARSAW) == "once, 2026-11-23 08:00"
