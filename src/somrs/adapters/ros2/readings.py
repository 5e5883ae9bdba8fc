"""What the messages of bound topics say: values of attributes, and faults."""

from __future__ import annotations

from somrs.adapters.ros2.lines import Values
from somrs.adapters.ros2.settings import Attribute, FaultTopic
from somrs.adapters.ros2.templates import MISSING, field_value
from somrs.ontology.types import Value

DIGITS = 6
"""Significant digits of a reported number."""


class AttributeReading:
    """An attribute that a topic has: which of its values the map needs to learn."""

    def __init__(self, attribute: Attribute) -> None:
        self._attribute = attribute
        self.value: Value | None = None
        """The newest value."""
        self._reported: Value | None = None

    def take(self, message: Values) -> Value | None:
        """The value to report after a message; None: none, as it has not changed enough, or is not known."""
        reading = field_value(message, self._attribute.field)
        if not isinstance(reading, bool | int | float | str):
            return None  # a robot that does not know its battery's charge says NaN, which comes as null
        if self._attribute.values:
            value = self._attribute.values.get(reading)
        elif isinstance(reading, bool | str):
            value = reading
        else:
            value = float(f"{reading * self._attribute.scale:.{DIGITS}g}")
        if value is None:
            return None
        self.value = value
        if self._is_near(value):
            return None
        self._reported = value
        return value

    def _is_near(self, value: Value) -> bool:
        reported = self._reported
        if _is_number(value) and _is_number(reported):
            return value == reported or abs(float(value) - float(reported or 0.0)) < self._attribute.dead_band
        return value == reported

    def forget(self) -> None:
        """Report the next value in any case."""
        self._reported = None


def _is_number(value: Value | None) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


class FaultReadings:
    """The faults that topics report."""

    def __init__(self, topics: tuple[FaultTopic, ...]) -> None:
        self._topics = topics
        self._present: set[int] = set()

    @property
    def reason(self) -> str | None:
        """Why the robot cannot drive; None if it can."""
        return "; ".join(self._topics[index].reason for index in sorted(self._present)) or None

    def take(self, index: int, message: Values) -> None:
        """Take a message of the topic at this index."""
        topic = self._topics[index]
        reading = field_value(message, topic.field)
        if reading is MISSING:
            return
        is_present = bool(reading) if topic.equals is None else reading == topic.equals
        (self._present.add if is_present else self._present.discard)(index)
