"""The header of all messages, the versions and the topics (VDA 5050 3.0, 4 and 7.2)."""

from __future__ import annotations

from datetime import UTC, datetime
from enum import StrEnum

from msgspec import Struct


class Version(StrEnum):
    """The versions of the interface that are spoken here."""

    V2_0 = "2.0.0"
    V2_1 = "2.1.0"
    V3_0 = "3.0.0"

    @property
    def major(self) -> int:
        return int(self.value[0])

    @classmethod
    def closest(cls, text: str, major: int) -> Version:
        """The version that a vehicle means which says `text` below a topic of this `major` version. 2.1 for an unknown one of 2, so
        that 2.2 works."""
        if major >= 3:
            return cls.V3_0
        return cls.V2_0 if text.startswith("2.0") else cls.V2_1


class Topic(StrEnum):
    """The last level of a topic."""

    ORDER = "order"
    INSTANT_ACTIONS = "instantActions"
    RESPONSES = "responses"
    ZONE_SET = "zoneSet"
    STATE = "state"
    VISUALIZATION = "visualization"
    CONNECTION = "connection"
    FACTSHEET = "factsheet"


RETAINED = frozenset({Topic.CONNECTION, Topic.FACTSHEET})
"""Topics whose last message the broker keeps (3.0, 6.5 and 6.10)."""


class Header(Struct, frozen=True, kw_only=True, rename="camel"):
    """`header_id`: grows by one from message to message of a topic, modulo 2 ** 32. `timestamp`: ISO 8601, UTC, with milliseconds."""

    header_id: int
    timestamp: str
    version: str
    manufacturer: str
    serial_number: str


EARLIEST, LATEST = datetime(1, 1, 2, tzinfo=UTC).timestamp(), datetime(9999, 12, 30, tzinfo=UTC).timestamp()
"""What can be written as a timestamp."""


def timestamp_of(seconds: float) -> str:
    """Write a time in seconds since 1970 as VDA 5050 does, such as 2017-04-15T11:40:03.123Z."""
    seconds = max(EARLIEST, min(LATEST, seconds))
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def seconds_of(timestamp: str) -> float | None:
    """Read a timestamp as seconds since 1970; None if it is none."""
    try:
        moment = datetime.fromisoformat(timestamp)
    except ValueError:
        return None
    return (moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp()
