"""ROS messages as JSON and back, and the lines that the bridge writes."""

from __future__ import annotations

import base64
import contextlib
import importlib
import json
import math
import os
import sys
from typing import Any


def interface(type_name: str, kind: str) -> Any:
    """The class of a ROS type, such as `std_msgs/msg/Bool`. Raises ValueError, which says what to do."""
    package, written_kind, name = [*type_name.split("/"), "", ""][:3]
    if not name or written_kind != kind:
        raise ValueError(f"{type_name!r} is not a type of this kind: write it as package/{kind}/Name")
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"the type {type_name} is not installed ({error}): source the set-up of the workspace that has it") from None


def plain(value: Any) -> Any:
    """A ROS value as JSON: messages as objects, bytes in base64, NaN and infinities as null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bool | int | str):
        return value
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes) or getattr(value, "typecode", None) in ("b", "B"):
        return base64.b64encode(bytes(value)).decode()
    if hasattr(value, "tolist"):
        value = value.tolist()
    return [plain(item) for item in value]


def fill(message: Any, values: Any, place: str = "") -> Any:
    """Set the fields of a ROS message from JSON, and return it. Raises ValueError, which names the field."""
    if not isinstance(values, dict):
        raise ValueError(f"{place or 'the message'} has fields, and is not {values!r}")
    types = message.get_fields_and_field_types()
    for name, value in values.items():
        path = f"{place}.{name}" if place else name
        if name not in types:
            raise ValueError(f"{path}: {type(message).__name__} has no such field; it has {', '.join(types)}")
        try:
            setattr(message, name, _converted(getattr(message, name), types[name], value, path))
        except (AssertionError, TypeError, OverflowError):
            raise ValueError(f"{path} is of the type {types[name]}, and cannot be {value!r}") from None
    return message


def _converted(current: Any, type_name: str, value: Any, path: str) -> Any:
    if hasattr(current, "get_fields_and_field_types"):
        if isinstance(value, list):
            # Releases of Nav2 have poses as a list, or as a message that has a list.
            lists = [name for name, type in current.get_fields_and_field_types().items() if type.startswith("sequence<")]
            value = {lists[0]: value} if len(lists) == 1 else value
        return fill(current, value, path)
    if type_name.startswith("sequence<") or type_name.endswith("]"):
        element = type_name.removeprefix("sequence<").partition(",")[0].rstrip(">").partition("[")[0]
        if "/" in element:
            package, _, name = element.partition("/")
            return [fill(interface(f"{package}/msg/{name}", "msg")(), item, f"{path}[{index}]") for index, item in enumerate(value)]
        return [_number(item, element) for item in value]
    return _number(value, type_name)


def _number(value: Any, type_name: str) -> Any:
    """YAML does not tell 1.0 from 1: ROS does."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and type_name in ("float", "double"):
        return float(value)
    if is_number and "int" in type_name and float(value).is_integer():
        return int(value)
    return value


def write_line(**fields: Any) -> None:
    line = json.dumps(fields, allow_nan=False, separators=(",", ":")).encode() + b"\n"
    with contextlib.suppress(BrokenPipeError):  # the adapter has ended: so has the input
        while line:
            line = line[os.write(sys.stdout.fileno(), line) :]
