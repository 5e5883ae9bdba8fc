"""What engines get of a task: which facts exclude each other, what goes without saying, and that plans stay plans."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from somrs.planner.encodings.sas import encode_sas, parse_sas
from somrs.planner.grounding.finite_task import State
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.invariants import find_mutex_groups
from somrs.planner.grounding.merging import merge_task
from somrs.planner.grounding.relevance import demands
from somrs.planner.grounding.task import Move, Task
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.plan import Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.validation import validate
from somrs.planner.model.world import World
from somrs.planner.planning import plan
from somrs.sites.pddl import read
from tests.support.examples import examples
from tests.support.paths import SHARED
from tests.support.small_pddl import PROBLEMS, small
from tests.unit.planner.test_properties import problems

CODMAP = SHARED / "benchmarks" / "codmap"
needs_codmap = pytest.mark.skipif(not CODMAP.exists(), reason=f"there are no published problems in {CODMAP}")
STATES = 300
"""So many states are looked at."""


def task_of(problem: Problem) -> Task | None:
    world = World(problem)
    grounding = Grounding(world, demands(list(goal_operators(problem.goal, world.vocabulary)), world))
    return Task(grounding) if grounding.is_goal_reachable else None


def codmap(name: str) -> Problem:
    return read(CODMAP / name / "domain.pddl", CODMAP / name / "problem.pddl").problem()


def reachable(task: Task) -> list[State]:
    states = {task.initial: None}
    for state in (waiting := [task.initial]):
        for move in task.moves if len(states) < STATES else ():
            if move.is_applicable(state) and (successor := move.apply(state)) not in states:
                states[successor] = None
                waiting.append(successor)
    return waiting


def check_groups(task: Task) -> int:
    """How many groups there are; in no state that can be reached do two facts of one hold."""
    mutex_groups = find_mutex_groups(task)
    for state in reachable(task):
        for group in mutex_groups:
            assert sum(state[variable] == value for variable, value in (task.place[fact] for fact in group)) <= 1, group
    return len(mutex_groups)


@examples(40)
@given(problems())
def test_of_facts_that_exclude_each_other_never_two_hold(problem: Problem) -> None:
    task = task_of(problem)
    if task is not None:
        check_groups(task)


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_same_where_the_ontology_says_nothing_of_it(name: str) -> None:
    task = task_of(small(name))
    assert task is not None
    assert check_groups(task) > 0


@needs_codmap
@pytest.mark.parametrize("name", ["depot/pfile1", "driverlog/pfile7", "elevators08/p01"])
def test_the_same_in_problems_of_the_field(name: str) -> None:
    task = task_of(codmap(name))
    assert task is not None
    assert check_groups(task) > 0


@examples(40)
@given(problems())
def test_what_is_written_can_be_read(problem: Problem) -> None:
    task = task_of(problem)
    if task is not None:
        finite_task = merge_task(task)
        parsed_task = parse_sas(encode_sas(finite_task))
        assert (parsed_task.initial, parsed_task.goal, parsed_task.mutex_groups) == (
            finite_task.initial,
            finite_task.goal,
            finite_task.mutex_groups,
        )
        assert [len(names) for names in parsed_task.names] == [len(names) for names in finite_task.names]
        for parsed_operation, finite_operation in zip(parsed_task.operations, finite_task.operations, strict=True):
            assert (parsed_operation.move, parsed_operation.cost, {*parsed_operation.preconditions}, {*parsed_operation.effects}) == (
                finite_operation.move,
                finite_operation.cost,
                {*finite_operation.preconditions},
                {*finite_operation.effects},
            )


def test_where_a_chest_is_is_one_variable_whoever_lifts_it() -> None:
    task = task_of(small("yard"))
    assert task is not None
    finite_task = merge_task(task)
    lifted = [variable[:-1] for variable in finite_task.names if any(name.startswith("hangs") for name in variable)]
    assert sorted({name[name.index("chest") :][:6] for name in variable}.pop() for variable in lifted) == ["chest1", "chest2"]
    for variable in lifted:
        assert {name.partition("(")[0] for name in variable} >= {"hangs", "in"}


def test_what_must_not_be_so_is_not_asked_for_where_it_goes_without_saying() -> None:
    """A note that lies at a node does not lie at another one, nor on its way, though the domain says it in facts of their own."""
    task = task_of(small("beacons"))
    assert task is not None
    finite_task = merge_task(task)
    assert not [name for variable in finite_task.names for name in variable if name.startswith(("not-under-way", "lies-not"))]
    assert len(finite_task.names) < len(task.values) / 2


@pytest.mark.parametrize("name", PROBLEMS)
def test_problems_like_those_of_the_field_are_planned_for_without_an_engine(name: str) -> None:
    problem = small(name)
    result = plan(problem)
    assert isinstance(result, Plan)
    assert validate(result, problem) == []


Effects = tuple[str, str, str]
"""What an action needs, what of it is gone then, and what comes about: a letter each."""


def strips(beginning: str, goal: str, *actions: Effects) -> Problem:
    def format_atoms(atoms: str) -> str:
        return " ".join(f"({atom})" for atom in atoms)

    written = [
        f"(:action act{number} :parameters () :precondition (and {format_atoms(preconditions)})"
        f" :effect (and {' '.join(f'(not ({atom}))' for atom in deleted_atoms)} {format_atoms(added_atoms)}))"
        for number, (preconditions, deleted_atoms, added_atoms) in enumerate(actions)
    ]
    with tempfile.TemporaryDirectory() as folder:
        domain, problem = Path(folder) / "domain.pddl", Path(folder) / "problem.pddl"
        domain.write_text(f"(define (domain d) (:requirements :strips) (:predicates {format_atoms('abcd')}) {' '.join(written)})")
        problem.write_text(f"(define (problem p) (:domain d) (:init {format_atoms(beginning)}) (:goal (and {format_atoms(goal)})))")
        return read(domain, problem).problem()


@st.composite
def small_strips(draw: st.DrawFn) -> Problem:
    atom_sets = st.sets(st.sampled_from("abcd"), min_size=1, max_size=2).map(lambda atoms: "".join(sorted(atoms)))
    actions = [
        (preconditions, draw(st.sampled_from([preconditions, preconditions[0], ""])), draw(atom_sets))
        for preconditions in draw(st.lists(atom_sets, min_size=1, max_size=4))
    ]
    return strips(
        draw(atom_sets),
        draw(atom_sets),
        *(
            (preconditions, deleted_atoms, "".join(sorted({*added_atoms} - {*deleted_atoms})))
            for preconditions, deleted_atoms, added_atoms in actions
        ),
    )


@examples(75)
@given(small_strips())
@example(strips("a", "bc", ("a", "a", "c"), ("a", "a", "bc")))
@example(strips("a", "bc", ("a", "a", "b"), ("a", "a", "bc")))
def test_what_goes_without_saying_is_so_in_every_state(problem: Problem) -> None:
    """Played side by side, both tasks allow the same moves and reach the goal in the same states."""
    task = task_of(problem)
    if task is None:
        return
    finite_task = merge_task(task)
    reached = {number for number, move in enumerate(task.moves) if move.length == 0}
    initial_pair = task.initial, finite_task.initial
    seen_pairs = {initial_pair}
    for old, new in (waiting := [initial_pair]):
        ready = {
            candidate.move
            for candidate in finite_task.operations
            if all(new[variable] == value for variable, value in candidate.preconditions)
        }
        is_goal = all(new[variable] == value for variable, value in finite_task.goal) or bool(ready & reached)
        assert is_goal == any(task.moves[number].is_applicable(old) for number in reached)
        for operation in finite_task.operations:
            move = task.moves[operation.move]
            assert move.is_applicable(old) == (operation.move in ready), str(move.action)
            if operation.move in ready - reached:
                successor_pair = (
                    move.apply(old),
                    Move(action=move.action, preconditions=operation.preconditions, effects=operation.effects).apply(new),
                )
                if successor_pair not in seen_pairs:
                    seen_pairs.add(successor_pair)
                    waiting.append(successor_pair)
