"""Parsing and formatting attribute values in fields."""

from __future__ import annotations

import math
import re

from somrs.errors import InputError
from somrs.ontology.conformance import value_problem
from somrs.ontology.types import AttributeType, Constraint, Kind, Ontology, Value
from somrs.ontology.units import convert_unit

_NUMBER = re.compile(r"\s*([-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")
UNIT_SYMBOLS = {"rad": "°", "percent": "%"}
"""Units that fields show instead of the stored ones."""
ANGLE_DIGITS = 3
"""Rounding of degrees in fields."""
_UNIT_NAMES = {"°": "deg", "%": "percent", "€": "EUR"}


def unit(attribute: AttributeType) -> str:
    """The unit that a field shows, and that is assumed for a number without a unit."""
    return UNIT_SYMBOLS.get(attribute.unit or "", attribute.unit or "")


def text_of(value: Value | None, attribute: AttributeType) -> str:
    """A value as text, without its unit."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    shown_number = round(math.degrees(value), ANGLE_DIGITS) if attribute.unit == "rad" else value
    return f"{shown_number:.10g}"


def read(text: str, attribute: AttributeType) -> Value:
    """Parse a value of the attribute. Raises InputError with the reason."""
    value: Value = text if attribute.kind is not Kind.NUMBER else _number(text, attribute)
    if problem := value_problem(attribute, value):
        raise InputError(_in_shown_unit(problem, attribute))
    return value


def _number(text: str, attribute: AttributeType) -> float:
    match = _NUMBER.match(text)
    shown_unit = unit(attribute)
    if match is None:
        raise InputError(f"{attribute.name} is a number{f' in {shown_unit}' if shown_unit else ''}, not {text!r}")
    number, written_unit = float(match[1].replace(",", ".")), match[2]
    if not attribute.unit:
        if written_unit:
            raise InputError(f"{attribute.name} is a number without a unit; leave {written_unit!r} out")
        return number
    source_unit = _UNIT_NAMES.get(written_unit or shown_unit, written_unit or shown_unit)
    value = convert_unit(number, source_unit, attribute.unit)
    if value is None:
        raise InputError(f"{attribute.name} is a number in {shown_unit}, and {text.strip()!r} cannot be expressed in it")
    return round(value, 12)


def _in_shown_unit(problem: str, attribute: AttributeType) -> str:
    if attribute.kind is Kind.NUMBER and attribute.unit and attribute.unit != "rad":
        return f"{problem} ({unit(attribute)})"
    return problem


def limits(path: str, attribute: AttributeType, type_name: str, ontology: Ontology) -> str:
    """The range that attribute and type allow for a number, such as `0 to 5 kg`."""
    rules = [rule for ancestor in ontology.ancestors(type_name) for rule in ontology.types[ancestor].constraints if rule.attribute == path]
    rules.append(Constraint(minimum=attribute.minimum, maximum=attribute.maximum))
    low = max((rule.minimum for rule in rules if rule.minimum is not None), default=None)
    high = min((rule.maximum for rule in rules if rule.maximum is not None), default=None)
    shown_unit = unit(attribute)
    match low, high:
        case None, None:
            return ""
        case None, _:
            return f"at most {text_of(high, attribute)} {shown_unit}".rstrip()
        case _, None:
            return f"at least {text_of(low, attribute)} {shown_unit}".rstrip()
    return f"{text_of(low, attribute)} to {text_of(high, attribute)} {shown_unit}".rstrip()


def in_limits(path: str, value: Value, type_name: str, ontology: Ontology) -> str:
    """The reason why a type's own ranges and lists forbid the value; empty if they allow it."""
    if isinstance(value, bool):
        return ""
    for ancestor in ontology.ancestors(type_name):
        for rule in ontology.types[ancestor].constraints:
            if rule.attribute != path:
                continue
            attribute = ontology.attributes_of(type_name)[path]
            meaning = f": {rule.doc}" if rule.doc else ""
            if isinstance(value, int | float):
                if rule.minimum is not None and value < rule.minimum:
                    return f"at least {text_of(rule.minimum, attribute)} {unit(attribute)}{meaning}"
                if rule.maximum is not None and value > rule.maximum:
                    return f"at most {text_of(rule.maximum, attribute)} {unit(attribute)}{meaning}"
            if rule.values and value not in rule.values:
                return f"one of {', '.join(map(str, rule.values))}{meaning}"
    return ""
