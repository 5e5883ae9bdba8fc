"""Evaluates terms on a map: values of attributes and functions, arithmetic, and comparisons."""

from __future__ import annotations

import math
from collections.abc import Mapping

from msgspec import Struct

from somrs.entish.formula import Arithmetic, Attribute, Call, Constant, Name, Number, Term, Text, Truth, Variable
from somrs.ontology.map import Map
from somrs.ontology.types import IN_SERVICE, MODE, OUT_OF_ORDER, PAUSED, PAUSED_FOR, AttributeType, Kind, Ontology, Value
from somrs.ontology.units import convert_unit

DIGITS = 12
"""Significant digits of calculated numbers; beyond them, binary fractions differ from decimal ones."""
ROUNDING = 1e-9
"""Two numbers with a smaller relative difference are equal; conversion between units may cause it."""


class MeasuredValue(Struct, frozen=True):
    """The value of a term. A number has the tolerance, in its unit, of the attribute that it was read from."""

    constant: Constant
    tolerance: float = 0.0


def evaluate(term: Term, map: Map, ontology: Ontology) -> Value | None:
    """The value of a term without variables; a number is in its own unit. None where an attribute has no value."""
    measured = measure(term, map, ontology)
    if measured is None:
        return None
    return measured.constant.name if isinstance(measured.constant, Name) else measured.constant.value


_AT_REST = ((IN_SERVICE, False, "out of service"), (MODE, OUT_OF_ORDER, "out of order"), (PAUSED, True, "stopped"))
"""Values of a device that does not begin work, and what it then is."""


def takes_work(device: str, map: Map, ontology: Ontology) -> bool:
    """Whether an operator lets the device begin work: it is in service, not stopped, and, if it is a lift or a door, not out of order."""
    return not rest_reason(device, map, ontology)


def rest_reason(device: str, map: Map, ontology: Ontology) -> str:
    """Why an operator lets the device begin no work, such as `Robot1 is out of service`; empty if it may begin."""
    if value_of(device, PAUSED_FOR, map, ontology) is not None:
        return f"{device} is paused with its task"
    states = (state for path, value, state in _AT_REST if value_of(device, path, map, ontology) == value)
    state = next(states, None)
    return f"{device} is {state}" if state is not None else ""


def value_of(object_name: str, path: str, map: Map, ontology: Ontology) -> Value | None:
    """An object's own value of an attribute, or else the default of its type; None without either."""
    object = map.objects.get(object_name)
    if object is None:
        return None
    own_value = object.values.get(path)
    return own_value if own_value is not None else ontology.default(object.type, path)


def attribute_at(path: str, ontology: Ontology) -> AttributeType | None:
    """The attribute at the end of a path: Height for `Shape.Height`."""
    return ontology.attributes.get(path.rpartition(".")[2])


def constant(value: Value, attribute: AttributeType | None) -> Constant:
    """The term for a value of the attribute."""
    match value:
        case bool():
            return Truth(value)
        case int() | float():
            return Number(float(value), attribute.unit if attribute else None)
        case str():
            return Name(value) if attribute and attribute.kind is Kind.ENUMERATION else Text(value)


def measure(term: Term, map: Map, ontology: Ontology, bound: Mapping[str, Term] | None = None) -> MeasuredValue | None:
    """The value of a term under the bindings, or None where there is no value."""
    match term:
        case Variable(name):
            value = (bound or {}).get(name)
            return MeasuredValue(value) if isinstance(value, Name | Number | Text | Truth) else None
        case Attribute(owner_term, path):
            owner = name_of(owner_term, bound or {})
            return _attribute_value(owner, path, map, ontology) if owner is not None else None
        case Call(function, arguments):
            owners = [name_of(argument, bound or {}) for argument in arguments]
            named = [owner for owner in owners if owner is not None]
            return _function_value(function, named, map, ontology) if len(named) == len(owners) else None
        case Arithmetic(left_term, operator, right_term):
            left_value, right_value = measure(left_term, map, ontology, bound), measure(right_term, map, ontology, bound)
            return _calculated(left_value, operator, right_value) if left_value is not None and right_value is not None else None
        case _:
            return MeasuredValue(term)


def _calculated(left_value: MeasuredValue, operator: str, right_value: MeasuredValue) -> MeasuredValue | None:
    """The result of an operation: a sum or difference in the unit of the first number that has one, a product in the units' product."""
    left_number, right_number = left_value.constant, right_value.constant
    if not isinstance(left_number, Number) or not isinstance(right_number, Number):
        return None
    if operator == "*":
        unit = (
            f"({left_number.unit}) * ({right_number.unit})"
            if left_number.unit and right_number.unit
            else left_number.unit or right_number.unit
        )
        return MeasuredValue(
            _exact(left_number.value * right_number.value, unit),
            abs(left_number.value) * right_value.tolerance + abs(right_number.value) * left_value.tolerance,
        )
    value, tolerance = right_number.value, right_value.tolerance
    if left_number.unit and right_number.unit and left_number.unit != right_number.unit:
        exact, upper_bound = (
            convert_unit(value, right_number.unit, left_number.unit)
            for value in (right_number.value, right_number.value + right_value.tolerance)
        )
        if exact is None or upper_bound is None:
            return None
        value, tolerance = exact, abs(upper_bound - exact)
    total = left_number.value + value if operator == "+" else left_number.value - value
    return MeasuredValue(_exact(total, left_number.unit or right_number.unit), left_value.tolerance + tolerance)


def _exact(value: float, unit: str | None) -> Number:
    """The number rounded to `DIGITS`, so that 0.1 + 0.2 is 0.3."""
    return Number(float(f"{value:.{DIGITS}g}"), unit)


def name_of(term: Term, bound: Mapping[str, Term]) -> str | None:
    named = bound.get(term.name) if isinstance(term, Variable) else term
    return named.name if isinstance(named, Name) else None


def _attribute_value(owner: str, path: str, map: Map, ontology: Ontology) -> MeasuredValue | None:
    value = value_of(owner, path, map, ontology)
    if value is None:
        return None
    attribute = attribute_at(path, ontology)
    return MeasuredValue(constant(value, attribute), attribute.tolerance if attribute else 0.0)


def _function_value(name: str, arguments: list[str], map: Map, ontology: Ontology) -> MeasuredValue | None:
    function = ontology.functions.get(name)
    if function is None or len(arguments) != len(function.parameters):
        return None
    if function.attribute is not None:
        return _attribute_value(arguments[0], function.attribute, map, ontology)
    if function.values:
        value = function.values.get(" ".join(arguments))
        return MeasuredValue(Number(value, function.unit)) if value is not None else None
    if name == "distance":
        metres = _distance(arguments[0], arguments[1], map, ontology)
        return MeasuredValue(Number(metres, "m")) if metres is not None else None
    return None


def _distance(object_name: str, other_name: str, map: Map, ontology: Ontology) -> float | None:
    """The distance of two positions in metres; in the plane when one of them has no PositionZ."""
    gaps = [_gap(object_name, other_name, path, map, ontology) for path in ("PositionX", "PositionY", "PositionZ")]
    if gaps[0] is None or gaps[1] is None:
        return None
    return math.hypot(gaps[0], gaps[1], gaps[2] or 0.0)


def _gap(object_name: str, other_name: str, path: str, map: Map, ontology: Ontology) -> float | None:
    coordinate, other_coordinate = value_of(object_name, path, map, ontology), value_of(other_name, path, map, ontology)
    if isinstance(coordinate, str | None) or isinstance(other_coordinate, str | None):
        return None
    attribute = attribute_at(path, ontology)
    return (
        convert_unit(coordinate - other_coordinate, attribute.unit, "m") if attribute and attribute.unit else coordinate - other_coordinate
    )


def compare(left_value: MeasuredValue, operator: str, right_value: MeasuredValue) -> bool:
    """Whether the comparison holds. Every comparison between values of different kinds is false."""
    match left_value.constant, right_value.constant:
        case Number() as left_number, Number() as right_number:
            gap = _same_or_gap(left_number, right_number, left_value.tolerance, right_value.tolerance)
            if gap is None:
                return False
        case (Truth(left_truth), Truth(right_truth)):
            return {"=": left_truth == right_truth, "!=": left_truth != right_truth}.get(operator, False)
        case (Name(), Name()) | (Name(), Text()) | (Text(), Name()) | (Text(), Text()):
            is_equal = _text(left_value.constant) == _text(right_value.constant)
            return {"=": is_equal, "!=": not is_equal}.get(operator, False)
        case _:
            return False
    return {"=": gap == 0, "!=": gap != 0, "<": gap < 0, "<=": gap <= 0, ">": gap > 0, ">=": gap >= 0}[operator]


def _text(constant: Constant) -> str:
    return constant.name if isinstance(constant, Name) else str(constant.value)


def _same_or_gap(left_number: Number, right_number: Number, left_tolerance: float, right_tolerance: float) -> float | None:
    """The left number minus the right one, 0 within tolerance; None when their units are not convertible."""
    right_value, tolerance = right_number.value, right_tolerance
    if left_number.unit is not None and right_number.unit is not None and left_number.unit != right_number.unit:
        exact, upper_bound = (
            convert_unit(value, right_number.unit, left_number.unit) for value in (right_number.value, right_number.value + right_tolerance)
        )
        if exact is None or upper_bound is None:
            return None
        right_value, tolerance = exact, abs(upper_bound - exact)
    gap = left_number.value - right_value
    allowed = max(left_tolerance, tolerance) + ROUNDING * max(abs(left_number.value), abs(right_value))
    return 0.0 if abs(gap) <= allowed else gap
