"""Which literals make a formula true on a map: the conditions of a step, or of the goal, that a plan has to protect."""

from __future__ import annotations

from collections.abc import Mapping

from somrs.entish.formula import Formula, Literal, Term, alternatives, conjunction, conjuncts, substitute, variables
from somrs.entish.normal_form import affirmed_variables, group_by_variables
from somrs.ontology.objects import Map
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
        for branch in alternatives(conjunction(*group)):
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
