"""Fast Downward, as a process of its own, on tasks as we write them."""

from __future__ import annotations

import importlib.util
import time
from itertools import pairwise, product
from pathlib import Path

import pytest
from hypothesis import given
from msgspec.structs import replace

from somrs.entish.parse import parse
from somrs.errors import RemoteError
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.planner.encodings.sas import decode_moves, encode_sas
from somrs.planner.grounding.finite_task import FiniteTask, Operation
from somrs.planner.grounding.merging import merge_task
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.quality import cost, makespan
from somrs.planner.model.validation import validate
from somrs.planner.planning import plan
from somrs.planner.search.search import TooHard, search
from somrs.planner_service import engines
from somrs.planner_service.engines import driver, entrants, plan_in_process, race_engines, solve
from somrs.sites.pddl import read as read_pddl
from tests.support.courier import DOMAIN as COURIER
from tests.support.examples import examples
from tests.unit.planner.encodings.test_equation import lift
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
        [Fact("isOn", (name, support)) for name, support in zip(names, ["Table1", *names], strict=False)],
    )
    turned = [names[1], *names[:1], *names[:1:-1]]
    goal = " AND ".join(f"{carton} isOn {support}" for carton, support in pairwise(turned))
    return Problem(
        ontology=upper(), map=map, goal=parse(goal), services=(AvailableService(STACK, ("Robot1",)), AvailableService(UNSTACK, ("Robot1",)))
    )


ENGINES = {entrant.name: entrant for entrant in entrants() if entrant.name != "counting"}
"""Those that find plans."""


@needs_engine
@examples(25)
@given(problems())
def test_every_engine_and_the_small_search_agree(problem: Problem) -> None:
    task = task_of(problem)
    if task is None:
        return
    solution = search(task, 10**9)
    for name, entrant in ENGINES.items():
        if solution is None and not entrant.proves:
            continue  # a solver would look for longer and longer plans
        names = race_engines(encode_sas(merge_task(task)), 120, [entrant]).operators
        assert (names is None) == (solution is None), name
        if names is not None:
            state = task.initial
            for move in decode_moves(list(names), task):
                assert move.is_applicable(state), name
                state = move.apply(state)
            assert any(move.action.operator.service is None and move.is_applicable(state) for move in task.moves), name


@needs_engine
def test_a_task_too_hard_for_the_small_search_goes_to_the_engine() -> None:
    problem = tower(10)
    task = task_of(problem)
    assert task is not None
    with pytest.raises(TooHard):
        search(task, 2_000)
    result = plan_in_process(problem)
    assert isinstance(result, Plan)
    assert validate(result, problem) == []


@needs_engine
@needs_codmap
@pytest.mark.parametrize("name", ["depot/pfile7", "driverlog/pfile13"])
def test_hard_problems_of_the_field_are_planned_for(name: str) -> None:
    problem = codmap(name)
    result = plan_in_process(problem, 60)
    assert isinstance(result, Plan)
    assert validate(result, problem) == []


@needs_codmap
@pytest.mark.skipif("steps+0" not in ENGINES, reason="there is no SAT solver")
def test_a_task_of_scarce_things_is_solved_step_by_step() -> None:
    task = task_of(codmap("wireless/p06"))
    assert task is not None
    names = race_engines(encode_sas(merge_task(task)), 60, [ENGINES["steps+0"]]).operators
    assert names is not None
    state = task.initial
    for move in decode_moves(list(names), task):
        assert move.is_applicable(state)
        state = move.apply(state)
    assert any(move.action.operator.service is None and move.is_applicable(state) for move in task.moves)


@pytest.mark.skipif(len(entrants()) < 4, reason="the engines are not installed: pip install -e '.[planner]'")
def test_who_is_in_a_hurry_has_all_vans_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [f"b{number}" for number in range(6)]
    vans = [f"van{number}" for number in range(3)]
    text = f"""(define (problem moving) (:domain courier)
      (:objects east west - place {" ".join(names)} - parcel {" ".join(f"(:private {van} {van} - van)" for van in vans)})
      (:init (road east west) (road west east) {" ".join(f"(at {item_name} east)" for item_name in (*names, *vans))})
      (:goal (and {" ".join(f"(at {name} west)" for name in names)})))"""
    for name, content in (("domain", COURIER), ("problem", text)):
        (tmp_path / f"{name}.pddl").write_text(content, encoding="utf-8")
    problem = read_pddl(tmp_path / "domain.pddl", tmp_path / "problem.pddl").problem()
    # As long as it takes on a busy machine: the engines end when they have found it.
    monkeypatch.setattr(engines, "LEAST_BETTER", 90.0)
    monkeypatch.setattr(engines, "MOST_BETTER", 90.0)
    cheap_plan, fast_plan = plan_in_process(problem, 120), plan_in_process(replace(problem, hurry=True), 120)
    assert isinstance(cheap_plan, Plan)
    assert isinstance(fast_plan, Plan)
    assert cost(cheap_plan, problem) <= cost(fast_plan, problem)
    assert makespan(fast_plan) == 5, "each of three vans loads two, drives, and unloads two"
    assert makespan(cheap_plan) > 5


@pytest.mark.skipif(importlib.util.find_spec("scipy") is None, reason="SciPy is not installed")
@pytest.mark.parametrize("counted", [2, 1])
def test_counting_is_an_engine_that_proves(counted: int) -> None:
    counting = [entrant for entrant in entrants() if entrant.name == "counting"]
    task = encode_sas(lift(2, counted))
    if counted < 2:
        assert race_engines(task, 120, counting).operators is None
    else:
        with pytest.raises(RemoteError):
            race_engines(task, 120, counting)


def test_without_an_engine_the_explanation_says_what_to_install() -> None:
    result = plan(tower(20), None)
    assert isinstance(result, NoPlan)
    assert "somrs[planner]" in result.explanation


def fifteen_puzzle() -> FiniteTask:
    """Tiles in a square of four by four, of which two are to change places: that cannot be, and to see it takes for ever."""
    blank = 15
    neighbours = [
        (cell, other_cell)
        for cell in range(16)
        for other_cell in range(16)
        if abs(cell // 4 - other_cell // 4) + abs(cell % 4 - other_cell % 4) == 1
    ]
    return FiniteTask(
        names=tuple(tuple(f"at{tile}({place})" for place in range(16)) for tile in range(16)),
        initial=tuple(range(16)),
        goal=((0, 1), (1, 0), *((tile, tile) for tile in range(2, 15))),
        operations=tuple(
            Operation(
                move=number, cost=1, preconditions=((tile, cell), (blank, other_cell)), effects=(((), tile, other_cell), ((), blank, cell))
            )
            for number, (tile, (cell, other_cell)) in enumerate(product(range(15), neighbours))
        ),
        mutex_groups=(),
    )


@needs_engine
def test_the_engine_ends_at_its_limit() -> None:
    started = time.monotonic()
    with pytest.raises(RemoteError, match="no plan was found in 1 s"):
        solve(encode_sas(fifteen_puzzle()), 1)
    assert time.monotonic() - started < 120, "without the limit it searches for hours; a busy machine may be slow to start and stop it"
