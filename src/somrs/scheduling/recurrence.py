"""Schedules in local time: once, at an interval, or at a time of day on days of the week.

A time of day that is skipped when clocks are set forward counts as if they had not been set yet. A time of day that occurs twice when they
are set back is due once.
"""

from __future__ import annotations

import math
import re
from datetime import datetime, timedelta, tzinfo
from zoneinfo import ZoneInfo

import msgspec

from somrs.errors import UsageError
from somrs.protocol.messages.orders import Daily, Every, Once, Schedule

_LEAST_MINUTES = 0.1
DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")

_TIME = re.compile(r"([01]?\d|2[0-3]):([0-5]\d)")


def zone_of(name: str) -> tzinfo | None:
    """The time zone with this name; None, for the machine's local time, if the name is empty or unknown."""
    try:
        return ZoneInfo(name) if name else None
    except (KeyError, ValueError, OSError):
        return None


def check_recurrence(recurrence: Schedule, now: float) -> Schedule:
    """Check a schedule that is given now, and return its normalized form. Raises UsageError if it is invalid, or in the past."""
    match recurrence:
        case Once(at=time):
            if not math.isfinite(time) or time <= now:
                raise UsageError("that time is in the past; give a time in the future")
            return recurrence
        case Every(minutes=minutes, since=anchor):
            if not (_LEAST_MINUTES <= minutes < math.inf) or not math.isfinite(anchor or 0.0):
                raise UsageError(f"the interval of an order is a number of minutes, at least {_LEAST_MINUTES:g}; {minutes:g} is not")
            return msgspec.structs.replace(recurrence, since=now if anchor is None else anchor)
        case Daily(at=time, days=days):
            match = _TIME.fullmatch(time.strip())
            if match is None:
                raise UsageError(f"{time!r} is not a time of day; write it as hh:mm, such as 07:30")
            if wrong := [day for day in days if day not in range(len(DAYS))]:
                raise UsageError(f"{wrong[0]} is not a day of the week; 0 is Monday, 6 is Sunday")
            return Daily(at=f"{int(match[1]):02}:{match[2]}", days=tuple(sorted({*days})))


def due_after(recurrence: Schedule, start: float, zone: tzinfo | None = None) -> float | None:
    """The first due time after `start`; None if there is none. Times are in seconds since 1970; `zone`: None for this machine's."""
    match recurrence:
        case Once(at=time):
            return time if time > start else None
        case Every(minutes=minutes, since=anchor):
            begin, period = anchor or 0.0, minutes * 60
            if start < begin:
                return begin
            count = math.floor((start - begin) / period) + 1
            return begin + (count if begin + count * period > start else count + 1) * period
        case Daily(at=time, days=days):
            hour, minute = map(int, time.split(":"))
            day = datetime.fromtimestamp(start, zone).replace(hour=hour, minute=minute, second=0, microsecond=0, tzinfo=None, fold=0)
            for _ in range(len(DAYS) + 2):
                moment = day.replace(tzinfo=zone).timestamp()
                if moment > start and (not days or day.weekday() in days):
                    return moment
                day += timedelta(days=1)
            raise AssertionError("nine days contain each day of the week")


def due_between(recurrence: Schedule, start: float, end: float, zone: tzinfo | None = None) -> tuple[int, float | None]:
    """The number of due times after `start` and up to `end`, and the last of them."""
    if isinstance(recurrence, Every):
        first = due_after(recurrence, start, zone)
        if first is None or first > end:
            return 0, None
        count = math.floor((end - first) / (recurrence.minutes * 60))
        return count + 1, first + count * recurrence.minutes * 60
    count, last_due = 0, None
    while (due := due_after(recurrence, start if last_due is None else last_due, zone)) is not None and due <= end:
        count, last_due = count + 1, due
    return count, last_due


def in_words(recurrence: Schedule, zone: tzinfo | None = None) -> str:
    """The schedule as text for users."""
    match recurrence:
        case Once(at=time):
            return f"once, {datetime.fromtimestamp(time, zone):%Y-%m-%d %H:%M}"
        case Every(minutes=minutes):
            hours = minutes / 60
            return f"every {hours:g} h" if hours >= 1 and hours == int(hours) else f"every {minutes:g} min"
        case Daily(at=time, days=days):
            named = ", ".join(DAYS[day] for day in days)
            return f"{named} at {time}" if 0 < len(days) < len(DAYS) else f"daily at {time}"
