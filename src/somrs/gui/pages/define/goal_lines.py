"""Goals as lines: which formulas can be shown as lines, and the formula of given lines."""

from __future__ import annotations

import json

import msgspec

from somrs.entish.formula import Attribute, Comparison, Formula, Name, Not, Number, Relation, Text, Truth, conjuncts
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.types import Kind, Ontology
from somrs.ontology.values import attribute_at

ORDERS = ("=", "!=", "<", "<=", ">", ">=")


class Line(msgspec.Struct, frozen=True, kw_only=True):
    """States that `thing` stands in `relation` to `related_thing`, or that its attribute (`path`, of this `kind`) compares with `value` in
    `unit`. `denied` negates the line. Fields that were not chosen yet are empty."""

    thing: str = ""
    relation: str = ""
    related_thing: str = msgspec.field(default="", name="other")
    path: str = ""
    kind: Kind = Kind.NUMBER
    order: str = "="
    value: str = ""
    unit: str = ""
    denied: bool = False

    @property
    def text(self) -> str | None:
        """The line as a formula; None while it is incomplete."""
        denied = "NOT " if self.denied else ""
        if self.relation:
            return f"{denied}{self.thing} {self.relation} {self.related_thing}" if self.thing and self.related_thing else None
        value = self._value_text()
        return f"{denied}{self.thing}.{self.path} {self.order} {value}" if self.thing and self.path and value else None

    def _value_text(self) -> str | None:
        match self.kind:
            case Kind.NUMBER:
                try:
                    float(self.value)
                except ValueError:
                    return None
                return f"{self.value} {self.unit}".strip()
            case Kind.TEXT:
                return json.dumps(self.value, ensure_ascii=False)
            case _:
                return self.value or None


def text_of(lines: list[Line]) -> str:
    """The formula of the complete lines, one per text line."""
    return "\nAND ".join(text for line in lines if (text := line.text) is not None)


def lines_of(text: str, ontology: Ontology) -> list[Line] | None:
    """The lines of a formula; None if the text is invalid or cannot be shown as lines."""
    try:
        parts = conjuncts(parse(text))
    except FormulaError:
        return None
    parsed_lines = [_line(part, ontology) for part in parts]
    return [line for line in parsed_lines if line is not None] if None not in parsed_lines else None


def _line(part: Formula, ontology: Ontology) -> Line | None:
    atom, denied = (part.atom, True) if isinstance(part, Not) else (part, False)
    match atom:
        case Relation(relation, (Name(thing), Name(related_thing))):
            return Line(thing=thing, relation=relation, related_thing=related_thing, denied=denied)
        case Comparison(Attribute(Name(thing), path), order, constant):
            attribute = attribute_at(path, ontology)
            kind = attribute.kind if attribute is not None else None
            if kind is None or (kind is not Kind.NUMBER and order not in ("=", "!=")):
                return None
            match kind, constant:
                case Kind.NUMBER, Number(value, unit):
                    value_text = repr(value).removesuffix(".0")
                    return Line(thing=thing, path=path, kind=kind, order=order, value=value_text, unit=unit or "", denied=denied)
                case (Kind.TEXT, Text(value_text)) | (Kind.ENUMERATION, Name(value_text)):
                    return Line(thing=thing, path=path, kind=kind, order=order, value=value_text, denied=denied)
                case Kind.TRUTH, Truth(true):
                    return Line(thing=thing, path=path, kind=kind, order=order, value="TRUE" if true else "FALSE", denied=denied)
    return None


def is_same_formula(first_text: str, second_text: str) -> bool:
    """Whether two texts are the same formula, or the same text."""
    try:
        return first_text == second_text or parse(first_text) == parse(second_text)
    except FormulaError:
        return False


def add_placement(lines: list[Line], line: Line, ontology: Ontology) -> list[Line]:
    """The lines with the placement `line`, which replaces the lines that contradict it."""
    relation = ontology.relations.get(line.relation)
    group = relation.excludes if relation is not None else None
    remaining_lines = []
    for old_line in lines:
        old_relation = ontology.relations.get(old_line.relation)
        same_relation = old_line.relation == line.relation and relation is not None and relation.functional
        excluded = same_relation or (group is not None and old_relation is not None and old_relation.excludes == group)
        if old_line.thing != line.thing or old_line.denied or not excluded:
            remaining_lines.append(old_line)
    return [*remaining_lines, line]
