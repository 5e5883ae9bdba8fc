"""Changes of the ontology put into words: what was before, what is after, and what happens on the map with it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import msgspec

from somrs.gui.pages.ontology.sections import SECTION, Section, constraint_text, part_text, section_of, value_text
from somrs.ontology.naming import Renaming
from somrs.ontology.objects import Change, FactAdded, FactRemoved, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.services import Handler, Parameter
from somrs.ontology.types import Constraint, Definition, Part
from somrs.protocol.messages.knowledge import Revision

FIELDS = {
    "name": "Name",
    "parent": "Parent",
    "attributes": "Attributes",
    "required": "Must have",
    "parts": "Parts",
    "constraints": "Rules",
    "defaults": "Defaults",
    "driver": "Driver",
    "doc": "Meaning",
    "kind": "Kind",
    "unit": "Unit",
    "tolerance": "Equal within",
    "minimum": "At least",
    "maximum": "At most",
    "values": "Values",
    "joins": "Joins",
    "symmetric": "Either way round",
    "functional": "One at a time",
    "excludes": "Group",
    "parameters": "Of",
    "attribute": "Reads",
    "precondition": "Holds before it",
    "effect": "Holds after it",
    "inputs": "Inputs",
    "outputs": "Outputs",
    "handlers": "Handlers",
    "cost": "Costs",
}
"""What the fields of definitions are called on the page."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One field of a definition that changed; empty where there was, or is, nothing."""

    field: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class Changed:
    """What happened to one definition: `verb` is added, removed, renamed or changed. `name` is the one it has after."""

    section: Section
    name: str
    verb: str
    old_name: str
    differences: tuple[Difference, ...] = ()


def changed(revision: Revision | None, renamed: Iterable[Renaming] = ()) -> list[Changed]:
    """What a revision does, definition by definition; the ones that are renamed first."""
    if revision is None:
        return []
    to = {(one.section.value, one.name): one.to for one in renamed}
    before = {(section_of(one).key, one.name): one for one in revision.before.all_definitions()}
    after = {(section_of(one).key, one.name): one for one in revision.after.all_definitions()}
    found = []
    for (key, name), old in before.items():
        new_name = to.get((key, name), name)
        new = after.pop((key, new_name), None)
        verb = "removed" if new is None else "renamed" if new_name != name else "changed"
        # A definition that goes and one that comes are told by their names alone.
        told = tuple(one for one in differences(old, new) if one.field != FIELDS["name"]) if new is not None else ()
        found.append(Changed(SECTION[key], new_name, verb, name, told))
    found += [Changed(SECTION[key], name, "added", name) for key, name in after]
    return sorted(found, key=lambda one: ("renamed", "added", "removed", "changed").index(one.verb))


def differences(old: Definition, new: Definition) -> list[Difference]:
    """The fields in which two definitions of the same kind differ."""
    found = []
    for name in old.__struct_fields__:
        before, after = getattr(old, name), getattr(new, name)
        if before != after:
            found += _of_field(name, before, after)
    return found


def _of_field(name: str, before: object, after: object) -> list[Difference]:
    label = FIELDS.get(name, name)
    if isinstance(before, dict) and isinstance(after, dict):
        keys = [key for key in {**before, **after} if before.get(key) != after.get(key)]
        return [Difference(f"{label}: {key}", _text(before.get(key)), _text(after.get(key))) for key in keys]
    if isinstance(before, tuple) and isinstance(after, tuple):
        if set(map(_text, before)) == set(map(_text, after)):
            return [Difference(f"{label} (order)", _list(before), _list(after))]
        gone, come = [one for one in before if one not in after], [one for one in after if one not in before]
        return [Difference(label, _list(gone), _list(come))]
    return [Difference(label, _text(before), _text(after))]


def _list(values: Iterable[object]) -> str:
    return ", ".join(map(_text, values))


def _text(value: object) -> str:
    match value:
        case None:
            return ""
        case bool() | float() | int() | str():
            return value_text(value)
        case Part():
            return f"{value.type} ({part_text(value)})"
        case Constraint():
            return f"{value.doc}: {constraint_text(value)}" if value.doc else constraint_text(value)
        case Parameter():
            return f"?{value.name}: {value.type}"
        case Handler():
            when = f" when {value.when}" if value.when else ""
            return f"on {value.on.value}{when}: {value.effect}"
        case msgspec.Struct():
            return str(msgspec.to_builtins(value))
        case _:
            return str(value)


# On the map


def on_map(changes: Iterable[Change]) -> list[str]:
    """How the map changes, a line for each kind of change and not for each object."""
    counted: dict[str, list[str]] = {}
    for change in changes:
        match change:
            case ObjectAdded(object):
                counted.setdefault(f"becomes a {object.type}", []).append(object.name)
            case ObjectRemoved(name):
                counted.setdefault("goes", []).append(name)
            case ValueSet(name, path, value):
                said = f"loses its {path}" if value is None else f"has {path} {value_text(value)}"
                counted.setdefault(said, []).append(name)
            case FactAdded(fact) | FactRemoved(fact):
                what = f"the fact {fact} is added" if isinstance(change, FactAdded) else f"the fact {fact} goes"
                counted.setdefault(what, [])
    return [f"{_names(names)} {said}".strip() for said, names in counted.items()]


def _names(names: list[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more: each" if len(names) > 4 else "")


def summary(changes: Iterable[Changed]) -> str:
    """All of it in a line: `Jar changed (Defaults: Weight)`."""
    said = []
    for one in changes:
        match one.verb:
            case "renamed":
                said.append(f"{one.old_name} renamed to {one.name}")
            case "changed":
                fields: Mapping[str, None] = dict.fromkeys(difference.field for difference in one.differences)
                said.append(f"{one.name} changed ({', '.join(fields)})")
            case _:
                said.append(f"{one.name} {one.verb}")
    return "; ".join(said[:3]) + (f"; and {len(said) - 3} more" if len(said) > 3 else "")
