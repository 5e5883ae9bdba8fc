"""What can become true if nothing becomes false: the same facts as of a grounding, each reached as cheaply as its action says."""

from __future__ import annotations

import pytest
from hypothesis import given

from somrs.planner.grounding.actions import added_facts
from somrs.planner.grounding.exploration import Exploration
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.relevance import demands
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.problem import Problem
from somrs.planner.model.vocabulary import GOAL
from somrs.planner.model.world import World
from tests.support.examples import examples
from tests.support.small_pddl import PROBLEMS, small
from tests.unit.planner.test_properties import problems

NEVER = ("never", ())
"""A fact that is not reached, so that all others are."""


def check_against_grounding(problem: Problem) -> None:
    """Every binding of every service, beside the exploration, which projects variables away."""
    world = World(problem)
    demanded = demands(list(goal_operators(problem.goal, world.vocabulary)), world)
    grounding, exploration = Grounding(world, demanded), Exploration(world, demanded, target=NEVER)
    assert exploration.facts.new.keys() == grounding.facts.new.keys() == exploration.achievers.keys()
    for fact, action in exploration.achievers.items():
        assert fact in added_facts(action, world)
        price = world.cost(action.operator.service, action.binding)
        assert exploration.cost(fact) == pytest.approx(price + sum(map(exploration.cost, action.preconditions)))


@examples(60)
@given(problems())
def test_the_same_facts_are_reached_as_with_every_action(problem: Problem) -> None:
    check_against_grounding(problem)


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_same_where_the_ontology_says_nothing_of_it(name: str) -> None:
    check_against_grounding(small(name))


def test_it_ends_at_its_target() -> None:
    problem = small("courier")
    world = World(problem)
    demanded = demands(list(goal_operators(problem.goal, world.vocabulary)), world)
    everything, reached = Exploration(world, demanded, target=NEVER), Exploration(world, demanded)
    assert reached.cost(GOAL) == everything.cost(GOAL) > 0
    assert len(reached.facts.new) <= len(everything.facts.new)
