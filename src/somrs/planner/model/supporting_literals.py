"""Which literals make a formula true on a map: the conditions of a step, or of the goal, that a plan has to protect."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from somrs.entish import And, Or
from somrs.entish.formula import Condition, Formula, Literal, Term, alternatives, conjunction, conjuncts, substitute, variables
from somrs.entish.normal_form import affirmed_variables, group_by_variables
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.planner.model.world import rows


def supporting_literals(
    formula: Formula, map: Map, ontology: Ontology, bound: Mapping[str, Term] | None = None
) -> tuple[list[Literal], dict[str, Term]] | None:
    """Literals of a formula without quantifiers that hold on the map and together make it true, with their variables replaced, and the
    values of the variables; None if the formula does not hold. A variable that occurs only after NOT stays.

    Parts that share no variables are independent of each other, so their alternatives are not multiplied out.
    """
    values = dict(bound or {})
    literals: dict[Literal, None] = {}
    own = affirmed_variables(formula).keys() - values.keys()
    for group in group_by_variables(conjuncts(formula), own):
        for branch in _branches(group, own, values, map, ontology):
            part = conjunction(*branch)
            row = next(iter(rows(part, {name: values[name] for name in variables(part) if name in values}, map, ontology)), None)
            if row is not None:
                values.update(row)
                replaced = (substitute(literal, row) for literal in branch)
                literals.update(dict.fromkeys(literal for literal in replaced if isinstance(literal, Literal)))
                break
        else:
            return None
    return list(literals), values


def _branches(
    group: Sequence[Formula], own: Collection[str], values: Mapping[str, Term], map: Map, ontology: Ontology
) -> Iterable[tuple[Condition, ...]]:
    """The alternatives of the group; of one without variables to bind, the first that holds: its parts are looked at one by one, because
    the alternatives of many small choices are too many to be listed."""
    formula = conjunction(*group)
    if not variables(formula).keys().isdisjoint(own):
        return alternatives(formula)
    branch = _first_branch(formula, values, map, ontology)
    return [branch] if branch is not None else []


def _first_branch(formula: Formula, values: Mapping[str, Term], map: Map, ontology: Ontology) -> tuple[Condition, ...] | None:
    """The first alternative that holds; None if there is none."""
    match formula:
        case And(parts):
            branches = [_first_branch(part, values, map, ontology) for part in parts]
            known_branches = [branch for branch in branches if branch is not None]
            return tuple(part for branch in known_branches for part in branch) if len(known_branches) == len(branches) else None
        case Or(parts):
            return next((branch for part in parts if (branch := _first_branch(part, values, map, ontology)) is not None), None)
    bound = {name: values[name] for name in variables(formula) if name in values}
    return (formula,) if next(iter(rows(formula, bound, map, ontology)), None) is not None else None
