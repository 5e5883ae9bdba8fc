"""What happened to the map, in words."""

from __future__ import annotations

import math
from collections.abc import Iterable
from datetime import datetime

from somrs.gui.pages.map.moves import HELD, IN, ON, TURNED, X, Y, Z
from somrs.ontology.objects import Change, FactAdded, FactRemoved, ObjectAdded, ObjectRemoved, ValueSet, objects_of
from somrs.ontology.types import UNKNOWN, WORKING, AttributeType, Ontology, Value
from somrs.protocol.messages.knowledge import Event

PLACED = {ON: "put on", IN: "put into", HELD: "taken by"}
MOST = 6
"""So many objects are spoken of one by one."""


def told(event: Event, ontology: Ontology) -> list[str]:
    """What an event did, a sentence for each object."""
    lines = [f"{one.name} is called {one.to} now" for one in event.renamed]
    if event.revision is not None:
        names = [one.name for one in event.revision.after.all_definitions()] or [
            one.name for one in event.revision.before.all_definitions()
        ]
        lines.append(f"the ontology changed: {', '.join(names[:MOST])}{' …' if len(names) > MOST else ''}")
    lines += sentences(event.changes, ontology)
    total = event.all_changes if event.all_changes is not None else len(event.changes)
    if total > len(event.changes):
        lines.append(f"and more: {total} changes in all")
    return lines


def sentences(changes: Iterable[Change], ontology: Ontology) -> list[str]:
    """What the changes do, a sentence for each object."""
    by_object: dict[str, list[Change]] = {}
    for change in changes:
        by_object.setdefault(objects_of(change)[0], []).append(change)
    lines = [f"{name} {', '.join(_about(name, these, ontology))}" for name, these in by_object.items()]
    return lines if len(lines) <= MOST else [*lines[:MOST], f"and {len(lines) - MOST} more objects"]


def _about(name: str, changes: list[Change], ontology: Ontology) -> list[str]:
    said: list[str] = []
    values = {change.path: change.value for change in changes if isinstance(change, ValueSet)}
    for change in changes:
        match change:
            case ObjectAdded(object):
                said.append(f"added, a {object.type}")
            case ObjectRemoved():
                said.append("removed")
            case FactAdded(fact) if fact.relation in PLACED and len(fact.arguments) == 2:
                said.append(f"{PLACED[fact.relation]} {fact.arguments[1]}")
            case FactAdded(fact):
                said.append(f"{fact.relation} {', '.join(fact.arguments[1:])}")
    gone = [change.fact for change in changes if isinstance(change, FactRemoved)]
    if any(isinstance(change, ObjectRemoved) for change in changes):
        return ["removed"]
    if X in values or Y in values:
        axes = ((axis, values.get(path)) for axis, path in (("x", X), ("y", Y)))
        where = ", ".join(f"{axis} {value:.2f} m" for axis, value in axes if isinstance(value, int | float))
        said.insert(0, f"moved to {where}" if where else "has no place any more")
    if isinstance(angle := values.get(TURNED), int | float):
        said.append(f"turned to {degrees(angle)}")
    for path, value in values.items():
        if path not in (X, Y, TURNED) and not (path == Z and (X in values or Y in values)):
            said.append(_value(path, value, ontology))
    replaced = any(isinstance(change, FactAdded) for change in changes)
    said += [f"no more {fact.relation} {', '.join(fact.arguments[1:])}" for fact in gone if not (replaced and fact.relation in PLACED)]
    return said


def _value(path: str, value: Value | None, ontology: Ontology) -> str:
    if path == UNKNOWN:
        return "is unknown: nobody knows where and how it is" if value is True else "is known again"
    if path == WORKING and isinstance(value, bool):
        return "works" if value else "is not working"
    attribute = ontology.attributes.get(path.rpartition(".")[2])
    return f"{path} taken away" if value is None else f"{path} set to {shown(value, attribute)}"


def shown(value: Value, attribute: AttributeType | None) -> str:
    """A value as people read it, with its unit."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    if attribute is not None and attribute.unit == "rad":
        return degrees(value)
    unit = {"percent": "%"}.get(attribute.unit, attribute.unit) if attribute is not None and attribute.unit else ""
    return f"{value:.6g} {unit}".rstrip()


def degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}°"


def at(seconds: float, *, exactly: bool = True) -> str:
    """A time, with the day where it is another one than today."""
    when = datetime.fromtimestamp(seconds)
    clock = f"{when:%H:%M:%S}" if exactly else f"{when:%H:%M}"
    return clock if when.date() == datetime.now().date() else f"{when:%d %b %Y}, {clock}"
