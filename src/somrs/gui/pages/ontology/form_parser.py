"""Converting a form to a definition, and the Repository's error paths to paths of the form."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import msgspec

from somrs.gui.pages.ontology.drafts import FORMULA, READ, TABLE, Draft, Form
from somrs.gui.pages.ontology.sections import ATTRIBUTES, FUNCTIONS, RELATIONS, SERVICES, TYPES
from somrs.ontology.complex_values import inner_paths
from somrs.ontology.types import AttributeType, Definition, Kind, ObjectType, Ontology, Value
from somrs.ontology.units import convert_unit

_QUANTITY = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)", re.DOTALL)


class Mistakes(Exception):
    """Errors that prevent a definition, by path of the field."""

    def __init__(self, messages: dict[str, str]) -> None:
        self.messages = messages
        super().__init__(messages)


def definition_of(draft: Draft, ontology: Ontology) -> Definition:
    """The definition of a draft. Raises Mistakes."""
    parser = _FormParser(draft.form, ontology)
    plain = {
        TYPES.key: parser.type,
        ATTRIBUTES.key: parser.attribute,
        RELATIONS.key: parser.relation,
        FUNCTIONS.key: parser.function,
        SERVICES.key: parser.service,
    }[draft.section_key]()
    if parser.mistakes:
        raise Mistakes(parser.mistakes)
    # Fields that are left out have their defaults; `parent` may be None.
    return msgspec.convert({key: value for key, value in plain.items() if value is not None or key == "parent"}, draft.section.struct)


def type_from_form(form: Form, name: str) -> ObjectType:
    """The type that the form describes, with its parent and attributes only."""
    return ObjectType(
        name=name, parent=form["parent"], attributes=tuple(row["attribute"] for row in form["attributes"] if row["attribute"])
    )


def attributes_with(form: Form, ontology: Ontology) -> dict[str, AttributeType]:
    """The attributes that objects of the form's type may have, by path."""
    return dict(ontology.extended([type_from_form(form, "")]).attributes_of(""))  # "" is no name of a definition


def attributes_within(form: Form, ontology: Ontology) -> dict[str, AttributeType]:
    """The attributes in the complex attribute that the form describes, by path."""
    return dict(inner_paths(AttributeType(name="", kind=Kind.COMPLEX, attributes=tuple(form["attributes"])), ontology))


class _FormParser:
    """Parses one form."""

    def __init__(self, form: Form, ontology: Ontology) -> None:
        self.form, self.ontology = form, ontology
        self.mistakes: dict[str, str] = {}
        if not form["name"].strip():
            self.mistakes["name"] = "give it a name: a letter, then letters, digits, _ or -"

    def plain(self, *keys: str) -> Form:
        """The values of the form that need no conversion; empty ones are left out."""
        return {key: (value.strip() if isinstance(value := self.form[key], str) else value) or None for key in ("name", "doc", *keys)}

    def number(self, text: str, path: str, unit: str | None = None) -> float | None:
        text = text.strip()
        if not text:
            return None
        match = _QUANTITY.fullmatch(text)
        if match is None or not math.isfinite(float(match[1])):
            self.mistakes[path] = f"“{text}” is not a number" + (f" in {unit}" if unit else "")
            return None
        value, unit_text = float(match[1]), match[2].strip()
        if not unit_text:
            return value
        converted_value = convert_unit(value, unit_text, unit) if unit else None
        if converted_value is None:
            self.mistakes[path] = (
                f"{unit_text} cannot be expressed in {unit}" if unit else f"this number has no unit; leave out {unit_text}"
            )
        return converted_value

    def count(self, text: str, path: str) -> int | None:
        value = self.number(text, path)
        if value is not None and (value < 0 or not value.is_integer()):
            self.mistakes[path] = "a count: 0, 1, 2 or more"
            return None
        return int(value) if value is not None else None

    def _require_choice(self, value: str | None, path: str, noun: str) -> str:
        if not value:
            self.mistakes[path] = f"choose {noun}, or remove the row"
        return value or ""

    def rows(self, key: str) -> list[tuple[str, Any]]:
        return [(f"{key}.{index}", row) for index, row in enumerate(self.form[key])]

    def type(self) -> Form:
        attributes: list[str] = []
        required: list[str] = []
        for path, row in self.rows("attributes"):
            (required if row["must"] else attributes).append(self._require_choice(row["attribute"], path, "an attribute"))
        known_attributes = attributes_with(self.form, self.ontology)
        parts = []
        for path, row in self.rows("parts"):
            minimum = self.count(row["minimum"], f"{path}.minimum")
            maximum = self.count(row["maximum"], f"{path}.maximum")
            parts.append({"type": self._require_choice(row["type"], f"{path}.type", "a type"), "minimum": minimum or 0, "maximum": maximum})
        defaults: dict[str, Value] = {}
        for path, row in self.rows("defaults"):
            name = self._require_choice(row["path"], f"{path}.path", "an attribute")
            if name in defaults:
                self.mistakes[f"{path}.path"] = f"{name} is there twice; remove one of the two"
            value = self.value(row["value"], known_attributes.get(name), f"{path}.value")
            if value is not None:
                defaults[name] = value
            elif f"{path}.value" not in self.mistakes:
                self.mistakes[f"{path}.value"] = "give the value, or remove the row"
        rules = [self._rule(row, path, known_attributes) for path, row in self.rows("constraints")]
        type_fields = {"attributes": attributes, "required": required, "parts": parts, "defaults": defaults, "constraints": rules}
        return {**self.plain("parent", "driver", "closed"), **type_fields, "parent": self.form["parent"]}

    def _rule(self, row: Form, path: str, known_attributes: Mapping[str, AttributeType]) -> Form:
        doc = row["doc"].strip()
        if row["sort"] == FORMULA:
            if not row["formula"].strip():
                self.mistakes[f"{path}.formula"] = "write the formula, or remove the row"
            return {"formula": row["formula"].strip(), "doc": doc}
        attribute = known_attributes.get(row["attribute"] or "")
        unit = attribute.unit if attribute is not None else None
        values = [value for text in _split_list(row["values"]) if (value := self.value(text, attribute, f"{path}.values")) is not None]
        return {
            "attribute": self._require_choice(row["attribute"], f"{path}.attribute", "an attribute"),
            "minimum": self.number(row["minimum"], f"{path}.minimum", unit),
            "maximum": self.number(row["maximum"], f"{path}.maximum", unit),
            "values": values,
            "doc": doc,
        }

    def value(self, text: str, attribute: AttributeType | None, path: str) -> Value | None:
        """Parse a value of the attribute."""
        if attribute is None or attribute.kind is Kind.NUMBER:
            return self.number(text, path, attribute.unit if attribute is not None else None)
        if attribute.kind is Kind.TRUTH:
            return {"true": True, "false": False}.get(text.strip().lower())
        return text.strip() or None

    def attribute(self) -> Form:
        kind, unit = self.form["kind"], self.form["unit"].strip()
        kind_fields: Form = {}
        if kind == Kind.NUMBER.value:
            kind_fields = {key: self.number(self.form[key], key, unit or None) for key in ("minimum", "maximum", "tolerance")}
            kind_fields["unit"] = unit or None
        elif kind == Kind.ENUMERATION.value:
            kind_fields = {"values": _split_list(self.form["values"])}
        elif kind == Kind.COMPLEX.value:
            known_attributes = attributes_within(self.form, self.ontology)
            kind_fields = {"constraints": [self._rule(row, path, known_attributes) for path, row in self.rows("constraints")]}
        return {**self.plain(*(["attributes"] if kind == Kind.COMPLEX.value else [])), **kind_fields, "kind": kind}

    def relation(self) -> Form:
        joins = [self._require_choice(type, path, "a type") for path, type in self.rows("joins")]
        if not joins:
            self.mistakes["joins"] = "a relation joins at least one type"
        return {**self.plain("symmetric", "functional", "excludes"), "joins": joins}

    def function(self) -> Form:
        source, table = self.form["source"], {}
        if source == TABLE:
            for path, row in self.rows("values"):
                value = self.number(row["value"], f"{path}.value", self.form["unit"].strip() or None)
                if value is None and f"{path}.value" not in self.mistakes:
                    self.mistakes[f"{path}.value"] = "give the value, or remove the row"
                table[" ".join(row["key"].split())] = value
        if source == READ and not self.form["attribute"]:
            self.mistakes["attribute"] = "choose the attribute that it reads"
        parameters = [self._require_choice(type, path, "a type") for path, type in self.rows("parameters")]
        return {**self.plain("unit", *([READ] if source == READ else [])), "parameters": parameters, "values": table}

    def service(self) -> Form:
        sides: Form = {}
        for side in ("inputs", "outputs"):
            sides[side] = []
            for path, row in self.rows(side):
                if not row["name"].strip():
                    self.mistakes[f"{path}.name"] = "give it a name"
                name = row["name"].strip().removeprefix("?")
                sides[side].append({"name": name, "type": self._require_choice(row["type"], f"{path}.type", "a type")})
        if not self.form["effect"].strip():
            self.mistakes["effect"] = "enter the effect of the service"
        handlers = [
            {"on": row["on"], "when": row["when"].strip() or None, "effect": row["effect"].strip()} for row in self.form["handlers"]
        ]
        return {**self.plain("parent", "precondition", "invariant", "effect", "cost", "kind"), **sides, "handlers": handlers}


def _split_list(text: str) -> list[str]:
    """Split a comma-separated list."""
    return [word for item in text.split(",") if (word := item.strip())]


def form_path(path: str, form: Form) -> str:
    """The form's path for a path of the Repository, where rows are addressed by name."""
    key, _, rest = path.partition(".")
    row_key = {"defaults": "path", "inputs": "name", "outputs": "name", "values": "key"}.get(key)
    if row_key is not None and isinstance(form.get(key), list):
        for index, row in enumerate(form[key]):
            if isinstance(row, dict) and row.get(row_key) == rest:
                return f"{key}.{index}.value" if key in ("defaults", "values") else f"{key}.{index}.type"
    if key == "required":
        required_indices = [index for index, row in enumerate(form["attributes"]) if row["must"]]
        return f"attributes.{required_indices[int(rest)]}" if rest.isdigit() and int(rest) < len(required_indices) else "attributes"
    if key == "attributes" and form.get("attributes") and isinstance(form["attributes"][0], dict):
        optional_indices = [index for index, row in enumerate(form["attributes"]) if not row["must"]]
        return f"attributes.{optional_indices[int(rest)]}" if rest.isdigit() and int(rest) < len(optional_indices) else "attributes"
    return path
