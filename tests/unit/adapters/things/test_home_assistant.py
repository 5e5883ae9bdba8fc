"""Things that announce themselves as Home Assistant expects it (home-assistant.io, "MQTT Discovery")."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.things.connections import parse_connection
from somrs.adapters.things.conversion import Raw
from somrs.adapters.things.described_things import resolve_discovered
from somrs.adapters.things.home_assistant import Discovery
from somrs.adapters.things.library import library
from somrs.adapters.things.mapping import ConnectionEntry
from somrs.adapters.things.messages import payload_text, render
from somrs.adapters.things.model import Thing
from somrs.adapters.things.state import Router, ThingState
from somrs.errors import InputError
from somrs.ontology.files.loading import upper
from somrs.ontology.types import Ontology, Value

BROKER = parse_connection("house", ConnectionEntry(url="mqtt://broker"))
LAMP = {
    "~": "zigbee2mqtt/hall",
    "name": None,
    "uniq_id": "0x1_light",
    "schema": "json",
    "cmd_t": "~/set",
    "stat_t": "~",
    "brightness": True,
    "avty": [{"t": "~/availability", "val_tpl": "{{ value_json.state }}"}],
    "dev": {"ids": ["zigbee2mqtt_0x1"], "name": "hall lamp", "sa": "Hall"},
}


def ontology() -> Ontology:
    return upper(2).extended(library())


def announced(messages: dict[str, Any]) -> list[Thing]:
    discovery = Discovery("house")
    for topic, payload in messages.items():
        discovery.received(f"homeassistant/{topic}/config", json.dumps(payload).encode())
    return [resolve_discovered(discovered, ontology(), {"house": BROKER}).thing for discovered in discovery.things()]


def values_after(thing: Thing, *messages: tuple[str, str]) -> dict[str, Value]:
    state, router = ThingState(thing, ontology()), Router()
    router.add(state)
    for topic, payload in messages:
        list(router.received(("house", topic, None), payload.encode(), 0.0))
    return state.values


def sent(thing: Thing, service: str, **inputs: str) -> tuple[str, Raw]:
    (command,) = next(offered.commands for offered in thing.services if offered.type == service)
    return command.place, render(command, inputs)


def test_a_lamp_with_a_json_schema() -> None:
    (lamp,) = announced({"light/0x1/light": LAMP})
    assert (lamp.name, lamp.type, lamp.area) == ("HallLamp", "Light", "Hall")
    assert values_after(lamp, ("zigbee2mqtt/hall", '{"state": "ON", "brightness": 255}')) == {"On": True, "Brightness": 100.0}
    assert sent(lamp, "SwitchOff") == ("zigbee2mqtt/hall/set", '{"state": "OFF"}')
    assert sent(lamp, "SetBrightness", Brightness="50") == ("zigbee2mqtt/hall/set", '{"state": "ON", "brightness": 128}')
    assert [place.source.place for place in lamp.availabilities] == ["zigbee2mqtt/hall/availability"]


def test_entities_of_one_device_are_one_thing() -> None:
    power = {"name": "power", "stat_t": "zigbee2mqtt/hall", "val_tpl": "{{ value_json.power }}", "dev_cla": "power", "unit_of_meas": "kW"}
    second_power = {**power, "name": "power 2", "stat_t": "other"}
    lamp, further = announced(
        {"light/0x1/light": LAMP, "sensor/0x1/power": {**power, "dev": LAMP["dev"]}, "sensor/0x1/p2": {**second_power, "dev": LAMP["dev"]}}
    )
    assert values_after(lamp, ("zigbee2mqtt/hall", '{"power": 0.04}')) == {"Power": 40.0}
    assert (further.name, further.type) == ("HallLampPower2", "Sensor")


def test_the_announcement_of_a_whole_device() -> None:
    message = {
        "dev": {"ids": "ea334450945afc", "name": "Kitchen"},
        "o": {"name": "bla2mqtt"},
        "cmps": {
            "t1": {
                "p": "sensor",
                "device_class": "temperature",
                "unit_of_measurement": "°C",
                "value_template": "{{ value_json.temperature}}",
            },
            "h1": {
                "p": "sensor",
                "device_class": "humidity",
                "unit_of_measurement": "%",
                "value_template": "{{ value_json.humidity | float }}",
            },
        },
        "state_topic": "sensorBedroom/state",
    }
    (kitchen,) = announced({"device/0AFFD2": message})
    values = values_after(kitchen, ("sensorBedroom/state", '{"temperature": 21.5, "humidity": 40}'))
    assert values == {"Temperature": 21.5, "Humidity": 40.0}
    assert not kitchen.is_device


@pytest.mark.parametrize(
    ("component", "config", "message", "values", "service", "payload"),
    [
        ("switch", {"state_topic": "s", "command_topic": "c"}, "ON", {"On": True}, "SwitchOff", "OFF"),
        ("switch", {"state_topic": "s", "command_topic": "c", "payload_on": "1", "payload_off": "0"}, "0", {"On": False}, "SwitchOn", "1"),
        ("lock", {"state_topic": "s", "command_topic": "c"}, "UNLOCKED", {"Locked": False}, "LockDoor", "LOCK"),
        ("cover", {"state_topic": "s", "command_topic": "c"}, "opening", {"Open": False}, "CloseCover", "CLOSE"),
        ("fan", {"state_topic": "s", "command_topic": "c"}, "OFF", {"On": False}, "SwitchOn", "ON"),
        ("light", {"state_topic": "s", "command_topic": "c"}, "ON", {"On": True}, "SwitchOn", "ON"),
    ],
)
def test_a_thing_with_a_state_and_commands(
    component: str, config: dict[str, str], message: str, values: dict[str, Value], service: str, payload: str
) -> None:
    (thing,) = announced({f"{component}/x": {**config, "name": "It"}})
    assert values_after(thing, ("s", message)) == values
    assert sent(thing, service) == ("c", payload)


def test_a_thermostat() -> None:
    config = {
        "name": "Bath",
        "temperature_unit": "F",
        "curr_temp_t": "bath",
        "curr_temp_tpl": "{{ value_json['now'] }}",
        "temp_stat_t": "bath",
        "temp_stat_tpl": "{{ value_json.target }}",
        "temp_cmd_t": "bath/set",
        "mode_stat_t": "bath/mode",
    }
    (bath,) = announced({"climate/bath": config})
    values = values_after(bath, ("bath", '{"now": 50, "target": 68}'), ("bath/mode", "heat"))
    assert {path: round(value, 6) if isinstance(value, float) else value for path, value in values.items()} == {
        "Temperature": 10.0,
        "TargetTemperature": 20.0,
        "HeatingMode": "Heating",
    }
    topic, raw = sent(bath, "SetTemperature", Temperature="20")
    assert topic == "bath/set"
    assert isinstance(raw, float)
    assert round(raw, 6) == 68


def test_a_position_that_is_counted_the_other_way_round() -> None:
    config = {"position_topic": "p", "set_position_topic": "set", "position_open": 0, "position_closed": 100}
    (blind,) = announced({"cover/x": config})
    assert values_after(blind, ("p", "30")) == {"Position": 70.0}
    assert sent(blind, "SetPosition", Position="100") == ("set", 0.0)


def test_a_cover_that_says_its_position_only_is_open_at_one_end_and_shut_at_the_other() -> None:
    config = {"command_topic": "c", "position_topic": "p", "set_position_topic": "set", "payload_close": None}
    (door,) = announced({"cover/x": config})
    assert [service.type for service in door.services] == ["OpenCover", "SetPosition"]
    assert door.services[0].done_when == "?Provider.Open = TRUE"
    assert values_after(door, ("p", "40")) == {"Position": 40.0}
    assert values_after(door, ("p", "0"), ("p", "40")) == {"Position": 40.0, "Open": False}
    assert values_after(door, ("p", "100"), ("p", "40")) == {"Position": 40.0, "Open": True}
    assert values_after(door, ("p", "100"), ("p", "0")) == {"Position": 0.0, "Open": False}


@pytest.mark.parametrize(
    ("config", "temperature", "expected"),
    [
        ({"max_temp": 30, "min_temp": 5, "temp_step": 0.5}, "99", "99 degC is beyond range: 5 to 30 degC"),
        ({"max_temp": 30, "min_temp": 5, "temp_step": 0.5}, "20.3", "the nearest is 20.5 degC"),
        ({"max_temp": 30, "min_temp": 5, "temp_step": 0.5}, "20.5", "20.5"),
        ({}, "36", "36 degC is beyond range: 7 to 35 degC"),
        ({"temp_unit": "F"}, "20", "68"),
        ({"temp_unit": "F", "max_temp": 85}, "30", "30 degC is beyond range: 7 to 29.44 degC"),
    ],
)
@pytest.mark.parametrize("topics", [{}, {"temp_stat_t": "t"}])
def test_a_thermostat_is_set_to_what_it_can_be_set_to(
    config: dict[str, Any], temperature: str, expected: str, topics: dict[str, str]
) -> None:
    (heater,) = announced({"climate/x": {"temp_cmd_t": "set", **config, **topics}})
    try:
        outcome = payload_text(sent(heater, "SetTemperature", Temperature=temperature)[1])
    except InputError as error:
        outcome = str(error)
    assert expected in outcome


def test_a_lamp_is_no_brighter_than_it_can_be() -> None:
    (lamp,) = announced({"light/0x1/light": LAMP})
    with pytest.raises(InputError, match="150 percent is beyond range: 0 to 100 percent"):
        sent(lamp, "SetBrightness", Brightness="150")


@pytest.mark.parametrize(
    ("device_class", "unit", "reading"), [("temperature", "°F", "-500"), ("humidity", "%", "500"), ("humidity", "%", "-5")]
)
def test_what_a_sensor_cannot_measure_is_not_believed(device_class: str, unit: str, reading: str) -> None:
    (sensor,) = announced({"sensor/x": {"state_topic": "s", "device_class": device_class, "unit_of_measurement": unit}})
    assert values_after(sensor, ("s", reading)) == {}


def test_a_thing_that_says_nothing_is_done_when_its_message_is_sent() -> None:
    (switch,) = announced({"switch/x": {"command_topic": "c"}})
    assert [service.done_when for service in switch.services] == [None, None]


@pytest.mark.parametrize(
    ("component", "config", "expected"),
    [
        ("button", {"command_topic": "c"}, "an entity of the kind button"),
        ("sensor", {"state_topic": "s", "value_template": "{{ value_json.a * 2 }}"}, "which is more than a path"),
        ("switch", {"state_topic": "s"}, "it says no command_topic"),
        ("cover", {"command_topic": "c", "tilt_cmd_t": "t", "json_attributes_topic": "j"}, ": its tilt_cmd_t"),
        ("light", {"command_topic": "c", "rgb_command_topic": "t", "rgb_state_topic": "s"}, ": its rgb_command_topic, rgb_state_topic"),
        ("switch", {"command_topic": "c", "avty": [{"t": "a", "val_tpl": "{{ value == 1 }}"}]}, "which is more than a path"),
        ("switch", {"command_topic": "c", "avty_t": "a", "avty_mode": "some"}, "'some' is not a valid AvailabilityMode"),
    ],
)
def test_what_cannot_be_mapped_is_said(component: str, config: dict[str, str], expected: str) -> None:
    (thing,) = announced({f"{component}/x": config})
    assert any(expected in text for text in thing.unsupported)


@pytest.mark.parametrize("unit", ["9**9**9**9", "9^9^9^9", "nonsense", "m" * 50, "kPa"])
def test_what_is_not_in_a_unit_of_its_attribute_is_not_mapped(unit: str) -> None:
    (sensor,) = announced({"sensor/x": {"state_topic": "s", "device_class": "temperature", "unit_of_measurement": unit}})
    assert sensor.signals == ()
    assert any(f"its unit {unit!r}, in which Temperature is not measured" in text for text in sensor.unsupported)


def test_entities_of_one_device_that_say_elsewhere_whether_they_work_are_told() -> None:
    entity = {"device_class": "humidity", "state_topic": "h", "avty_t": "elsewhere", "dev": LAMP["dev"], "name": "humidity"}
    (lamp,) = announced({"light/0x1/light": LAMP, "sensor/0x1/h": entity})
    assert any("humidity: where it says whether it works (elsewhere)" in text for text in lamp.unsupported)


def test_a_thing_leaves_when_its_announcement_is_withdrawn() -> None:
    discovery = Discovery("house")
    assert discovery.received("homeassistant/switch/x/config", b'{"command_topic": "c"}')
    assert not discovery.received("homeassistant/switch/x/config", b'{"command_topic": "c"}')
    assert discovery.received("homeassistant/switch/x/config", b"")
    assert discovery.things() == []


@pytest.mark.parametrize(
    ("mode", "messages", "is_working"),
    [
        ("all", ["a=online"], None),
        ("all", ["a=online", "b=offline"], False),
        ("all", ["a=online", "b=online"], True),
        ("any", ["a=offline"], None),
        ("any", ["a=offline", "b=online"], True),
        ("any", ["a=offline", "b=offline"], False),
        ("latest", ["a=online", "b=offline", "a=online"], True),
    ],
)
def test_a_thing_works_as_it_says_at_several_topics(mode: str, messages: list[str], is_working: bool | None) -> None:
    places = [{"t": "a"}, {"topic": "b"}]
    (lamp,) = announced({"switch/x": {"command_topic": "c", "avty": places, "avty_mode": mode}})
    state, router = ThingState(lamp, ontology()), Router()
    router.add(state)
    for topic, word in (message.split("=") for message in messages):
        list(router.received(("house", topic, None), word.encode(), 0.0))
    assert state.is_online is is_working


def test_sensors_say_when_their_values_lapse() -> None:
    (motion,) = announced({"binary_sensor/x": {"state_topic": "s", "device_class": "motion", "off_dly": 30, "exp_aft": "60"}})
    assert [(signal.off_delay, signal.expire_after) for signal in motion.signals] == [(30.0, 60.0)]


@given(st.text(max_size=30) | st.recursive(st.none() | st.booleans() | st.integers() | st.text(max_size=5), st.lists).map(json.dumps))
def test_what_is_no_announcement_is_said_and_changes_nothing(payload: str) -> None:
    discovery = Discovery("house")
    discovery.received("homeassistant/switch/x/config", payload.encode())
    assert discovery.things() == []


values = st.none() | st.booleans() | st.integers() | st.text(max_size=8) | st.lists(st.text(max_size=4), max_size=2)
keys = st.sampled_from(
    [
        "name",
        "stat_t",
        "cmd_t",
        "avty",
        "dev",
        "cmps",
        "~",
        "brightness",
        "schema",
        "bri_scl",
        "pos_open",
        "val_tpl",
        "uniq_id",
        "bri_cmd_t",
        "pos_t",
    ]
)


@given(st.sampled_from(["light", "cover", "sensor", "climate", "device", "lock"]), st.dictionaries(keys, values, max_size=6))
def test_no_announcement_breaks_anything(component: str, config: dict[str, Any]) -> None:
    discovery = Discovery("house")
    discovery.received(f"homeassistant/{component}/x/config", json.dumps(config).encode())
    discovery.things()
