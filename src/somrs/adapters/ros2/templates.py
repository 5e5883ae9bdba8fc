"""Field paths of messages (`pose.pose.position.x`, `status[0].level`), and templates of messages (`{command: {position: "{x}"}}`)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from somrs.adapters.ros2.lines import Values

_STEP = re.compile(r"\.?([A-Za-z]\w*)|\[(\d+)\]")
_PLACEHOLDER = re.compile(r"\{(\w*)\}")

MISSING = object()
"""What `field_value` returns if the message has no such field."""


def path_steps(path: str) -> tuple[str | int, ...]:
    """The steps of a field path. Raises ValueError."""
    steps: list[str | int] = []
    position = 0
    while position < len(path):
        match = _STEP.match(path, position)
        if match is None or (match[1] is not None and (match[0][0] == ".") == (not steps)):
            raise ValueError(f"{path!r} is not a path of fields: write it as pose.pose.position.x or status[0].level")
        steps.append(match[1] if match[1] is not None else int(match[2]))
        position = match.end()
    return tuple(steps)


def field_value(message: object, path: str) -> Any:
    """The value of a field, given by its path; the whole message for an empty path; MISSING if there is none."""
    value: Any = message
    for step in path_steps(path):
        is_fitting = isinstance(value, Mapping) if isinstance(step, str) else isinstance(value, list)
        if not is_fitting:
            return MISSING
        try:
            value = value[step]
        except LookupError:
            return MISSING
    return value


def placeholders(template: object) -> Iterator[str]:
    """The names in braces in the texts of a template."""
    match template:
        case str():
            yield from _PLACEHOLDER.findall(template)
        case Mapping():
            for value in template.values():
                yield from placeholders(value)
        case list():
            for value in template:
                yield from placeholders(value)


def fill_in(template: Mapping[str, Any], values: Mapping[str, Any]) -> Values:
    """The message of a template. A text that is a placeholder alone becomes the value itself; others keep what is around it."""
    return {name: _filled(value, values) for name, value in template.items()}


def _filled(template: Any, values: Mapping[str, Any]) -> Any:
    match template:
        case str():
            alone = _PLACEHOLDER.fullmatch(template)
            return values[alone[1]] if alone is not None else _PLACEHOLDER.sub(lambda match: str(values[match[1]]), template)
        case Mapping():
            return fill_in(template, values)
        case list():
            return [_filled(value, values) for value in template]
        case _:
            return template


def differences(expected: Mapping[str, Any], message: object) -> list[str]:
    """The fields, by path, that do not have the expected value, each as `path is value`."""
    actual_values = {path: field_value(message, path) for path in expected}
    return [f"{path} is {'missing' if actual is MISSING else actual}" for path, actual in actual_values.items() if actual != expected[path]]
