"""Drawn messages of VDA 5050, and the official schemas to hold them against."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import jsonschema
import pytest
from hypothesis import strategies as st
from msgspec import Struct, inspect

from somrs.adapters.vda5050.messages.dialects import FIELDS_OF_2
from somrs.adapters.vda5050.messages.header import Header, Topic, Version
from somrs.adapters.vda5050.messages.states import EdgeRequest
from tests.support.paths import ROOT

SCHEMAS = ROOT.parent / "shared" / "vda5050"

HEADER = Header(header_id=7, timestamp="2026-11-29T10:00:00.000Z", version="3.0.0", manufacturer="ACME", serial_number="0001")

OPEN_WORDS = {
    "orientation_type": ["GLOBAL", "TANGENTIAL"],
    "corridor_reference_point": ["KINEMATIC_CENTER", "CONTOUR"],
    "release_loss_behavior": ["STOP"],
    "mobile_robot_kinematics": ["DIFFERENTIAL", "OMNIDIRECTIONAL", "THREE_WHEEL"],
    "mobile_robot_class": ["FORKLIFT", "CONVEYOR", "TUGGER", "CARRIER"],
    "localization_types": ["NATURAL", "RFID"],
    "navigation_types": ["VIRTUAL_LINE_GUIDED", "FREELY_NAVIGATING"],
    "supported_zones": ["BLOCKED", "RELEASE"],
    "support": ["SUPPORTED", "REQUIRED"],
    "action_scopes": ["INSTANT", "NODE", "EDGE"],
    "value_data_type": ["BOOL", "NUMBER", "STRING"],
    "info_level": ["INFO", "DEBUG"],
    "zone_type": ["BLOCKED", "LINE_GUIDED"],
    "directed_limitation": ["SOFT", "STRICT"],
    "bidirected_limitation": ["SOFT"],
    "blocking_types": ["NONE", "SOFT", "HARD"],
    "request_type": ["ACCESS"],
}
"""Words of fields that are enumerations in a schema, and texts here."""

ALWAYS = {"start_node_id", "end_node_id", "pause_allowed", "cancel_allowed", "degree", "knot_vector", "reference_state_header_id"}
"""Fields that one version requires, and the other has not."""


@cache
def validator(topic: Topic, version: Version) -> Any:
    """A validator for the official schema of a topic. Skips the test if it is not beside the repository."""
    path = SCHEMAS / ("3.0.0" if version is Version.V3_0 else "2.1.0") / f"{topic}.schema"
    if not path.exists():
        pytest.skip(f"NOT TESTED: messages of VDA 5050 against the official schema, because {path} is absent")
    return jsonschema.Draft202012Validator(json.loads(path.read_text()))


def check_schema(topic: Topic, payload: bytes, version: Version) -> None:
    """Fail if a message is not valid against the official schema."""
    validator(topic, version).validate(json.loads(payload))


@cache
def drawn(kind: type[Struct], version: Version) -> st.SearchStrategy[Any]:
    """Messages of a kind with the fields that the version has."""
    info = inspect.type_info(kind)
    assert isinstance(info, inspect.StructType)
    # The schema of 2.1 has one word where its text has an array.
    hidden = {"blocking_types"} if version is not Version.V3_0 else set()
    fields = {}
    for field in info.fields:
        absent = version is Version.V3_0 and field.encode_name in FIELDS_OF_2.get(kind, ())
        if field.name in hidden or absent:
            continue
        values = _values(field.type, field.name, version)
        if kind is EdgeRequest and field.name == "request_type":
            values = st.just("CORRIDOR")
        fields[field.name] = values if field.required or field.name in ALWAYS else st.none() | values
    return st.builds(kind, **fields)


def _values(expected: inspect.Type, name: str, version: Version) -> st.SearchStrategy[Any]:
    match expected:
        case inspect.UnionType(types=types):
            return _values(next(item for item in types if not isinstance(item, inspect.NoneType)), name, version)
        case inspect.StructType(cls=cls):
            return drawn(cls, version)
        case inspect.VarTupleType(item_type=item_type):
            smallest = 3 if name == "vertices" else 0
            return st.lists(_values(item_type, name, version), min_size=smallest, max_size=smallest + 2).map(tuple)
        case inspect.EnumType(cls=cls):
            return st.sampled_from([member for member in cls if _has_word(member.value, version)])
        case inspect.StrType():
            return st.sampled_from(OPEN_WORDS[name]) if name in OPEN_WORDS else st.text(max_size=6)
        case inspect.BoolType():
            return st.booleans()
        case inspect.IntType():
            return st.integers(1 if name == "degree" else 0, 2**32 - 1)
        case inspect.FloatType():
            return st.floats(0.0, 1.0)
        case _:
            return st.sampled_from(["EPAL", 8.5, True, [1], {"deep": 1}])


def _has_word(word: str, version: Version) -> bool:
    """Whether a version has a word of an enumeration. 2.1 has PAUSED in its text only, and not in its schema."""
    words_of_2 = {"AUTOACK"}
    words_of_3 = {"HIBERNATING", "STARTUP", "INTERVENED", "SINGLE", "URGENT", "CRITICAL", "PAUSED", "RETRIABLE"}
    return word not in (words_of_2 if version is Version.V3_0 else words_of_3)
