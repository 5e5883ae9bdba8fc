"""Splits a formula into alternatives for the planner, without multiplying out what is independent.

`(A OR B) AND (C OR D) AND ...` has as many alternatives as all its ORs multiplied, and objects in place of `?x` and `?y` in
`?x isOn A AND ?y isOn B` can be combined in as many ways. Where that is too much, each independent choice becomes a fact of its own, which
operators without a service add (compiling disjunctions away: Gazen and Knoblock 1997).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from somrs.entish.formula import And, Formula, Literal, Or, alternatives, conjunction, count_alternatives, variables
from somrs.entish.normal_form import affirmed_variables, group_by_variables

ALTERNATIVES = 256
"""The maximum number of alternatives to multiply out."""
INDEPENDENT_BINDINGS = 2
"""The maximum number of independent groups of variables to bind in one operator."""
REPEATED_PARTS = 20
"""The maximum number of parts of an operator that is repeated for each binding of its variables."""


class TooManyAlternatives(Exception):
    """A formula whose alternatives are too many, and not independent of each other."""


@dataclass(frozen=True, slots=True)
class Alternative:
    """Literals that hold together, and independent `choices`, each with an alternative of its own."""

    literals: tuple[Literal, ...]
    choices: tuple[Formula, ...] = ()


def split(formula: Formula, given: Collection[str]) -> list[Alternative]:
    """The alternatives of a formula without quantifiers. `given`: the variables that have values from elsewhere. Raises
    TooManyAlternatives."""
    match formula:
        case Or(parts):
            return [alternative for part in parts for alternative in split(part, given)]
        case And(parts):
            own = affirmed_variables(formula).keys() - set(given)
            groups = group_by_variables(parts, own)
            binding = sum(not own.isdisjoint(variables(conjunction(*group))) for group in groups)
            is_repeated = binding > INDEPENDENT_BINDINGS or (binding and len(parts) > REPEATED_PARTS and len(groups) > 1)
            if count_alternatives(formula) <= ALTERNATIVES and not is_repeated:
                return [Alternative(_literals(branch)) for branch in alternatives(formula)]
            if len(groups) == 1:
                raise TooManyAlternatives
            plain = [group[0] for group in groups if _is_plain(group, own)]
            return [Alternative(_literals(plain), tuple(conjunction(*group) for group in groups if not _is_plain(group, own)))]
        case _:
            return [Alternative(_literals([formula]))]


def _is_plain(group: list[Formula], own: Collection[str]) -> bool:
    return isinstance(group[0], Literal) and all(name not in own for name in variables(group[0]))


def _literals(parts: Collection[Formula]) -> tuple[Literal, ...]:
    literals = tuple(part for part in parts if isinstance(part, Literal))
    assert len(literals) == len(parts), "quantifiers were expanded"
    return literals
