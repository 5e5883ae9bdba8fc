"""Changes of the map as texts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from datetime import datetime

from somrs.gui.pages.map.moves import HELD_RELATION, IN_RELATION, ON_RELATION, TURNED, X, Y, Z
from somrs.ontology.objects import Change, FactAdded, FactRemoved, ObjectAdded, ObjectRemoved, ValueSet, objects_of
from somrs.ontology.types import PROBLEM, UNKNOWN, WORKING, AttributeType, Ontology, Value
from somrs.protocol.messages.knowledge import Event

_PLACEMENT_WORDS = {ON_RELATION: "put on", IN_RELATION: "put into", HELD_RELATION: "taken by"}
MAX_OBJECTS = 6
"""Limit of objects that are listed individually."""


def describe_event(event: Event, ontology: Ontology) -> list[str]:
    """Describe an event, a sentence for each object."""
    lines = [f"{renaming.name} was renamed to {renaming.to}" for renaming in event.renamed]
    lines += [f"{merging.name} turned out to be {merging.into}" for merging in event.merged]
    if event.revision is not None:
        names = [definition.name for definition in event.revision.after.all_definitions()] or [
            definition.name for definition in event.revision.before.all_definitions()
        ]
        lines.append(f"the ontology changed: {', '.join(names[:MAX_OBJECTS])}{' …' if len(names) > MAX_OBJECTS else ''}")
    lines += describe_changes(event.changes, ontology)
    total = event.all_changes if event.all_changes is not None else len(event.changes)
    if total > len(event.changes):
        lines.append(f"{total} changes in total")
    return lines


def describe_changes(changes: Iterable[Change], ontology: Ontology) -> list[str]:
    """Describe changes, a sentence for each object."""
    by_object: dict[str, list[Change]] = {}
    for change in changes:
        by_object.setdefault(objects_of(change)[0], []).append(change)
    lines = [f"{name} {', '.join(_change_phrases(object_changes, ontology))}" for name, object_changes in by_object.items()]
    return lines if len(lines) <= MAX_OBJECTS else [*lines[:MAX_OBJECTS], f"and {len(lines) - MAX_OBJECTS} more objects"]


def _change_phrases(changes: list[Change], ontology: Ontology) -> list[str]:
    phrases: list[str] = []
    values = {change.path: change.value for change in changes if isinstance(change, ValueSet)}
    for change in changes:
        match change:
            case ObjectAdded(object):
                phrases.append(f"added, a {object.type}")
            case ObjectRemoved():
                phrases.append("removed")
            case FactAdded(fact) if fact.relation in _PLACEMENT_WORDS and len(fact.arguments) == 2:
                phrases.append(f"{_PLACEMENT_WORDS[fact.relation]} {fact.arguments[1]}")
            case FactAdded(fact):
                phrases.append(f"{fact.relation} {', '.join(fact.arguments[1:])}")
    removed_facts = [change.fact for change in changes if isinstance(change, FactRemoved)]
    if any(isinstance(change, ObjectRemoved) for change in changes):
        return ["removed"]
    if X in values or Y in values:
        axes = ((axis, values.get(path)) for axis, path in (("x", X), ("y", Y)))
        position_text = ", ".join(f"{axis} {value:.2f} m" for axis, value in axes if isinstance(value, int | float))
        phrases.insert(0, f"moved to {position_text}" if position_text else "no longer has a position")
    if isinstance(angle := values.get(TURNED), int | float):
        phrases.append(f"turned to {_format_degrees(angle)}")
    for path, value in values.items():
        if path not in (X, Y, TURNED) and not (path == Z and (X in values or Y in values)):
            phrases.append(_value_phrase(path, value, ontology))
    replaced = any(isinstance(change, FactAdded) for change in changes)
    phrases += [
        f"no longer {fact.relation} {', '.join(fact.arguments[1:])}"
        for fact in removed_facts
        if not (replaced and fact.relation in _PLACEMENT_WORDS)
    ]
    return phrases


def _value_phrase(path: str, value: Value | None, ontology: Ontology) -> str:
    if path == UNKNOWN:
        return "has an unknown position and state" if value is True else "has a known position and state again"
    if path == WORKING and isinstance(value, bool):
        return "works" if value else "is not working"
    if path == PROBLEM:
        return str(value) if value else "has no problem any more"
    attribute = ontology.attributes.get(path.rpartition(".")[2])
    return f"{path} removed" if value is None else f"{path} set to {format_value(value, attribute)}"


def format_value(value: Value, attribute: AttributeType | None) -> str:
    """Format a value with its unit."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    if attribute is not None and attribute.unit == "rad":
        return _format_degrees(value)
    unit = {"percent": "%"}.get(attribute.unit, attribute.unit) if attribute is not None and attribute.unit else ""
    return f"{value:.6g} {unit}".rstrip()


def _format_degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}°"


def format_time(seconds: float, *, exactly: bool = True) -> str:
    """Format a local time; the date is included unless it is today."""
    moment = datetime.fromtimestamp(seconds)
    clock = f"{moment:%H:%M:%S}" if exactly else f"{moment:%H:%M}"
    return clock if moment.date() == datetime.now().date() else f"{moment:%d %b %Y}, {clock}"
