"""Reads messages, tolerantly: what a vehicle writes otherwise than its version says is understood where it is clear, and named."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from functools import cache
from typing import Any

import msgspec
from msgspec import Struct, inspect

from somrs.adapters.vda5050.messages.dialects import VALUES_IN_2, WORDS_IN_2, wire_name
from somrs.adapters.vda5050.messages.factsheets import Factsheet
from somrs.adapters.vda5050.messages.header import Header, Topic, Version
from somrs.adapters.vda5050.messages.orders import Deviation, InstantActions, Order, Responses, ZoneSet
from somrs.adapters.vda5050.messages.states import (
    ActionStatus,
    Connection,
    ConnectionState,
    EmergencyStop,
    ErrorLevel,
    OperatingMode,
    RequestStatus,
    State,
    Visualization,
)
from somrs.errors import InputError

MESSAGES: Mapping[Topic, type[Struct]] = {
    Topic.ORDER: Order,
    Topic.INSTANT_ACTIONS: InstantActions,
    Topic.RESPONSES: Responses,
    Topic.ZONE_SET: ZoneSet,
    Topic.STATE: State,
    Topic.VISUALIZATION: Visualization,
    Topic.CONNECTION: Connection,
    Topic.FACTSHEET: Factsheet,
}

SAFE: Mapping[type[StrEnum], StrEnum] = {
    ErrorLevel: ErrorLevel.FATAL,
    ActionStatus: ActionStatus.RUNNING,
    OperatingMode: OperatingMode.MANUAL,
    EmergencyStop: EmergencyStop.MANUAL,
    ConnectionState: ConnectionState.CONNECTION_BROKEN,
    RequestStatus: RequestStatus.REQUESTED,
}
"""What a word means that is not in an enumeration: what has nobody rely on the vehicle."""

DEFAULTS: Mapping[tuple[str, str], Any] = {
    ("State", "orderId"): "",
    ("State", "orderUpdateId"): 0,
    ("State", "lastNodeId"): "",
    ("State", "lastNodeSequenceId"): 0,
    ("State", "powerSupply"): {"stateOfCharge": 100.0, "charging": False},
    ("State", "safetyState"): {"activeEmergencyStop": "NONE", "fieldViolation": False},
    ("SafetyState", "activeEmergencyStop"): "NONE",
    ("SafetyState", "fieldViolation"): False,
    ("PowerSupply", "stateOfCharge"): 100.0,
    ("PowerSupply", "charging"): False,
    ("Position", "localized"): True,
    ("VehicleError", "errorLevel"): "FATAL",
    ("Action", "blockingType"): "HARD",
    ("Header", "headerId"): 0,
    ("Header", "timestamp"): "",
    ("Header", "version"): "",
    ("Header", "manufacturer"): "",
    ("Header", "serialNumber"): "",
}
"""By struct and field of 3.0: the values of required fields that are absent. Arrays are empty then, and parts of a factsheet zero."""

MOST_BYTES = 4_000_000
"""Of a message; factsheets may have drawings."""

FACTSHEET = "somrs.adapters.vda5050.messages.factsheets"


class Received(Struct, frozen=True, kw_only=True):
    """A message that has been read. `deviations`: what was tolerated, each a field and what is wrong with it."""

    header: Header
    message: Struct
    deviations: tuple[str, ...] = ()


def decode(topic: Topic, payload: bytes, version: Version) -> Received:
    """Read a message of a topic. Raises InputError when it is no such message."""
    if len(payload) > MOST_BYTES:
        raise InputError(f"{topic}: has more than {MOST_BYTES} bytes")
    try:
        document = msgspec.json.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{topic}: is no JSON: {error}") from error
    if not isinstance(document, dict):
        raise InputError(f"{topic}: is no JSON object")
    reader = _Reader(version)
    header = reader.struct(document, Header, topic.value, strange=False)
    message = reader.struct(document, MESSAGES[topic], topic.value)
    try:
        return Received(
            header=msgspec.convert(header, Header),
            message=msgspec.convert(message, MESSAGES[topic]),
            deviations=tuple(dict.fromkeys(reader.deviations)),
        )
    except msgspec.ValidationError as error:
        raise InputError(f"{topic}: {error}") from error


@cache
def _fields(owner: type[Struct]) -> tuple[inspect.Field, ...]:
    info = inspect.type_info(owner)
    assert isinstance(info, inspect.StructType)
    return info.fields


@cache
def _words(owner: type[Struct], name: str) -> Mapping[str, str]:
    return {old: new for new, old in WORDS_IN_2.get((owner, name), {}).items()}


def _plain(word: str) -> str:
    return word.replace("_", "").replace("-", "").replace(" ", "").upper()


HEADER_NAMES = frozenset(field.encode_name for field in msgspec.structs.fields(Header))


class _Reader:
    """Turns JSON values of a version into those of 3.0, which `msgspec.convert` checks afterwards."""

    def __init__(self, version: Version) -> None:
        self.version = version
        self.deviations: list[str] = []

    def struct(self, document: Mapping[str, Any], owner: type[Struct], path: str, *, strange: bool = True) -> dict[str, Any]:
        """`strange`: whether fields that the struct does not have are named."""
        values: dict[str, Any] = {}
        spellings: dict[str, str] | None = None
        read: set[str] = set()
        for field in _fields(owner):
            name = field.encode_name
            key: str | None = wire_name(owner, name, self.version)
            if key not in document:
                if spellings is None:
                    spellings = {_plain(spelling): spelling for spelling in document}
                key = self._spelling(document, spellings, owner, name, path)
            if key is not None:
                read.add(key)
            value = document.get(key) if key is not None else None
            if value is None:
                if key is not None:
                    self._note(path, key, "is null")
                if field.required:
                    values[name] = self._default(owner, field, path)
                continue
            values[name] = self._value(value, field.type, f"{path}.{key}", _words(owner, name) if self.version.major == 2 else {})
        if strange:
            self._name_strange_fields(document, owner, read, path)
        return values

    def _spelling(self, document: Mapping[str, Any], spellings: Mapping[str, str], owner: type[Struct], name: str, path: str) -> str | None:
        """The key under which a field is that is not under its name: in wrong case, or by the name of another version."""
        for version in (self.version, Version.V2_1, Version.V2_0, Version.V3_0):
            expected = wire_name(owner, name, version)
            if expected in document:
                self._note(path, expected, f"belongs to {version}")
                return expected
            if (key := spellings.get(_plain(expected))) is not None:
                self._note(path, key, f"is written {key}")
                return key
        return None

    def _default(self, owner: type[Struct], field: inspect.Field, path: str) -> Any:
        name = field.encode_name
        written_name = wire_name(owner, name, self.version)
        if owner is not State or name != "instantActionStates" or self.version.major > 2:
            self._note(path, written_name, "is absent")
        if (default := DEFAULTS.get((owner.__name__, name))) is not None:
            return default
        match field.type:
            case inspect.VarTupleType():
                return []
            case inspect.StructType(cls=cls) if cls.__module__ == FACTSHEET:
                return _Reader(self.version).struct({}, cls, f"{path}.{written_name}")
            case inspect.FloatType() | inspect.IntType() if owner.__module__ == FACTSHEET:
                return 0
            case inspect.StrType() if owner.__module__ == FACTSHEET:
                return ""
            case _:
                raise InputError(f"{path}.{written_name} is absent")

    def _name_strange_fields(self, document: Mapping[str, Any], owner: type[Struct], read: set[str], path: str) -> None:
        header_names = HEADER_NAMES if owner in MESSAGES.values() else frozenset()
        for key, value in document.items():
            if key not in read and key not in header_names and value is not None and key not in OF_NO_USE.get(owner.__name__, ()):
                self._note(path, key, "is unknown")

    def _value(self, value: Any, expected: inspect.Type, path: str, words: Mapping[str, str]) -> Any:
        match expected:
            case inspect.UnionType(types=types):
                return self._value(value, next(item for item in types if not isinstance(item, inspect.NoneType)), path, words)
            case inspect.StructType(cls=cls):
                if cls is Deviation and isinstance(value, int | float):
                    return {"a": value, "b": value, "theta": 0.0}
                if not isinstance(value, dict):
                    raise InputError(f"{path} is no object")
                return self.struct(value, cls, path)
            case inspect.VarTupleType(item_type=item_type):
                if not isinstance(value, list):
                    self._note(path, "", "is no array")
                    value = [value]
                return [self._value(item, item_type, path, words) for item in value if item is not None]
            case inspect.EnumType(cls=cls):
                assert issubclass(cls, StrEnum)
                return self._word(value, cls, path)
            case inspect.StrType():
                if not isinstance(value, str):
                    self._note(path, "", "is no text")
                    value = msgspec.json.encode(value).decode()
                return words.get(value, value)
            case inspect.IntType() | inspect.FloatType() | inspect.BoolType():
                return self._scalar(value, expected, path)
            case _:
                return value

    def _scalar(self, value: Any, expected: inspect.Type, path: str) -> Any:
        read = _BOOLEANS.get(value.lower(), value) if isinstance(value, str) else value
        if isinstance(expected, inspect.BoolType):
            if isinstance(read, int) and not isinstance(read, bool) and read in (0, 1):
                read = bool(read)
        elif isinstance(read, bool | str):
            try:
                read = float(read)
            except ValueError:
                raise InputError(f"{path} is no number: {value!r}") from None
            if not math.isfinite(read):
                raise InputError(f"{path} is no number: {value!r}")
        if isinstance(expected, inspect.IntType) and isinstance(read, float) and read.is_integer():
            read = int(read)
        if type(read) is not type(value):
            self._note(path, "", f"is {_KINDS.get(type(value), 'something else')}")
        return read

    def _word(self, value: Any, kind: type[StrEnum], path: str) -> str:
        words = _enumeration(kind, self.version.major)
        if isinstance(value, str) and (member := words.get(value)) is not None:
            return member
        plain = _plain(str(value))
        member = next((member for word, member in words.items() if _plain(word) == plain), None)
        member = member or next((item.value for item in kind if _plain(item.value) == plain), None)
        if member is None and kind in SAFE:
            member = SAFE[kind].value
        if member is None:
            raise InputError(f"{path} is {value!r}, and not one of {', '.join(words)}")
        self._note(path, "", f"is {value!r}")
        return member

    def _note(self, path: str, key: str, problem: str) -> None:
        self.deviations.append(f"{path}.{key} {problem}" if key else f"{path} {problem}")


_BOOLEANS = {"true": True, "false": False}
_KINDS: Mapping[type, str] = {str: "text", bool: "a truth value", float: "a fraction", int: "a number"}

OF_NO_USE: Mapping[str, frozenset[str]] = {
    "State": frozenset({"plannedPath", "intermediatePath"}),
    "StoredMap": frozenset({"mapDescription", "mapDescriptor"}),
    "Position": frozenset({"mapDescription"}),
    "NodePosition": frozenset({"mapDescription"}),
    "VehicleError": frozenset({"errorDescriptionTranslations", "errorHintTranslations"}),
    "Visualization": frozenset({"plannedPath", "intermediatePath"}),
    "Edge": frozenset({"rotationAllowed"}),
    "Geometry": frozenset({"wheelDefinitions", "envelopes3d"}),
    "Configuration": frozenset({"versions", "network"}),
    "ArrayLengths": frozenset(
        f"{owner}.{name}"
        for owner, names in {
            "edge": ["actions"],
            "actions": ["actionsParameters"],
            "trajectory": ["knotVector", "controlPoints"],
            "state": ["nodeStates", "edgeStates", "loads", "actionStates", "instantActionStates", "zoneActionStates", "errors"],
            "error": ["errorReferences"],
            "information": ["infoReferences"],
        }.items()
        for name in names
    )
    | {"state.information"},
    "LoadSet": frozenset(
        {"description", "agvAccelerationLimit", "agvDecelerationLimit", "maximumAcceleration", "maximumDeceleration"}
        | {f"{limit}Loadhandling{size}" for limit in ("min", "max", "minimum", "maximum") for size in ("Depth", "Tilt")}
    ),
}
"""By struct: fields of the standard that nothing here needs."""


@cache
def _enumeration(kind: type[StrEnum], major: int) -> Mapping[str, str]:
    """The words of an enumeration in a version, and what they are in 3.0."""
    if major >= 3:
        return {member.value: member.value for member in kind}
    renamed = {VALUES_IN_2[member]: member.value for member in kind if member in VALUES_IN_2}
    plain = {member.value: member.value for member in kind if member not in VALUES_IN_2}
    return {**renamed, **plain}
