"""What terms stand for in a map: values of attributes and functions, and how two of them compare."""

from __future__ import annotations

import math
from collections.abc import Mapping

from msgspec import Struct

from somrs.entish.formula import Arithmetic, Attribute, Call, Constant, Name, Number, Term, Text, Truth, Variable
from somrs.ontology.objects import Map
from somrs.ontology.types import AttributeType, Kind, Ontology, Value
from somrs.ontology.units import converted

DIGITS = 12
"""Of what is calculated; binary fractions differ from decimal ones beyond them."""
ROUNDING = 1e-9
"""Two numbers that differ relatively by less are the same: what conversion between units may add."""


class Measured(Struct, frozen=True):
    """What a term stands for; a number with the tolerance, in its unit, of the attribute that it was read from."""

    constant: Constant
    tolerance: float = 0.0


def evaluate(term: Term, map: Map, ontology: Ontology) -> Value | None:
    """The value of a term without variables, a number in its own unit; None where an attribute has no value."""
    found = measure(term, map, ontology)
    if found is None:
        return None
    return found.constant.name if isinstance(found.constant, Name) else found.constant.value


def value_of(object_name: str, path: str, map: Map, ontology: Ontology) -> Value | None:
    """An object's own value of an attribute, else its type's default."""
    object = map.objects.get(object_name)
    if object is None:
        return None
    own = object.values.get(path)
    return own if own is not None else ontology.default(object.type, path)


def attribute_at(path: str, ontology: Ontology) -> AttributeType | None:
    """The attribute that a path leads to: `Shape.Height` to Height."""
    return ontology.attributes.get(path.rpartition(".")[2])


def constant(value: Value, attribute: AttributeType | None) -> Constant:
    """A value of the attribute as a term."""
    match value:
        case bool():
            return Truth(value)
        case int() | float():
            return Number(float(value), attribute.unit if attribute else None)
        case str():
            return Name(value) if attribute and attribute.kind is Kind.ENUMERATION else Text(value)


def measure(term: Term, map: Map, ontology: Ontology, bound: Mapping[str, Term] | None = None) -> Measured | None:
    """What a term stands for under the bindings, or None where there is no value."""
    match term:
        case Variable(name):
            value = (bound or {}).get(name)
            return Measured(value) if isinstance(value, Name | Number | Text | Truth) else None
        case Attribute(of, path):
            owner = name_of(of, bound or {})
            return _attribute_value(owner, path, map, ontology) if owner is not None else None
        case Call(function, arguments):
            owners = [name_of(argument, bound or {}) for argument in arguments]
            named = [owner for owner in owners if owner is not None]
            return _function_value(function, named, map, ontology) if len(named) == len(owners) else None
        case Arithmetic(left, operator, right):
            one, other = measure(left, map, ontology, bound), measure(right, map, ontology, bound)
            return _calculated(one, operator, other) if one is not None and other is not None else None
        case _:
            return Measured(term)


def _calculated(one: Measured, operator: str, other: Measured) -> Measured | None:
    """What two numbers come to: a sum in the unit of the first that has one, a product in the units' product."""
    left, right = one.constant, other.constant
    if not isinstance(left, Number) or not isinstance(right, Number):
        return None
    if operator == "*":
        unit = f"({left.unit}) * ({right.unit})" if left.unit and right.unit else left.unit or right.unit
        return Measured(_exact(left.value * right.value, unit), abs(left.value) * other.tolerance + abs(right.value) * one.tolerance)
    value, tolerance = right.value, other.tolerance
    if left.unit and right.unit and left.unit != right.unit:
        exact, above = (converted(value, right.unit, left.unit) for value in (right.value, right.value + other.tolerance))
        if exact is None or above is None:
            return None
        value, tolerance = exact, abs(above - exact)
    total = left.value + value if operator == "+" else left.value - value
    return Measured(_exact(total, left.unit or right.unit), one.tolerance + tolerance)


def _exact(value: float, unit: str | None) -> Number:
    """Decimals are calculated with as they are written: 0.1 + 0.2 is 0.3."""
    return Number(float(f"{value:.{DIGITS}g}"), unit)


def name_of(term: Term, bound: Mapping[str, Term]) -> str | None:
    named = bound.get(term.name) if isinstance(term, Variable) else term
    return named.name if isinstance(named, Name) else None


def _attribute_value(owner: str, path: str, map: Map, ontology: Ontology) -> Measured | None:
    value = value_of(owner, path, map, ontology)
    if value is None:
        return None
    attribute = attribute_at(path, ontology)
    return Measured(constant(value, attribute), attribute.tolerance if attribute else 0.0)


def _function_value(name: str, arguments: list[str], map: Map, ontology: Ontology) -> Measured | None:
    function = ontology.functions.get(name)
    if function is None or len(arguments) != len(function.parameters):
        return None
    if function.attribute is not None:
        return _attribute_value(arguments[0], function.attribute, map, ontology)
    if function.values:
        value = function.values.get(" ".join(arguments))
        return Measured(Number(value, function.unit)) if value is not None else None
    if name == "distance":
        metres = _distance(arguments[0], arguments[1], map, ontology)
        return Measured(Number(metres, "m")) if metres is not None else None
    return None


def _distance(a: str, b: str, map: Map, ontology: Ontology) -> float | None:
    """In metres, between two positions; in the plane when one of them has no height."""
    gaps = [_gap(a, b, path, map, ontology) for path in ("PositionX", "PositionY", "PositionZ")]
    if gaps[0] is None or gaps[1] is None:
        return None
    return math.hypot(gaps[0], gaps[1], gaps[2] or 0.0)


def _gap(a: str, b: str, path: str, map: Map, ontology: Ontology) -> float | None:
    one, other = value_of(a, path, map, ontology), value_of(b, path, map, ontology)
    if isinstance(one, str | None) or isinstance(other, str | None):
        return None
    attribute = attribute_at(path, ontology)
    return converted(one - other, attribute.unit, "m") if attribute and attribute.unit else one - other


def compare(left: Measured, operator: str, right: Measured) -> bool:
    """Whether the comparison holds; things of different kinds do not compare, so that none does."""
    match left.constant, right.constant:
        case Number() as one, Number() as other:
            gap = _same_or_gap(one, other, left.tolerance, right.tolerance)
            if gap is None:
                return False
        case (Truth(a), Truth(b)):
            return {"=": a == b, "!=": a != b}.get(operator, False)
        case (Name(), Name()) | (Name(), Text()) | (Text(), Name()) | (Text(), Text()):
            same = _text(left.constant) == _text(right.constant)
            return {"=": same, "!=": not same}.get(operator, False)
        case _:
            return False
    return {"=": gap == 0, "!=": gap != 0, "<": gap < 0, "<=": gap <= 0, ">": gap > 0, ">=": gap >= 0}[operator]


def _text(constant: Constant) -> str:
    return constant.name if isinstance(constant, Name) else str(constant.value)


def _same_or_gap(left: Number, right: Number, left_tolerance: float, right_tolerance: float) -> float | None:
    """By how much the left is more than the right, 0 within tolerance; None when their units do not fit."""
    other, tolerance = right.value, right_tolerance
    if left.unit is not None and right.unit is not None and left.unit != right.unit:
        exact, above = (converted(value, right.unit, left.unit) for value in (right.value, right.value + right_tolerance))
        if exact is None or above is None:
            return None
        other, tolerance = exact, abs(above - exact)
    gap = left.value - other
    allowed = max(left_tolerance, tolerance) + ROUNDING * max(abs(left.value), abs(other))
    return 0.0 if abs(gap) <= allowed else gap
