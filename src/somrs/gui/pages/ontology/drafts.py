"""The content of a form while it is edited: plain values that a browser can store.

Numbers are kept as typed (`30 cm`), so that invalid input is not lost. Lists of rows stand for mappings, so that a row may be incomplete.
"""

from __future__ import annotations

from typing import Any

import msgspec

from somrs.gui.pages.ontology.sections import SECTION, Section, number
from somrs.ontology.types import AttributeType, Constraint, Definition, FunctionType, ObjectType, Value

Form = dict[str, Any]

LIMITS, FORMULA = "limits", "formula"
"""Kinds of rules of a type."""
BLANK_RULE: Form = {"sort": LIMITS, "attribute": None, "minimum": "", "maximum": "", "values": "", "formula": "", "doc": ""}
READ, TABLE, COMPUTED = "attribute", "table", "computed"
"""Sources of a function's value."""

ROW_NAMES = {"attributes": "attribute", "parts": "type", "defaults": "path", "inputs": "name", "outputs": "name", "values": "key"}
"""The field that identifies the rows of each list."""

_BLANK: dict[str, Form] = {
    "types": {
        "name": "", "parent": "Object", "doc": "", "driver": "", "attributes": [], "parts": [], "closed": False,
        "defaults": [], "constraints": [],
    },
    "attributes": {
        "name": "", "kind": "number", "unit": "", "tolerance": "", "minimum": "", "maximum": "", "values": "", "attributes": [],
        "constraints": [], "doc": "",
    },
    "relations": {"name": "", "joins": ["Object", "Object"], "symmetric": False, "functional": False, "excludes": "", "doc": ""},
    "functions": {"name": "", "parameters": ["Object"], "source": READ, "attribute": None, "values": [], "unit": "", "doc": ""},
    "services": {
        "name": "", "kind": "physical", "parent": None, "inputs": [], "outputs": [], "precondition": "", "invariant": "", "effect": "",
        "cost": "", "handlers": [], "doc": "",
    },
}  # fmt: skip


class Draft(msgspec.Struct, kw_only=True):
    """`name`: the definition that is edited, None for a new one. `original_data`: the definition at `version` of the ontology; `base`: its
    form."""

    section_key: str
    name: str | None
    version: int
    base: Form
    form: Form
    original_data: Form | None = msgspec.field(default=None, name="was")

    @property
    def original(self) -> Definition | None:
        """The definition that is edited, before the edits."""
        return msgspec.convert(self.original_data, self.section.struct) if self.original_data is not None else None

    @property
    def section(self) -> Section:
        return SECTION[self.section_key]

    @property
    def key(self) -> str:
        return f"{self.section_key}:{self.name or ''}"

    @property
    def dirty(self) -> bool:
        return self.form != self.base


def start_draft(section: Section, definition: Definition | None, version: int, **initial_values: object) -> Draft:
    """A draft of an existing definition, or of a new one with initial values."""
    base = form_of(definition) if definition is not None else {**_copy_form(_BLANK[section.key]), **initial_values}
    original_data = msgspec.to_builtins(definition) if definition is not None else None
    name = definition.name if definition is not None else None
    return Draft(section_key=section.key, name=name, version=version, base=base, form=_copy_form(base), original_data=original_data)


def merge_forms(base: Form, mine: Form, theirs: Form) -> tuple[Form, list[str]]:
    """Merge `theirs` into `mine`. Returns the merged form and the conflicts, in which `mine` wins: fields, or rows of them
    (`defaults.Weight`)."""
    result, conflicts = _copy_form(mine), []
    for key, value in theirs.items():
        if mine.get(key) == base.get(key) or value == mine.get(key):
            result[key] = _copy_form(value)
        elif value == base.get(key):
            continue
        elif key in ROW_NAMES and all(isinstance(row, dict) for rows in (base[key], mine[key], value) for row in rows):
            result[key], rows = _merge_rows(base[key], mine[key], value, ROW_NAMES[key])
            conflicts += [f"{key}.{name}" for name in rows]
        else:
            conflicts.append(key)
    return result, conflicts


def _merge_rows(base: list[Form], mine: list[Form], theirs: list[Form], name: str) -> tuple[list[Form], list[str]]:
    """Merge rows by name: in my order, followed by their new rows."""
    base_rows, my_rows, their_rows = ({str(row[name]): row for row in rows} for rows in (base, mine, theirs))
    result, conflicts = [], []
    for key in {**my_rows, **their_rows}:
        my_row, their_row, base_row = my_rows.get(key), their_rows.get(key), base_rows.get(key)
        if my_row != base_row and their_row not in (base_row, my_row):
            conflicts.append(key)
        chosen = their_row if my_row == base_row else my_row
        if chosen is not None:
            result.append(_copy_form(chosen))
    return result, conflicts


def _copy_form(form: Any) -> Any:
    return msgspec.json.decode(msgspec.json.encode(form))


def form_of(definition: Definition) -> Form:
    plain = msgspec.to_builtins(definition)
    form: Form = _copy_form({key: "" if value is None else value for key, value in plain.items()})
    match definition:
        case ObjectType():
            required = [{"attribute": name, "must": True} for name in definition.required]
            optional = [{"attribute": name, "must": False} for name in definition.attributes if name not in definition.required]
            form["attributes"] = required + optional
            del form["required"]
            form["parts"] = [{**part, "minimum": str(part["minimum"]), "maximum": _text(part["maximum"])} for part in form["parts"]]
            form["defaults"] = [{"path": path, "value": _text(value)} for path, value in definition.defaults.items()]
            form["constraints"] = [*map(_rule, definition.constraints)]
            form["parent"] = definition.parent
        case AttributeType():
            form["minimum"], form["maximum"] = _text(definition.minimum), _text(definition.maximum)
            form["values"] = ", ".join(definition.values)
            form["tolerance"] = _text(definition.tolerance) if definition.tolerance else ""
            form["constraints"] = [*map(_rule, definition.constraints)]
        case FunctionType():
            form["source"] = READ if definition.attribute else TABLE if definition.values else COMPUTED
            form["attribute"] = definition.attribute
            form["values"] = [{"key": key, "value": _text(value)} for key, value in definition.values.items()]
    if "handlers" in form:
        form["handlers"] = [
            {"on": handler["on"], "when": handler["when"] or "", "effect": handler["effect"]} for handler in form["handlers"]
        ]
        form["parent"] = form["parent"] or None
    return form


def _rule(rule: Constraint) -> Form:
    return {
        "sort": LIMITS if rule.formula is None else FORMULA,
        "attribute": rule.attribute,
        "minimum": _text(rule.minimum),
        "maximum": _text(rule.maximum),
        "values": ", ".join(map(_text, rule.values)),
        "formula": rule.formula or "",
        "doc": rule.doc,
    }


def _text(value: Value | None) -> str:
    match value:
        case None:
            return ""
        case bool():
            return "true" if value else "false"
        case str():
            return value
        case _:
            return number(value)
