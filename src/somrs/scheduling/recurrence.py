"""When something is to happen again: once, every so often, or on days of the week, by local time.

Times of day that a clock skips, when it is put forward, are taken as if it had not been yet; those that it shows twice happen once.
"""

from __future__ import annotations

import math
import re
from datetime import datetime, timedelta, tzinfo
from zoneinfo import ZoneInfo

import msgspec

from somrs.errors import UsageError
from somrs.protocol.messages.orders import Daily, Every, Once, Schedule

LEAST_MINUTES = 0.1
DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")

_TIME = re.compile(r"([01]?\d|2[0-3]):([0-5]\d)")


def zone_of(name: str) -> tzinfo | None:
    """The zone of this name; None, which is the machine's own, for none, or one that this machine does not know."""
    try:
        return ZoneInfo(name) if name else None
    except (KeyError, ValueError, OSError):
        return None


def checked(when: Schedule, now: float) -> Schedule:
    """As it is to be kept, if it was given now. Raises UsageError for what is no time, or over."""
    match when:
        case Once(at=at):
            if not math.isfinite(at) or at <= now:
                raise UsageError("that moment is over; give one that is to come")
            return when
        case Every(minutes=minutes, since=since):
            if not (LEAST_MINUTES <= minutes < math.inf) or not math.isfinite(since or 0.0):
                raise UsageError(f"an order is due every {LEAST_MINUTES:g} minutes at the most, and {minutes:g} is less, or no number")
            return msgspec.structs.replace(when, since=now if since is None else since)
        case Daily(at=at, days=days):
            found = _TIME.fullmatch(at.strip())
            if found is None:
                raise UsageError(f"{at!r} is no time of day; write it as hh:mm, such as 07:30")
            if wrong := [day for day in days if day not in range(len(DAYS))]:
                raise UsageError(f"{wrong[0]} is no day of the week; 0 is Monday, 6 is Sunday")
            return Daily(at=f"{int(found[1]):02}:{found[2]}", days=tuple(sorted({*days})))


def due_after(when: Schedule, after: float, zone: tzinfo | None = None) -> float | None:
    """The first time that is later than that; None if there is none. `zone`: whose local time counts; None: this machine's."""
    match when:
        case Once(at=at):
            return at if at > after else None
        case Every(minutes=minutes, since=since):
            begin, period = since or 0.0, minutes * 60
            if after < begin:
                return begin
            count = math.floor((after - begin) / period) + 1
            return begin + (count if begin + count * period > after else count + 1) * period
        case Daily(at=at, days=days):
            hour, minute = map(int, at.split(":"))
            day = datetime.fromtimestamp(after, zone).replace(hour=hour, minute=minute, second=0, microsecond=0, tzinfo=None, fold=0)
            for _ in range(len(DAYS) + 2):
                moment = day.replace(tzinfo=zone).timestamp()
                if moment > after and (not days or day.weekday() in days):
                    return moment
                day += timedelta(days=1)
            raise AssertionError("in nine days there is one of each")


def due_between(when: Schedule, after: float, until: float, zone: tzinfo | None = None) -> tuple[int, float | None]:
    """How often it was due later than `after` and not later than `until`, and when the last time was."""
    if isinstance(when, Every):
        first = due_after(when, after, zone)
        if first is None or first > until:
            return 0, None
        count = math.floor((until - first) / (when.minutes * 60))
        return count + 1, first + count * when.minutes * 60
    count, last = 0, None
    while (due := due_after(when, after if last is None else last, zone)) is not None and due <= until:
        count, last = count + 1, due
    return count, last


def in_words(when: Schedule, zone: tzinfo | None = None) -> str:
    """As people say it."""
    match when:
        case Once(at=at):
            return f"once, {datetime.fromtimestamp(at, zone):%Y-%m-%d %H:%M}"
        case Every(minutes=minutes):
            hours = minutes / 60
            return f"every {hours:g} h" if hours >= 1 and hours == int(hours) else f"every {minutes:g} min"
        case Daily(at=at, days=days):
            named = ", ".join(DAYS[day] for day in days)
            return f"{named} at {at}" if 0 < len(days) < len(DAYS) else f"daily at {at}"
