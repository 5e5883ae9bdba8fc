"""Whether a program that was written for one definition also serves another definition of the same name.

A program relies on some fields of a definition and not on others: on the effect of a service type, not on its description. Of a list
such as the values of an enumeration, it relies on the entries that it knows.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, RelationType

_NOT_RELIED_ON: dict[type[Definition], frozenset[str]] = {
    AttributeType: frozenset({"tolerance", "minimum", "maximum", "constraints", "doc"}),
    RelationType: frozenset({"doc"}),
    FunctionType: frozenset({"values", "doc"}),
    ObjectType: frozenset({"parts", "closed", "constraints", "defaults", "driver", "doc"}),
    ServiceType: frozenset({"parent", "handlers", "cost", "doc"}),
}
"""The fields that may change without consequence for a program."""

_FORMULAS = frozenset({"precondition", "effect", "invariant"})
_AT_LEAST = frozenset({"values", "attributes", "required"})
"""Lists of which a program needs the entries that it knows, in any order."""


def disagreements(held: Definition, current: Definition) -> tuple[str, ...]:
    """Why a program that holds the first definition does not serve the second: "its effect is A, not B"; empty if it does.

    Raises TypeError for definitions of different sections.
    """
    if type(held) is not type(current):
        raise TypeError(f"{held.name} is a {type(held).__name__}, and {current.name} a {type(current).__name__}")
    return () if held == current else tuple(_disagreements(held, current))


def _disagreements(held: Definition, current: Definition) -> Iterator[str]:
    for field in held.__struct_fields__:
        if field in _NOT_RELIED_ON[type(held)]:
            continue
        ours, theirs = getattr(held, field), getattr(current, field)
        if not _serves(field, ours, theirs):
            yield f"its {field} {'are' if isinstance(ours, tuple) else 'is'} {_text(ours)}, not {_text(theirs)}"


def _serves(field: str, held: object, current: object) -> bool:
    if field in _AT_LEAST and isinstance(held, tuple) and isinstance(current, tuple):
        return set(held) <= set(current)
    if field in _FORMULAS and isinstance(held, str) and isinstance(current, str):
        return _normalised(held) == _normalised(current)
    if isinstance(held, tuple) and isinstance(current, tuple) and all(isinstance(entry, Parameter) for entry in (*held, *current)):
        return set(held) == set(current)
    return held == current


def _normalised(formula: str) -> str:
    """The formula as it prints, so that spaces and brackets do not matter; as it is if it is no formula."""
    try:
        return str(parse(formula))
    except FormulaError:
        return formula


def _text(value: object) -> str:
    match value:
        case None | () | "":
            return "empty"
        case tuple():
            return ", ".join(_entries(value))
        case _:
            return str(value)


def _entries(values: Iterable[object]) -> Iterator[str]:
    return (f"{value.name}: {value.type}" if isinstance(value, Parameter) else str(value) for value in values)
