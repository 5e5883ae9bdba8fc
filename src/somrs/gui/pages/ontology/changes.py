"""Changes of the ontology as texts: old and new values, and the effects on the map."""

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
    "required": "Required",
    "parts": "Parts",
    "closed": "No other parts",
    "constraints": "Rules",
    "defaults": "Defaults",
    "driver": "Driver",
    "doc": "Description",
    "kind": "Kind",
    "unit": "Unit",
    "tolerance": "Equal within",
    "minimum": "At least",
    "maximum": "At most",
    "values": "Values",
    "joins": "Joins",
    "symmetric": "Symmetric",
    "functional": "Functional",
    "excludes": "Group",
    "parameters": "Parameters",
    "attribute": "Reads",
    "precondition": "Precondition",
    "invariant": "While it runs",
    "effect": "Effect",
    "inputs": "Inputs",
    "outputs": "Outputs",
    "handlers": "Handlers",
    "cost": "Cost",
}
"""Labels of the fields of definitions."""


@dataclass(frozen=True, slots=True)
class Difference:
    """A changed field of a definition; `before` or `after` is empty if the field had or has no value."""

    field: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class DefinitionChange:
    """A change of one definition: `verb` is added, removed, renamed or changed; `name` is the new name."""

    section: Section
    name: str
    verb: str
    old_name: str
    differences: tuple[Difference, ...] = ()


def definition_changes(revision: Revision | None, renamings: Iterable[Renaming] = ()) -> list[DefinitionChange]:
    """The changes of a revision, one per definition; renamed definitions first."""
    if revision is None:
        return []
    new_names = {(renaming.section.value, renaming.name): renaming.to for renaming in renamings}
    definitions_before = {(section_of(definition).key, definition.name): definition for definition in revision.before.all_definitions()}
    definitions_after = {(section_of(definition).key, definition.name): definition for definition in revision.after.all_definitions()}
    changes = []
    for (key, name), old in definitions_before.items():
        new_name = new_names.get((key, name), name)
        new = definitions_after.pop((key, new_name), None)
        verb = "removed" if new is None else "renamed" if new_name != name else "changed"
        # For added and removed definitions, the name is enough.
        other_differences = (
            tuple(difference for difference in differences(old, new) if difference.field != FIELDS["name"]) if new is not None else ()
        )
        changes.append(DefinitionChange(SECTION[key], new_name, verb, name, other_differences))
    changes += [DefinitionChange(SECTION[key], name, "added", name) for key, name in definitions_after]
    return sorted(changes, key=lambda change: ("renamed", "added", "removed", "changed").index(change.verb))


def differences(old: Definition, new: Definition) -> list[Difference]:
    """The fields in which two definitions of the same kind differ."""
    field_differences = []
    for name in old.__struct_fields__:
        old_value, new_value = getattr(old, name), getattr(new, name)
        if old_value != new_value:
            field_differences += _field_differences(name, old_value, new_value)
    return field_differences


def _field_differences(name: str, old_value: object, new_value: object) -> list[Difference]:
    label = FIELDS.get(name, name)
    if isinstance(old_value, dict) and isinstance(new_value, dict):
        keys = [key for key in {**old_value, **new_value} if old_value.get(key) != new_value.get(key)]
        return [Difference(f"{label}: {key}", _text(old_value.get(key)), _text(new_value.get(key))) for key in keys]
    if isinstance(old_value, tuple) and isinstance(new_value, tuple):
        if set(map(_text, old_value)) == set(map(_text, new_value)):
            return [Difference(f"{label} (order)", _list(old_value), _list(new_value))]
        removed_values, added_values = (
            [value for value in old_value if value not in new_value],
            [value for value in new_value if value not in old_value],
        )
        return [Difference(label, _list(removed_values), _list(added_values))]
    return [Difference(label, _text(old_value), _text(new_value))]


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
            condition = f" when {value.when}" if value.when else ""
            return f"on {value.on.value}{condition}: {value.effect}"
        case msgspec.Struct():
            return str(msgspec.to_builtins(value))
        case _:
            return str(value)


# Changes of the map


def map_change_lines(changes: Iterable[Change]) -> list[str]:
    """The changes of the map as lines; objects with the same change share a line."""
    names_by_text: dict[str, list[str]] = {}
    for change in changes:
        match change:
            case ObjectAdded(object):
                names_by_text.setdefault(f"becomes a {object.type}", []).append(object.name)
            case ObjectRemoved(name):
                names_by_text.setdefault("goes", []).append(name)
            case ValueSet(name, path, value):
                value_change = f"loses its {path}" if value is None else f"has {path} {value_text(value)}"
                names_by_text.setdefault(value_change, []).append(name)
            case FactAdded(fact) | FactRemoved(fact):
                fact_change = f"the fact {fact} is added" if isinstance(change, FactAdded) else f"the fact {fact} goes"
                names_by_text.setdefault(fact_change, [])
    return [f"{_names(names)} {text}".strip() for text, names in names_by_text.items()]


def _names(names: list[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more: each" if len(names) > 4 else "")


def summary(changes: Iterable[DefinitionChange]) -> str:
    """All changes in one line: `Jar changed (Defaults: Weight)`."""
    phrases = []
    for change in changes:
        match change.verb:
            case "renamed":
                phrases.append(f"{change.old_name} renamed to {change.name}")
            case "changed":
                fields: Mapping[str, None] = dict.fromkeys(difference.field for difference in change.differences)
                phrases.append(f"{change.name} changed ({', '.join(fields)})")
            case _:
                phrases.append(f"{change.name} {change.verb}")
    return "; ".join(phrases[:3]) + (f"; and {len(phrases) - 3} more" if len(phrases) > 3 else "")
