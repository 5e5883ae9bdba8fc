"""pytyr, in a process of its own, on tasks with counters as we write them."""

from __future__ import annotations

import pytest

from somrs.errors import RemoteError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.relevance import demands
from somrs.planner.grounding.task import Task
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.validation import validate
from somrs.planner.model.world import World
from somrs.planner.planning import plan
from somrs.planner.search.counting import Counters, reaches_goal, search_with_counters
from somrs.planner.search.numeric import NumericTask
from somrs.planner_service.engine_counters import is_tyr_installed, tyr
from somrs.planner_service.engines import plan_in_process
from tests.unit.planner.test_numbers import DRIVE, FAR, FILL, RECHARGE, corridor, make_problem

needs_engine = pytest.mark.skipif(not is_tyr_installed(), reason="the numbers extra is not installed")


def counted(problem: Problem) -> tuple[Task, Counters]:
    world = World(problem, counting=True)
    grounding = Grounding(world, demands(list(goal_operators(problem.goal, world.vocabulary)), world))
    task = Task(grounding)
    return task, Counters(task, world)


def boxes(number: int, full: int) -> Problem:
    """Empty boxes, in each of which so many things are to be put."""
    map = Map([*(Object(name=f"Box{n}", type="Box", values={"Count": 0.0}) for n in range(number)), Object(name="Robot1", type="Rover")])
    return make_problem(map, " AND ".join(f"Box{n}.Count = {full}" for n in range(number)), FILL)


@needs_engine
@pytest.mark.parametrize("charge", [10.0, 40.0, 55.0, 100.0])
@pytest.mark.parametrize("service", [DRIVE, FAR], ids=["the same for each way", "by the length of the way"])
def test_the_engine_and_the_search_that_counts_agree(charge: float, service: ServiceType) -> None:
    task, counters = counted(make_problem(corridor(6, charge), "Robot1 isInside Hall5 AND Robot1.Charge >= 25 %", service, RECHARGE))
    numeric_task = NumericTask(task, counters)
    names, searched_moves = tyr(numeric_task.domain, numeric_task.problem, 20), search_with_counters(task, counters, 5_000)
    assert (names is None) == (searched_moves is None)
    if names is not None and searched_moves is not None:
        assert reaches_goal(numeric_task.decode_moves(names), task, counters)
        assert len(numeric_task.decode_moves(names)) <= len(searched_moves) + 2


@needs_engine
def test_a_task_too_large_for_the_search_that_counts_goes_to_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = make_problem(corridor(6, 60), "Robot1 isInside Hall5", FAR, RECHARGE)
    monkeypatch.setattr("somrs.planner.planning.VALUES", 0)
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    monkeypatch.setattr("somrs.planner.planning.STATES", 3)
    monkeypatch.setattr("somrs.planner.planning.ALL_STATES", 3)
    result = plan_in_process(problem)
    assert isinstance(result, Plan), result
    assert validate(result, problem) == []
    engineless_result = plan(problem)
    assert isinstance(engineless_result, NoPlan)
    assert engineless_result.undecided
    assert "somrs[numbers]" in engineless_result.explanation


def test_counting_goes_straight_for_the_numbers_that_are_wished_for() -> None:
    """There are more ways to fill the boxes than can be looked at."""
    problem = boxes(6, 12)
    result = plan(problem)
    assert isinstance(result, Plan), result
    assert len(result.steps) == 72


def test_counting_goes_for_the_numbers_that_lead_to_the_wish() -> None:
    close = ServiceType(
        name="Close", inputs=(Parameter(name="Box", type="Box"),), precondition="?Box.Count >= 30", effect="?Box.Closed = TRUE"
    )
    problem = boxes(6, 0)
    wish = " AND ".join(f"Box{n}.Closed = TRUE" for n in range(6))
    result = plan(make_problem(problem.map, wish, FILL, close))
    assert isinstance(result, Plan), result
    assert len(result.steps) == 6 * 31


@needs_engine
def test_the_engine_ends_at_its_limit() -> None:
    task, counters = counted(boxes(12, 5000))
    numeric_task = NumericTask(task, counters)
    with pytest.raises(RemoteError, match="no plan with these numbers was found in 1 s"):
        tyr(numeric_task.domain, numeric_task.problem, 1)
