"""What topics say of attributes and faults."""

from __future__ import annotations

from typing import Any

import pytest

from somrs.adapters.ros2.readings import AttributeReading, FaultReadings
from somrs.adapters.ros2.settings import Attribute, FaultTopic

TOPIC: dict[str, Any] = {"topic": "battery_state", "type": "sensor_msgs/msg/BatteryState", "field": "percentage"}


def _values(attribute: Attribute, *readings: Any) -> list[Any]:
    reading = AttributeReading(attribute)
    return [reading.take({"percentage": value}) for value in readings]


def test_a_number_is_scaled_and_reported_when_it_has_changed_enough() -> None:
    attribute = Attribute(**TOPIC, scale=100, dead_band=5)
    assert _values(attribute, 0.42, 0.41, 0.38, 0.37, 0.44) == [42, None, None, 37, 44]


@pytest.mark.parametrize("reading", [None, [], {}])
def test_a_value_that_is_not_known_is_not_reported(reading: object) -> None:
    assert _values(Attribute(**TOPIC), reading) == [None]


def test_a_message_without_the_field_is_ignored() -> None:
    assert AttributeReading(Attribute(**TOPIC)).take({"voltage": 12.0}) is None


def test_texts_and_truths_are_reported_when_they_change() -> None:
    assert _values(Attribute(**TOPIC), True, True, False) == [True, None, False]
    assert _values(Attribute(**TOPIC), "on", "off", "off") == ["on", "off", None]


def test_values_get_their_names() -> None:
    assert _values(Attribute(**TOPIC, values={1.0: "Charging", 2.0: "Full"}), 1, 2, 7) == ["Charging", "Full", None]


def test_a_robot_with_several_faults_has_all_reasons_until_the_last_is_gone() -> None:
    stop = FaultTopic(topic="stop", type="std_msgs/msg/Bool", field="data", reason="its stop is pressed")
    motor = FaultTopic(topic="diagnostics", type="x/msg/Y", field="level", equals=2, reason="its motor has a fault")
    faults = FaultReadings((stop, motor))
    assert faults.reason is None
    faults.take(0, {"data": True})
    faults.take(1, {"level": 2})
    assert faults.reason == "its stop is pressed; its motor has a fault"
    faults.take(0, {"data": False})
    faults.take(1, {"something": 0})
    assert faults.reason == "its motor has a fault"
    faults.take(1, {"level": 1})
    assert faults.reason is None
