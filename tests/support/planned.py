"""What every plan has to be, for tests of the planner."""

from __future__ import annotations

from somrs.ontology.truth import formula_holds
from somrs.planner.model.plan import Plan, linearisations
from somrs.planner.model.problem import Problem
from somrs.planner.model.validation import apply_step, validate
from somrs.planner.planning import plan


def sound(asked: Problem) -> Plan:
    """The plan, which leads to the goal in every order that its links allow."""
    found = plan(asked)
    assert isinstance(found, Plan), found
    assert validate(found, asked) == []
    for order in linearisations(found):
        map = asked.map
        for step in order:
            assert step.precondition is None or formula_holds(step.precondition, map, asked.ontology), (step, order)
            map = apply_step(step, map, asked)
        assert formula_holds(asked.goal, map, asked.ontology)
    return found
