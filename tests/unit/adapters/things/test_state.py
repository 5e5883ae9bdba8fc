"""What messages say of things: what is not understood, or cannot be, changes nothing, and is said once."""

from __future__ import annotations

from pathlib import Path

import pytest

from somrs.adapters.things.mapping_file import read_mapping
from somrs.adapters.things.state import Payload, Router, ThingState, source_key

MAPPING = """
connections: {house: {url: mqtt://broker}}
things:
  Sensor1:
    type: Sensor
    attributes: {Temperature: {topic: sensors/1, json: temperature, range: [-40, 80]}, Humidity: {topic: sensors/1, json: humidity}}
  Sensor2:
    type: Sensor
    attributes: {Temperature: {topic: sensors/2, unit: degF, range: [-40, 80]}}
"""


class Sensors:
    """The sensors of the mapping."""

    def __init__(self, folder: Path) -> None:
        (folder / "things.yaml").write_text(MAPPING)
        loaded = read_mapping(folder / "things.yaml")
        self.router = Router()
        self.states = [ThingState(thing, loaded.ontology) for thing in loaded.things]
        for state in self.states:
            self.router.add(state)

    def hear(self, number: int, payload: Payload, now: float = 0.0) -> list[str]:
        """Take in a message of a sensor, and return the complaints about it."""
        list(self.router.received(source_key(self.states[number].thing.signals[0].source), payload, now))
        complaints, self.router.complaints = self.router.complaints, []
        return complaints


@pytest.fixture
def sensors(tmp_path: Path) -> Sensors:
    return Sensors(tmp_path)


@pytest.mark.parametrize("payload", [b"{", b"\xff\x00", b"<html>down</html>", b"", b'{"temperature": -99999}', b'{"temperature": "warm"}'])
def test_what_is_not_understood_or_not_believed_is_said_once_and_changes_nothing(sensors: Sensors, payload: bytes) -> None:
    state = sensors.states[0]
    assert sensors.hear(0, b'{"temperature": 21, "humidity": 40}', 100.0) == []
    complaints = sensors.hear(0, payload, 200.0)
    assert any(complaint.startswith("Sensor1: Temperature from house: sensors/1: ") for complaint in complaints)
    assert sensors.hear(0, payload, 300.0) == []
    assert state.values["Temperature"] == 21.0
    assert state.heard_at["Temperature"] == 100.0
    assert "Temperature" in state.misread
    sensors.hear(0, b'{"temperature": 22, "humidity": 40}', 400.0)
    assert (state.values["Temperature"], state.heard_at["Temperature"], state.misread) == (22.0, 400.0, set())
    assert sensors.hear(0, payload, 500.0) == complaints


def test_a_message_about_something_else_is_no_mistake(sensors: Sensors) -> None:
    assert sensors.hear(0, b'{"battery": 80, "temperature": null}') == []
    assert sensors.states[0].values == {}


def test_a_range_is_in_the_unit_of_the_attribute(sensors: Sensors) -> None:
    assert sensors.hear(1, b"170") == []
    assert sensors.hear(1, b"180") == ["Sensor2: Temperature from house: sensors/2: 82.2222 degC is beyond range: -40 to 80 degC"]
