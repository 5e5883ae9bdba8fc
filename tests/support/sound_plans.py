"""A check of plans for tests of the planner."""

from __future__ import annotations

from somrs.ontology.truth import formula_holds
from somrs.planner.model.plan import Plan, linearisations
from somrs.planner.model.problem import Problem
from somrs.planner.model.validation import apply_step, validate
from somrs.planner.planning import plan


def make_sound_plan(problem: Problem) -> Plan:
    """Plan the problem, and check that the plan leads to the goal in every order that its links allow."""
    result = plan(problem)
    assert isinstance(result, Plan), result
    assert validate(result, problem) == []
    for order in linearisations(result):
        map = problem.map
        for step in order:
            assert step.precondition is None or formula_holds(step.precondition, map, problem.ontology), (step, order)
            map = apply_step(step, map, problem)
        assert formula_holds(problem.goal, map, problem.ontology)
    return result
