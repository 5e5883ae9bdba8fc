"""Writes messages as JSON, strictly: each is valid against the official schema of its version."""

from __future__ import annotations

import math
from enum import StrEnum
from functools import cache
from typing import Any

import msgspec
from msgspec import Struct

from somrs.adapters.vda5050.messages.dialects import VALUES_IN_2, WORDS_IN_2, has_field, wire_name
from somrs.adapters.vda5050.messages.header import Header, Version
from somrs.adapters.vda5050.messages.orders import Deviation
from somrs.adapters.vda5050.messages.states import State


def encode(message: Struct, header: Header, version: Version) -> bytes:
    """Write a message with its header. Raises ValueError when a number is not finite: JSON has no such numbers (3.0, 7.1.4)."""
    return msgspec.json.encode({**_written(header, Version.V3_0), **_written(message, version)})


@cache
def _fields(owner: type[Struct], version: Version) -> tuple[tuple[str, str, str, bool], ...]:
    """Of the fields that the version has: the attribute, the name in 3.0, the name in the version, and whether it is required."""
    return tuple(
        (field.name, field.encode_name, wire_name(owner, field.encode_name, version), field.required)
        for field in msgspec.structs.fields(owner)
        if has_field(owner, field.encode_name, version)
    )


def _written(value: Any, version: Version) -> Any:
    match value:
        case StrEnum():
            return value.value if version is Version.V3_0 else VALUES_IN_2.get(value, value.value)
        case Deviation() if version is not Version.V3_0:
            return _written(min(value.a, value.b), version)
        case Struct():
            return _written_struct(value, version)
        case list() | tuple():
            return [_written(item, version) for item in value]
        case float() if not math.isfinite(value):
            raise ValueError(f"{value} cannot be sent: VDA 5050 has finite numbers only")
        case _:
            return value


def _written_struct(message: Struct, version: Version) -> dict[str, Any]:
    owner, written = type(message), {}
    for attribute, name, written_name, is_required in _fields(owner, version):
        value = getattr(message, attribute)
        if value is None and not is_required:
            continue
        words = WORDS_IN_2.get((owner, name)) if version is not Version.V3_0 else None
        if words is not None:
            value = words.get(value, value) if isinstance(value, str) else [words.get(item, item) for item in value]
        written[written_name] = _written(value, version)
    if isinstance(message, State) and version is not Version.V3_0:
        written["actionStates"] += _written(message.instant_action_states, version)
    return written
