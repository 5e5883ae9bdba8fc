"""What a person writes in a form, between its first letter and its being saved: plain values that a browser can keep, too.

Numbers are kept as they were typed (`30 cm`), so that nothing is lost of what is not yet right; rows stand for mappings, so that one may
be half filled in.
"""

from __future__ import annotations

from typing import Any

import msgspec

from somrs.gui.pages.ontology.sections import SECTION, Section, number
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, Value

Form = dict[str, Any]

LIMITS, FORMULA = "limits", "formula"
"""What a rule of a type is."""
READ, TABLE, COMPUTED = "attribute", "table", "computed"
"""Where a function's value comes from."""

ROW_NAMES = {"attributes": "attribute", "parts": "type", "defaults": "path", "inputs": "name", "outputs": "name", "values": "key"}
"""What rows are told apart by."""

BLANK: dict[str, Form] = {
    "types": {"name": "", "parent": "Object", "doc": "", "driver": "", "attributes": [], "parts": [], "defaults": [], "constraints": []},
    "attributes": {
        "name": "", "kind": "number", "unit": "", "tolerance": "", "minimum": "", "maximum": "", "values": "", "attributes": [], "doc": "",
    },
    "relations": {"name": "", "joins": ["Object", "Object"], "symmetric": False, "functional": False, "excludes": "", "doc": ""},
    "functions": {"name": "", "parameters": ["Object"], "source": READ, "attribute": None, "values": [], "unit": "", "doc": ""},
    "services": {
        "name": "", "kind": "physical", "parent": None, "inputs": [], "outputs": [], "precondition": "", "effect": "", "cost": "",
        "handlers": [], "doc": "",
    },
}  # fmt: skip


class Draft(msgspec.Struct, kw_only=True):
    """`name`: of the definition that is rewritten, None for a new one; `was`: what it was at `version` of the ontology, and `base` what
    the form said then."""

    section_key: str
    name: str | None
    version: int
    base: Form
    form: Form
    was: Form | None = None

    @property
    def original(self) -> Definition | None:
        """The definition that is rewritten, as it was."""
        return msgspec.convert(self.was, self.section.struct) if self.was is not None else None

    @property
    def section(self) -> Section:
        return SECTION[self.section_key]

    @property
    def key(self) -> str:
        return f"{self.section_key}:{self.name or ''}"

    @property
    def dirty(self) -> bool:
        return self.form != self.base


def begun(section: Section, definition: Definition | None, version: int, **given: object) -> Draft:
    """A draft of a definition as it is; of a new one, with what is given already."""
    base = form_of(definition) if definition is not None else {**_copied(BLANK[section.key]), **given}
    was = msgspec.to_builtins(definition) if definition is not None else None
    name = definition.name if definition is not None else None
    return Draft(section_key=section.key, name=name, version=version, base=base, form=_copied(base), was=was)


def merged(base: Form, mine: Form, theirs: Form) -> tuple[Form, list[str]]:
    """Mine, with what only they changed taken over; and what both changed, in which mine stays: fields, or rows of them
    (`defaults.Weight`)."""
    result, both = _copied(mine), []
    for key, value in theirs.items():
        if mine.get(key) == base.get(key) or value == mine.get(key):
            result[key] = _copied(value)
        elif value == base.get(key):
            continue
        elif key in ROW_NAMES and all(isinstance(one, dict) for rows in (base[key], mine[key], value) for one in rows):
            result[key], rows = _merged_rows(base[key], mine[key], value, ROW_NAMES[key])
            both += [f"{key}.{name}" for name in rows]
        else:
            both.append(key)
    return result, both


def _merged_rows(base: list[Form], mine: list[Form], theirs: list[Form], name: str) -> tuple[list[Form], list[str]]:
    """Rows are the same that have the same name; in my order, with theirs that are new behind."""
    old, own, new = ({str(row[name]): row for row in rows} for rows in (base, mine, theirs))
    result, both = [], []
    for key in {**own, **new}:
        ours, others, before = own.get(key), new.get(key), old.get(key)
        if ours != before and others not in (before, ours):
            both.append(key)
        chosen = others if ours == before else ours
        if chosen is not None:
            result.append(_copied(chosen))
    return result, both


def _copied(form: Any) -> Any:
    return msgspec.json.decode(msgspec.json.encode(form))


def form_of(definition: Definition) -> Form:
    plain = msgspec.to_builtins(definition)
    form: Form = _copied({key: "" if value is None else value for key, value in plain.items()})
    match definition:
        case ObjectType():
            must = [{"attribute": name, "must": True} for name in definition.required]
            may = [{"attribute": name, "must": False} for name in definition.attributes if name not in definition.required]
            form["attributes"] = must + may
            del form["required"]
            form["parts"] = [{**part, "minimum": str(part["minimum"]), "maximum": _text(part["maximum"])} for part in form["parts"]]
            form["defaults"] = [{"path": path, "value": _text(value)} for path, value in definition.defaults.items()]
            form["constraints"] = [
                {
                    "sort": LIMITS if rule.formula is None else FORMULA,
                    "attribute": rule.attribute,
                    "minimum": _text(rule.minimum),
                    "maximum": _text(rule.maximum),
                    "values": ", ".join(map(_text, rule.values)),
                    "formula": rule.formula or "",
                    "doc": rule.doc,
                }
                for rule in definition.constraints
            ]
            form["parent"] = definition.parent
        case AttributeType():
            form["minimum"], form["maximum"] = _text(definition.minimum), _text(definition.maximum)
            form["values"] = ", ".join(definition.values)
            form["tolerance"] = _text(definition.tolerance) if definition.tolerance else ""
        case FunctionType():
            form["source"] = READ if definition.attribute else TABLE if definition.values else COMPUTED
            form["attribute"] = definition.attribute
            form["values"] = [{"key": key, "value": _text(value)} for key, value in definition.values.items()]
    if "handlers" in form:
        form["handlers"] = [{"on": one["on"], "when": one["when"] or "", "effect": one["effect"]} for one in form["handlers"]]
        form["parent"] = form["parent"] or None
    return form


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
