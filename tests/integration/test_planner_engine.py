"""Fast Downward, as a process of its own, on tasks as we write them."""

from __future__ import annotations

import time
from itertools import pairwise

import pytest
from hypothesis import given

from somrs.entish.parse import parse
from somrs.errors import RemoteError
from somrs.ontology.files.loading import upper
from somrs.ontology.objects import Fact, Map, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.planner.encodings.sas import read, written
from somrs.planner.grounding.merging import merged
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Available, Problem
from somrs.planner.model.validation import validate
from somrs.planner.planning import plan
from somrs.planner.search.search import TooHard, search
from somrs.planner_service.engines import driver, entrants, plan_in_process, raced, solved
from tests.support.examples import examples
from tests.unit.planner.grounding.test_merging import codmap, needs_codmap, task_of
from tests.unit.planner.test_properties import problems

needs_engine = pytest.mark.skipif(driver() is None, reason="the planner extra is not installed")

STACK = ServiceType(
    name="Stack",
    inputs=(Parameter(name="Block", type="Carton"), Parameter(name="To", type="Carton")),
    precondition="?Block isOn ?From AND NOT ?Above isOn ?Block AND NOT ?Other isOn ?To",
    effect="?Block isOn ?To",
)
UNSTACK = ServiceType(
    name="Unstack",
    inputs=(Parameter(name="Block", type="Carton"), Parameter(name="Table", type="Table")),
    precondition="?Block isOn ?From AND NOT ?Above isOn ?Block",
    effect="?Block isOn ?Table",
)


def tower(count: int) -> Problem:
    """A tower of cartons that is to stand the other way round, its second one from below on top."""
    names = [f"Carton{n}" for n in range(count)]
    map = Map(
        [Object(name="Table1", type="Table"), *(Object(name=name, type="Carton") for name in names)],
        [Fact("isOn", (name, below)) for name, below in zip(names, ["Table1", *names], strict=False)],
    )
    turned = [names[1], *names[:1], *names[:1:-1]]
    goal = " AND ".join(f"{above} isOn {below}" for above, below in pairwise(turned))
    return Problem(ontology=upper(), map=map, goal=parse(goal), services=(Available(STACK, ("Robot1",)), Available(UNSTACK, ("Robot1",))))


ENGINES = {entrant.name: entrant for entrant in entrants() if entrant.name != "counting"}
"""Those that find plans."""


@needs_engine
@examples(25)
@given(problems())
def test_every_engine_and_the_small_search_agree(problem: Problem) -> None:
    task = task_of(problem)
    if task is None:
        return
    found = search(task, 10**9)
    for name, entrant in ENGINES.items():
        if found is None and not entrant.proves:
            continue  # a solver would look for longer and longer plans
        names = raced(written(merged(task)), 20, [entrant]).operators
        assert (names is None) == (found is None), name
        if names is not None:
            state = task.initial
            for move in read(list(names), task):
                assert move.applicable(state), name
                state = move.apply(state)
            assert any(move.action.operator.service is None and move.applicable(state) for move in task.moves), name


@needs_engine
def test_a_task_too_hard_for_the_small_search_goes_to_the_engine() -> None:
    problem = tower(10)
    task = task_of(problem)
    assert task is not None
    with pytest.raises(TooHard):
        search(task, 2_000)
    found = plan_in_process(problem)
    assert isinstance(found, Plan)
    assert validate(found, problem) == []


@needs_engine
@needs_codmap
@pytest.mark.parametrize("name", ["depot/pfile14", "driverlog/pfile13"])
def test_hard_problems_of_the_field_are_planned_for(name: str) -> None:
    problem = codmap(name)
    found = plan_in_process(problem, 60)
    assert isinstance(found, Plan)
    assert validate(found, problem) == []


@needs_codmap
@pytest.mark.skipif("steps+0" not in ENGINES, reason="there is no SAT solver")
def test_a_task_of_scarce_things_is_solved_step_by_step() -> None:
    task = task_of(codmap("wireless/p06"))
    assert task is not None
    names = raced(written(merged(task)), 60, [ENGINES["steps+0"]]).operators
    assert names is not None
    state = task.initial
    for move in read(list(names), task):
        assert move.applicable(state)
        state = move.apply(state)
    assert any(move.action.operator.service is None and move.applicable(state) for move in task.moves)


def test_without_an_engine_the_explanation_says_what_to_install() -> None:
    found = plan(tower(40), None)
    assert isinstance(found, NoPlan)
    assert "somrs[planner]" in found.explanation


@needs_engine
def test_the_engine_ends_at_its_limit() -> None:
    problem = tower(60)
    task = task_of(problem)
    assert task is not None
    started = time.monotonic()
    with pytest.raises(RemoteError, match="no plan was found in 1 s"):
        solved(written(merged(task)), 1)
    assert time.monotonic() - started < 60, "without the limit it searches for hours; a busy machine may be slow to start and stop it"
