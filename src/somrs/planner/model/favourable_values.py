"""The values that a plan may assume for an attribute that has none yet: those that could meet a condition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Number, Term, Text, Truth
from somrs.entish.formula import Constant, Not, literals, terms
from somrs.ontology.map import Map
from somrs.ontology.types import AttributeType, Kind, Ontology
from somrs.ontology.units import convert_unit
from somrs.ontology.values import attribute_at, constant, value_of

MOST_VALUES = 24
"""The maximum number of values to try for one attribute."""
STEP = 0.01
"""How far beyond a limit a number is tried, as a fraction of the limit, if the attribute has no tolerance."""


def favourable_values(path: str, formulas: Iterable[Formula], map: Map, ontology: Ontology) -> list[Constant]:
    """The values to try: all values of a list; for a number or a text, the constants and the values on the map that the formulas compare
    the attribute with, and, for a number, values just beyond them. A text that is an input of a service is `Some-` and the attribute."""
    attribute = attribute_at(path, ontology)
    if attribute is None:
        return []
    match attribute.kind:
        case Kind.TRUTH:
            return [Truth(True), Truth(False)]
        case Kind.ENUMERATION:
            return [Name(value) for value in attribute.values]
    compared = dict.fromkeys(value for formula in formulas for value in _compared_values(path, formula, map, ontology))
    if attribute.kind is not Kind.NUMBER:
        stand_in = Text(f"Some-{attribute.name}")
        return [stand_in, *islice((value for value in compared if isinstance(value, Text)), MOST_VALUES)]
    numbers = sorted({number for value in compared if isinstance(value, Number) and (number := _converted(value, attribute)) is not None})
    chosen = numbers[:: max(1, -(-len(numbers) * 3 // MOST_VALUES))] or [0.0]
    beyond = (number + sign * max(attribute.tolerance * 2, abs(number) * STEP, STEP) for number in chosen for sign in (-1, 1))
    limits = [limit for limit in (attribute.minimum, attribute.maximum) if limit is not None]
    candidates = dict.fromkeys([*chosen, *beyond, *limits])
    return [constant(number, attribute) for number in candidates if _is_in_range(number, attribute)]


def _compared_values(path: str, formula: Formula, map: Map, ontology: Ontology) -> Iterator[Constant]:
    for literal in literals(formula):
        atom = literal.atom if isinstance(literal, Not) else literal
        if not isinstance(atom, Comparison):
            continue
        for side, other_side in ((atom.left, atom.right), (atom.right, atom.left)):
            if any(_path_of(term, ontology) == path for term in terms(side)):
                for term in terms(other_side):
                    yield from _values_of(term, map, ontology)


def _values_of(term: Term, map: Map, ontology: Ontology) -> Iterator[Constant]:
    """The constant itself; or all values on the map of the attribute that the term reads."""
    if isinstance(term, Number | Text | Truth | Name):
        yield term
    path = _path_of(term, ontology)
    if path is not None:
        carriers = [name for name in ontology.types if path in ontology.attributes_of(name)]
        values = (value_of(object, path, map, ontology) for type in carriers for object in map.of_type(type))
        yield from dict.fromkeys(constant(value, attribute_at(path, ontology)) for value in values if value is not None)


def _path_of(term: Term, ontology: Ontology) -> str | None:
    match term:
        case Attribute(_, path):
            return path
        case Call(function) if function in ontology.functions:
            return ontology.functions[function].attribute
    return None


def _converted(number: Number, attribute: AttributeType) -> float | None:
    if number.unit is None or attribute.unit is None:
        return number.value
    return convert_unit(number.value, number.unit, attribute.unit)


def _is_in_range(number: float, attribute: AttributeType) -> bool:
    return (attribute.minimum is None or number >= attribute.minimum) and (attribute.maximum is None or number <= attribute.maximum)
