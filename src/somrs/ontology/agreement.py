"""Whether a program that was written for one definition also serves another definition of the same name.

A program relies on some fields of a definition and not on others: on the effect of a service type, not on its description. Of a list
such as the values of an enumeration, it relies on the entries that it knows. A program that offers services relies on what their
conditions demand as it knows them, and not on more being allowed: it can also do what is asked for more rarely.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from somrs.entish.formula import conjuncts
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

_CONDITIONS = frozenset({"precondition", "invariant"})
_FORMULAS = _CONDITIONS | {"effect"}
_AT_LEAST = frozenset({"values", "attributes", "required"})
"""Lists of which a program needs the entries that it knows, in any order."""


def disagreements(held: Definition, current: Definition, *, provides: bool = False) -> tuple[str, ...]:
    """Why a program that holds the first definition does not serve the second: "its effect is A, not B"; empty if it does.

    `provides`: the program offers services of this type, so the conditions may demand more than it knows.
    Raises TypeError for definitions of different sections.
    """
    if type(held) is not type(current):
        raise TypeError(f"{held.name} is a {type(held).__name__}, and {current.name} a {type(current).__name__}")
    return () if held == current else tuple(_disagreements(held, current, provides))


def _disagreements(held: Definition, current: Definition, provides: bool) -> Iterator[str]:
    for field in held.__struct_fields__:
        if field in _NOT_RELIED_ON[type(held)]:
            continue
        ours, theirs = getattr(held, field), getattr(current, field)
        if not _serves(field, ours, theirs, provides):
            yield f"its {field} {'are' if isinstance(ours, tuple) else 'is'} {_text(ours)}, not {_text(theirs)}"


def _serves(field: str, held: object, current: object, provides: bool) -> bool:
    if field in _AT_LEAST and isinstance(held, tuple) and isinstance(current, tuple):
        return set(held) <= set(current)
    if field in _FORMULAS and isinstance(held, str | None) and isinstance(current, str | None):
        ours, theirs = _parts(held), _parts(current)
        return ours == theirs or (provides and field in _CONDITIONS and ours < theirs)
    if isinstance(held, tuple) and isinstance(current, tuple) and all(isinstance(entry, Parameter) for entry in (*held, *current)):
        return set(held) == set(current)
    return held == current


def _parts(formula: str | None) -> frozenset[str]:
    """The conjuncts as they print, so that spaces, brackets and the order do not matter; the text itself if it is no formula."""
    try:
        return frozenset(map(str, conjuncts(parse(formula)))) if formula is not None else frozenset()
    except FormulaError:
        return frozenset([formula or ""])


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
