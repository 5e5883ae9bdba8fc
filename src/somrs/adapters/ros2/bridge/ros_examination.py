"""Whether topics, services and actions are there, with the types and fields that somebody expects of them. Nothing is sent to them."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from somrs.adapters.ros2.bridge.ros_values import fill, interface
else:
    from ros_values import fill, interface

KINDS = {"topic": "msg", "publication": "msg", "service": "srv", "action": "action"}
"""The folders of the types: of a topic that is listened to, one to which is sent, a service, and an action."""


def examine(node: Any, request: dict[str, Any]) -> tuple[str, bool]:
    """What is wrong, or an empty text; and whether it may come right when more nodes are there."""
    try:
        check_type(request)
    except ValueError as error:
        return str(error), False
    return presence(node, request), True


def check_type(request: dict[str, Any]) -> None:
    """Raises ValueError, which says what of a type is wrong."""
    kind = request["kind"]
    type = interface(request["type"], KINDS[kind])
    sent = type if kind == "publication" else type.Request if kind == "service" else type.Goal if kind == "action" else None
    if sent is not None:
        fill(sent(), request["template"])
    received = type if kind == "topic" else type.Response if kind == "service" else type.Result if kind == "action" else None
    for path in request["fields"]:
        follow(received, path)


def follow(type: Any, path: str) -> None:
    """Go along a path of fields. Raises ValueError, which names the field that is not there."""
    message: Any = type() if type is not None else None
    place = ""
    for name, index in re.findall(r"([A-Za-z]\w*)|\[(\d+)\]", path):
        if index:
            if not isinstance(message, str) or not (message.startswith("sequence<") or message.endswith("]")):
                raise ValueError(f"{place or 'the message'} is no list, and has no [{index}]")
            message = message.removeprefix("sequence<").partition(",")[0].rstrip(">").partition("[")[0]
            place += f"[{index}]"
        else:
            types = message.get_fields_and_field_types() if hasattr(message, "get_fields_and_field_types") else {}
            if name not in types:
                has = f"has the fields {', '.join(types)}" if types else "has no fields"
                raise ValueError(f"there is no field {path}: {place or 'the message'} {has}")
            message, place = types[name], f"{place}.{name}" if place else name
        if isinstance(message, str) and "/" in message and not message.startswith("sequence<") and not message.endswith("]"):
            package, _, type_name = message.partition("/")
            message = interface(f"{package}/msg/{type_name}", "msg")()


def presence(node: Any, request: dict[str, Any]) -> str:
    kind, name, type = request["kind"], request["name"], request["type"]
    types_by_name = dict(named(node, kind))
    if name in types_by_name:
        types = types_by_name[name]
        if type not in types:
            return f"{name} is of the type {', '.join(sorted(types))}, and not {type}"
        if kind == "topic" and not node.count_publishers(name):
            return f"nobody publishes {name}"
        if kind == "publication" and not node.count_subscribers(name):
            return f"nobody subscribes to {name}"
        return ""
    noun = "topic" if kind == "publication" else kind
    candidates = [other for other, types in types_by_name.items() if type in types]
    candidates = difflib.get_close_matches(name, candidates, 3, 0.0) or difflib.get_close_matches(name, types_by_name, 3)
    advice = f"is it {' or '.join(candidates)}?" if candidates else f"does the robot run, and does `ros2 {noun} list` show it?"
    return f"there is no {noun} {name}: {advice}"


def named(node: Any, kind: str) -> Iterable[tuple[str, list[str]]]:
    if kind == "action":
        from rclpy.action import get_action_names_and_types

        names: Iterable[tuple[str, list[str]]] = get_action_names_and_types(node)
    elif kind == "service":
        names = node.get_service_names_and_types()
    else:
        names = [(name, types) for name, types in node.get_topic_names_and_types() if node.count_publishers(name) or kind == "publication"]
    return names
