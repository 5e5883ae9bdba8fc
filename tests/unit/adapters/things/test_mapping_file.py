"""Mapping files: what they become, and what is said of mistakes, with the line and what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from somrs.adapters.things.mapping_checks import oddities
from somrs.adapters.things.mapping_file import LoadedMapping, read_mapping
from somrs.errors import ModelError

MAPPING = """
connections:
  house: {url: mqtt://broker:1883, user: somrs}
  boiler: {url: modbus://10.0.0.7:502/3}
attributes:
  Fault: {kind: truth}
types:
  Boiler: {parent: Heater, attributes: [Fault]}
things:
  Heater1:
    type: Heater
    at: [1, 2, 50 cm]
    connection: house
    available: {topic: heaters/1/status}
    attributes:
      Temperature: {topic: heaters/1/state, json: temperature, dead_band: 0.2, interval: 10 s}
      TargetTemperature: {topic: heaters/1/state, json: target}
    services:
      SetTemperature: {write: [{topic: heaters/1/set, payload: '{"target": ?Temperature}'}]}
  Boiler1:
    type: Boiler
    connection: boiler
    attributes:
      TargetTemperature: {register: holding 7, as: int16, scale: 0.1}
      Fault: {register: coil 2}
    services:
      SetTemperature:
        write: [{register: holding 7, as: int16, payload: '?Temperature', convert: {Temperature: {inverse_of: TargetTemperature}}}]
        failed_when: "?Provider.Fault = TRUE"
"""


def mapping(tmp_path: Path, text: str = MAPPING) -> LoadedMapping:
    (tmp_path / "things.yaml").write_text(text)
    return read_mapping(tmp_path / "things.yaml")


def test_a_mapping_becomes_things_with_all_that_they_need(tmp_path: Path) -> None:
    loaded = mapping(tmp_path)
    heater, boiler = loaded.things
    assert heater.values == {"PositionX": 1.0, "PositionY": 2.0, "PositionZ": 0.5}
    assert [(signal.path, signal.dead_band, signal.interval) for signal in heater.signals] == [
        ("Temperature", 0.2, 10.0),
        ("TargetTemperature", 0.1, 0.0),
    ]
    assert heater.services[0].done_when == "?Provider.TargetTemperature = ?Temperature"
    assert {definition.name for definition in boiler.definitions} >= {"Boiler", "Heater", "Thing", "Fault", "SetTemperature"}
    assert loaded.connections["boiler"].unit == 3
    assert str(loaded.connections["house"]) == "mqtt://broker:1883"


def test_definitions_of_a_site_count_instead_of_those_for_things(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_text("attributes:\n  Temperature: {kind: number, unit: K}\n")
    (heater, _) = mapping(tmp_path, "uses: [site.yaml]\n" + MAPPING).things
    assert heater.signals[0].conversion.attribute.unit == "K"


@pytest.mark.parametrize(
    ("text", "replacement", "line", "message"),
    [
        ("json: target}", "jsn: target}", 17, "unknown key jsn; did you mean json?"),
        ("json: target}", "json: target, unit: kg}", 17, "TargetTemperature is in degC, and kg cannot be expressed in it"),
        ("topic: heaters/1/state, json: target", "register: holding 3", 17, "needs topic:, and only this, because house speaks MQTT"),
        ("type: Heater\n", "type: Heatr\n", 11, "there is no type Heatr; did you mean Heater or Chair?"),
        ("at: [1, 2, 50 cm]", "at: [1, 2, 5 kg]", 12, "PositionZ is a number in m, not '5 kg'"),
        ("connection: house", "connection: hause", 14, "there is no connection hause; did you mean house?"),
        ("      TargetTemperature: {topic", "      Target: {topic", 17, "have no attribute Target"),
        ("?Temperature}'", "?Temp}'", 19, "?Temp is no input of the service; it has Temperature"),
        ("SetTemperature: {write", "SetTemprature: {write", 19, "there is no type of service SetTemprature; did you mean SetTemperature?"),
        ("Fault = TRUE", "Fault = 3", 29, "?Provider.Fault is TRUE or FALSE, and 3 is a number"),
        ("Fault = TRUE", "On = TRUE", 29, "?Provider.On"),
        ("as: int16, payload", "as: int8, payload", 28, "'int8' is not an encoding"),
        ("holding 7, as: int16, payload", "input 7, as: int16, payload", 28, "input 7 can only be read"),
        ("inverse_of: TargetTemperature", "inverse_of: Temperature", 28, "no message says Temperature"),
        ("mqtt://broker:1883", "broker:1883", 3, "is not an address of a broker"),
        ("mqtt://broker:1883", "mqtt://a:secret@broker", 3, "a password does not belong into an address"),
        ("modbus://10.0.0.7:502/3", "modbus://10.0.0.7:502/x", 4, "is not the number of a Modbus unit"),
        (
            "      TargetTemperature: {topic: heaters/1/state, json: target}\n",
            "",
            18,
            "no message says TargetTemperature; write done_when:",
        ),
        ("write: [{topic: heaters/1/set, payload: '{\"target\": ?Temperature}'}]", "price: 1 EUR", 19, "sends nothing; write write:"),
        ("heaters/1/set", "heaters/#", 19, "a topic of one thing has no wildcards"),
        ("register: coil 2", "register: coil 2, poll: 0", 25, "poll is the pause between two readings"),
        ("register: coil 2", "register: coil 2, json: fault", 25, "a register has a value, and no document"),
        ("payload: '?Temperature', convert", "payload: warm, convert", 28, "a register gets a number, true or false, or an input"),
        ("mqtt://broker:1883", "mqtts://broker, certificates: {authority: a.pem}", 3, "a.pem; correct the name"),
        ("things:", "objects: {Place1: {type: Place, at: [0, 0, 0]}}\nthings:", 9, "belongs into a file of the site"),
        ("things:", "thing:", 9, "unknown key thing; did you mean things?"),
        ("holding 7, as: int16, scale", "holding 65535, as: float32, scale", 24, "the last address is 65535"),
        (", convert: {Temperature: {inverse_of: TargetTemperature}}", "", 28, "is read as TargetTemperature otherwise; write convert:"),
        ("holding 7, as: int16, payload", "holding 7, as: int32, payload", 28, "is read as int16, and written as int32"),
        ("json: target}", "json: target, poll: 1 s}", 17, "a topic says its messages by itself"),
        ("json: target}", "json: target, range: [80, 5]}", 17, "write the least value first"),
    ],
)
def test_a_mistake_is_said_with_its_line(tmp_path: Path, text: str, replacement: str, line: int, message: str) -> None:
    assert text in MAPPING
    with pytest.raises(ModelError) as error:
        mapping(tmp_path, MAPPING.replace(text, replacement, 1))
    problems = [problem for problem in error.value.problems if message in problem.message]
    assert [problem.line for problem in problems][:1] == [line], str(error.value)


def test_all_mistakes_are_said_at_once(tmp_path: Path) -> None:
    text = MAPPING.replace("json: target}", "json: target, unit: kg}").replace("Fault = TRUE", "Fault = 3")
    with pytest.raises(ModelError) as error:
        mapping(tmp_path, text)
    assert len(error.value.problems) == 2


def test_mistakes_in_the_structure_hide_no_others(tmp_path: Path) -> None:
    text = """
connections: {house: {url: mqtt://broker}}
things:
  Heater1: {type: Heater, attributes: {Temperature: {topic: a, scale: "0,1", unit: kg}, TargetTemperature: {topic: 3}}}
  Door1: {type: AutomaticDoor, door: {open: [{topic: door/set, payload: open}]}}
  Heater2: {type: Heatr}
  Heater3: {attributes: {Temperature: {topic: a}}}
"""
    with pytest.raises(ModelError) as error:
        mapping(tmp_path, text)
    assert [(problem.line, problem.message.partition(";")[0]) for problem in error.value.problems] == [
        (4, "scale should be a number, not '0,1'"),
        (4, "topic should be a text, not 3"),
        (4, "Temperature is in degC, and kg cannot be expressed in it"),
        (5, "close is missing"),
        (6, "there is no type Heatr"),
        (7, "type is missing"),
    ]


def test_an_output_is_called_by_its_name(tmp_path: Path) -> None:
    text = """
connections: {house: {url: mqtt://broker}}
types: {LabScale: {parent: Scale, attributes: [MeasuredWeight]}}
things:
  Scale1:
    type: LabScale
    attributes: {MeasuredWeight: {topic: a}}
    services: {WeighObject: {write: [{topic: b}], done_when: sent, outputs: {Wieght: MeasuredWeight}}}
"""
    with pytest.raises(ModelError, match="WeighObject has no output Wieght; did you mean Weight"):
        mapping(tmp_path, text)


@pytest.mark.parametrize(
    ("sessions", "message"),
    [
        ("Lift1: {type: Lift, session: {topic: lifts/1, levels: {L1: '0', L2: '0'}}}", "several storeys have the level '0'"),
        ("Door1: {type: AutomaticDoor, session: {topic: a}}, Door2: {type: AutomaticDoor, session: {topic: a/}}", "at a, as Door1"),
        ("Door1: {type: AutomaticDoor, session: {topic: a}, connection: plant}", "plant speaks MODBUS, which has no session"),
    ],
)
def test_each_passage_has_a_session_of_its_own(tmp_path: Path, sessions: str, message: str) -> None:
    connections = "house: {url: mqtt://broker}, plant: {url: modbus://plc}"
    sessions = sessions.replace("topic: a", "connection: house, topic: a") if "plant" not in sessions else sessions
    sessions = sessions.replace("topic: lifts", "connection: house, topic: lifts")
    with pytest.raises(ModelError, match=message):
        mapping(tmp_path, f"connections: {{{connections}}}\nthings: {{{sessions}}}\n")


def test_a_command_that_its_own_thing_reads_is_odd(tmp_path: Path) -> None:
    text = """
connections: {house: {url: mqtt://broker}}
things:
  Lamp1: {type: Light, attributes: {On: {topic: lamp/set}}, services: {SwitchOn: {write: [{topic: lamp/set, payload: "on"}]}}}
  Lamp2: {type: Light, attributes: {On: {topic: lamp}}, services: {SwitchOn: {write: [{topic: lamp/set, payload: "on"}]}}}
"""
    lamps = mapping(tmp_path, text).things
    assert [oddity.partition(" publishes")[0] for lamp in lamps for oddity in oddities(lamp)] == ["Lamp1: SwitchOn"]


def test_a_door_needs_to_say_that_it_is_open(tmp_path: Path) -> None:
    text = """
connections: {house: {url: mqtt://broker}}
things:
  Door1:
    type: AutomaticDoor
    door: {open: [{topic: door/set, payload: open}], close: [{topic: door/set, payload: close}]}
"""
    with pytest.raises(ModelError, match="write under attributes: where Open is read"):
        mapping(tmp_path, text)


def test_a_lift_needs_the_names_of_its_levels(tmp_path: Path) -> None:
    text = "connections: {house: {url: mqtt://broker}}\nthings:\n  Lift1: {type: Lift, session: {topic: lifts/1}}\n"
    with pytest.raises(ModelError, match="a lift needs the names of its levels"):
        mapping(tmp_path, text)
