"""When something is to happen again: once, every so often, or on days of the week, by the machine's local time."""

from __future__ import annotations

import msgspec


class Once(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """At this moment: seconds since 1970."""

    at: float


class Every(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Every so many minutes, counted from `since` (seconds since 1970), or from when the order was given."""

    minutes: float
    since: float | None = None


class Daily(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """At `hh:mm` by local time, on these days of the week: 0 is Monday, 6 is Sunday; all, if none is said."""

    at: str
    days: tuple[int, ...] = ()


When = Once | Every | Daily
