"""W3C Thing Descriptions (WoT TD 1.1): what they become, and what is said of the rest."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.things.connections import parse_connection
from somrs.adapters.things.described_things import ResolvedThing, resolve_description
from somrs.adapters.things.library import library
from somrs.adapters.things.mapping import ConnectionEntry
from somrs.adapters.things.messages import render
from somrs.errors import InputError
from somrs.ontology.files.loading import upper
from somrs.ontology.types import Kind

ADDRESS = "http://house.local/things/lamp.td.json"


def resolved(**parts: Any) -> ResolvedThing:
    document = {"@context": "https://www.w3.org/2022/wot/td/v1.1", "title": "My lamp", **parts}
    return resolve_description(json.dumps(document), ADDRESS, upper(2).extended(library()), {})


def form(href: str, **keys: Any) -> list[dict[str, Any]]:
    return [{"href": href, **keys}]


def test_properties_become_attributes_and_services() -> None:
    lamp = resolved(
        base="http://192.168.1.23:8080/",
        properties={
            "status": {"@type": "OnOffProperty", "type": "boolean", "forms": form("properties/on")},
            "brightness": {"type": "integer", "unit": "percent", "forms": form("properties/brightness", **{"htv:methodName": "POST"})},
        },
    )
    thing = lamp.thing
    assert (thing.name, thing.type) == ("MyLamp", "Light")
    assert {signal.path: signal.source.place for signal in thing.signals} == {
        "On": "/properties/on",
        "Brightness": "/properties/brightness",
    }
    assert [service.type for service in thing.services] == ["SwitchOn", "SwitchOff", "SetBrightness"]
    command = thing.services[2].commands[0]
    assert (command.method, command.place, render(command, {"Brightness": "40"})) == ("POST", "/properties/brightness", 40.0)
    assert str(lamp.connections["http://192.168.1.23:8080"]) == "http://192.168.1.23:8080"


def test_a_description_says_what_the_thing_is() -> None:
    on = {"@type": "OnOffProperty", "type": "boolean", "forms": form("properties/on")}
    tint = {"type": "string", "forms": form("properties/tint")}
    lamp = resolved(title="Corridor lamp 7", **{"@type": ["Light", "OnOffSwitch"]}, properties={"on": on, "tint": tint})
    assert "Light" in lamp.ontology.ancestors(lamp.thing.type)
    assert resolved(**{"@type": "https://schemas.example/things#Light"}, properties={"on": on}).thing.type == "Light"
    assert resolved(**{"@type": "saref:Washer"}, properties={"on": on}).thing.type == "Switch"


def test_what_no_type_has_is_defined() -> None:
    mixer = resolved(
        title="Paint mixer",
        properties={
            "fillLevel": {"type": "number", "unit": "liter", "minimum": 0, "maximum": 20, "readOnly": True, "forms": form("/fill")},
            "program": {"type": "string", "enum": ["slow", "fast"], "forms": form("/program")},
        },
    )
    ontology = mixer.ontology
    assert mixer.thing.type == "PaintMixer"
    assert ontology.types["PaintMixer"].attributes == ("FillLevel", "Program")
    assert (ontology.attributes["FillLevel"].unit, ontology.attributes["FillLevel"].maximum) == ("liter", 20.0)
    assert ontology.attributes["Program"].kind is Kind.ENUMERATION
    (service,) = mixer.thing.services
    assert (service.type, service.effect) == ("SetProgram", "?Provider.Program = ?Program")
    assert render(service.commands[0], {"Program": "fast"}) == '"fast"'
    assert {definition.name for definition in mixer.thing.definitions} >= {"PaintMixer", "FillLevel", "Program", "SetProgram"}


def test_units_are_converted() -> None:
    thing = resolved(properties={"temperature": {"type": "number", "unit": "fahrenheit", "readOnly": True, "forms": form("/t")}}).thing
    (signal,) = thing.signals
    value = signal.conversion.read("212")
    assert isinstance(value, float)
    assert round(value, 6) == 100


@pytest.mark.parametrize(
    ("temperature", "expected"),
    [("40", "40 degC is beyond range: 10 to 30 degC"), ("20.2", "the nearest is 20 degC"), ("20", "68")],
)
def test_a_property_is_set_within_its_limits(temperature: str, expected: str) -> None:
    schema = {"type": "number", "unit": "fahrenheit", "minimum": 50, "maximum": 86, "multipleOf": 2, "forms": form("/t")}
    (service,) = resolved(properties={"targetTemperature": schema}).thing.services
    try:
        outcome = str(render(service.commands[0], {"Temperature": temperature}))
    except InputError as error:
        outcome = str(error)
    assert expected in outcome


def test_properties_over_mqtt() -> None:
    forms = [{"href": "mqtt://broker:1884", "mqv:topic": "lamp/on", "op": ["observeproperty", "writeproperty"]}]
    thing = resolved(properties={"on": {"type": "boolean", "forms": forms}}).thing
    assert [(signal.source.connection, signal.source.place) for signal in thing.signals] == [("mqtt://broker:1884", "lamp/on")]


def test_a_connection_of_the_settings_to_the_same_server_is_used() -> None:
    document = {"title": "Lamp", "properties": {"on": {"type": "boolean", "forms": form("/on")}}}
    configured = parse_connection("house", ConnectionEntry(url="http://house.local", user="somrs"))
    thing = resolve_description(json.dumps(document), ADDRESS, upper(2).extended(library()), {"house": configured})
    assert [connection.user for connection in thing.connections.values()] == ["somrs"]


@pytest.mark.parametrize(
    ("scheme", "user", "is_missing"), [("basic", "ann", False), ("bearer", None, False), ("nosec", None, False), ("digest", None, True)]
)
def test_each_thing_at_an_address_gets_the_connection_with_its_security(
    tmp_path: Path, scheme: str, user: str | None, is_missing: bool
) -> None:
    (tmp_path / "secret").write_text("secret")
    entries = {"door": ConnectionEntry(url="http://house.local", user="ann", password_file="secret")}
    if not is_missing:
        entries["blind"] = ConnectionEntry(url="http://house.local", password_file="secret")
    connections = {name: parse_connection(name, entry, tmp_path) for name, entry in entries.items()}
    document = {
        "title": "Thing",
        "securityDefinitions": {"sc": {"scheme": scheme}},
        "security": "sc",
        "properties": {"on": {"type": "boolean", "forms": form("/on")}},
    }
    resolved_thing = resolve_description(json.dumps(document), ADDRESS, upper(2).extended(library()), connections)
    (connection,) = resolved_thing.connections.values()
    assert connection.user == user
    assert (connection.password_file is not None) is (scheme in ("basic", "bearer"))
    assert any("security scheme" in text for text in resolved_thing.thing.unsupported) is is_missing


def test_what_cannot_be_mapped_is_said() -> None:
    thing = resolved(
        securityDefinitions={"basic_sc": {"scheme": "basic"}},
        security=["basic_sc"],
        properties={
            "colour": {"type": "object", "forms": form("/c")},
            "on": {"type": "boolean", "forms": form("coap://lamp/on")},
            "locked": {"type": "boolean", "forms": form("/locked")},
        },
        actions={"fade": {"forms": form("/fade")}},
        events={"overheated": {"forms": form("/hot")}},
    ).thing
    for expected in (
        "security scheme basic",
        "property colour: of the type object",
        "property on: it has no form",
        "action fade",
        "event over",
    ):
        assert any(expected in text for text in thing.unsupported), expected


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"title": 3}', "lamp"])
def test_what_is_no_description_is_said(text: str) -> None:
    with pytest.raises(InputError, match=ADDRESS):
        resolve_description(text, ADDRESS, upper(2).extended(library()), {})


anything = st.none() | st.booleans() | st.text(max_size=6) | st.lists(st.text(max_size=4), max_size=2)
schemas = st.dictionaries(st.sampled_from(["type", "@type", "unit", "enum", "forms", "minimum", "readOnly"]), anything, max_size=5)


@given(st.dictionaries(st.text(min_size=1, max_size=8), schemas | anything, max_size=3), anything)
def test_no_description_breaks_anything(properties: dict[str, Any], actions: Any) -> None:
    document = json.dumps({"title": "Lamp", "properties": properties, "actions": actions})
    with contextlib.suppress(InputError):
        resolve_description(document, ADDRESS, upper(2).extended(library()), {})
