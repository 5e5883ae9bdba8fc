"""A task as clauses: they can be satisfied in so many steps just when there is such a plan."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations, product

import pytest
from hypothesis import given

from somrs.planner.encodings.satisfiability import Clauses
from somrs.planner.grounding.finite_task import Assignment, FiniteTask, Operation
from tests.support.examples import examples
from tests.unit.planner.encodings.test_equation import apply_operation, find_plan, is_satisfied, tasks

Assignments = dict[int, int]


class Encoded:
    """The clauses of a task for so many steps, and what can be done in them."""

    def __init__(self, task: FiniteTask, steps: int, *, busy: bool = False) -> None:
        self.steps = steps
        self.written: list[list[int]] = []
        self.clauses = Clauses(task, self.written.append, busy=busy)
        for _ in range(steps):
            self.clauses.extend()
        self.literals_by_step: list[dict[int, int]] = [{} for _ in range(steps)]
        """For each step the moves that may be done in it, and their literals."""
        for literal in range(1, self.clauses.literals + 1):
            for step in range(steps):
                if move := self.clauses.plan({literal}, step + 1):
                    self.literals_by_step[step][move[0]] = literal
                    break

    def possible(self, goal: bool = False) -> set[tuple[frozenset[int], ...]]:
        """All that can be done in the steps; so that the goal is reached, if that is asked for."""
        assumed = self.clauses.goal_assumptions(self.steps) if goal else []
        subsets = [
            [frozenset(subset) for n in range(len(step_literals) + 1) for subset in combinations(sorted(step_literals), n)]
            for step_literals in self.literals_by_step
        ]
        return {chosen for chosen in product(*subsets) if self._model(chosen, assumed) is not None}

    def plans(self) -> list[list[int]]:
        """The moves of the solutions, in order."""
        assumed = self.clauses.goal_assumptions(self.steps)
        models = (self._model(chosen, assumed) for chosen in self.possible(goal=True))
        return [self.clauses.plan(true, self.steps) for true in models if true is not None]

    def _model(self, chosen: tuple[frozenset[int], ...], assumed: list[int]) -> set[int] | None:
        moves = [
            literal if move in subset else -literal
            for step_literals, subset in zip(self.literals_by_step, chosen, strict=True)
            for move, literal in step_literals.items()
        ]
        return solution(self.written, {*moves, *assumed})


def solution(clauses: list[list[int]], true: set[int]) -> set[int] | None:
    """What is true in a model in which these literals are; None if there is none."""
    true, changed = set(true), True
    while changed:
        changed, open_clauses = False, []
        for clause in clauses:
            if true.isdisjoint(clause):
                free = [literal for literal in clause if -literal not in true]
                if not free:
                    return None
                if len(free) == 1:
                    true.add(free[0])
                    changed = True
                else:
                    open_clauses.append(free)
        clauses = open_clauses
    if not clauses:
        return true
    choice = clauses[0][0]
    model = solution(clauses, true | {choice})
    return model if model is not None else solution(clauses, true | {-choice})


def make_task(
    sizes: list[int],
    *operations: tuple[Assignments, Assignments],
    goal: Iterable[Assignment] = (),
    exclusive: tuple[tuple[Assignment, ...], ...] = (),
    devices: tuple[int, ...] = (),
) -> FiniteTask:
    """Every variable is 0 at the beginning; of an operation is said what it needs and what it makes."""
    return FiniteTask(
        names=tuple(tuple(f"fact{v}({x})" for x in range(size)) for v, size in enumerate(sizes)),
        initial=(0,) * len(sizes),
        goal=tuple(goal),
        operations=tuple(
            Operation(
                move=number,
                cost=1,
                preconditions=tuple(preconditions.items()),
                effects=tuple(((), variable, value) for variable, value in new_values.items()),
                device=devices[number] if devices else 0,
            )
            for number, (preconditions, new_values) in enumerate(operations)
        ),
        mutex_groups=exclusive,
    )


def sets(*steps: str) -> set[tuple[frozenset[int], ...]]:
    """Of one step: `""`, `0` and `01`, say."""
    return {(frozenset(map(int, moves)),) for moves in steps}


@pytest.mark.parametrize(
    ("operations", "possible"),
    [
        ([({0: 0}, {1: 1}), ({0: 0}, {0: 1})], ["", "0", "1", "01"]),
        ([({0: 0}, {0: 1}), ({0: 0}, {1: 1})], ["", "0", "1", "01"]),
        ([({0: 0}, {0: 1}), ({0: 0}, {0: 1})], ["", "0", "1"]),
        ([({0: 0, 1: 0}, {1: 1}), ({0: 0, 1: 0}, {0: 1})], ["", "0", "1"]),
        ([({}, {0: 1}), ({}, {0: 1})], ["", "0", "1", "01"]),
        ([({}, {0: 1}), ({}, {0: 0})], ["", "0", "1"]),
        ([({0: 0}, {1: 1}), ({}, {0: 1}), ({}, {0: 1})], ["", "0", "1", "2", "12"]),
        ([({}, {0: 1}), ({}, {0: 1}), ({0: 0}, {1: 1})], ["", "0", "1", "2", "01", "02", "12", "012"]),
        ([({0: 0}, {0: 0}), ({0: 0}, {0: 0})], ["", "0", "1", "01"]),
        ([({0: 0}, {0: 1}), ({0: 0}, {1: 1}), ({0: 0}, {2: 1})], ["", "0", "1", "2", "01", "02", "12", "012"]),
        ([({0: 1}, {1: 1})], [""]),
    ],
)
def test_what_can_be_done_in_one_step(operations: list[tuple[Assignments, Assignments]], possible: list[str]) -> None:
    assert Encoded(make_task([2, 2, 2], *operations), 1).possible() == sets(*possible)


@pytest.mark.parametrize("number", [2, 3, 5, 6, 7, 10])
def test_of_what_excludes_each_other_one_is_done_at_most(number: int) -> None:
    task = make_task([2] * number, *(({}, {n: 1}) for n in range(number)), exclusive=(tuple((n, 1) for n in range(number)),))
    assert Encoded(task, 1).possible() == sets("", *map(str, range(number)))


@pytest.mark.parametrize("number", [2, 6])
def test_a_variable_has_one_value_at_a_time(number: int) -> None:
    """None of these takes away what another needs."""
    task = make_task([number + 1], *(({}, {0: n + 1}) for n in range(number)))
    assert Encoded(task, 1).possible() == sets("", *map(str, range(number)))


def test_a_device_does_one_thing_in_a_step_if_that_is_asked_for() -> None:
    task = make_task([2] * 5, *(({}, {n: 1}) for n in range(5)), devices=(0, 0, 1, 1, 2))
    subsets = {(frozenset(subset),) for n in range(6) for subset in combinations(range(5), n)}
    assert Encoded(task, 1).possible() == subsets
    assert Encoded(task, 1, busy=True).possible() == {(subset,) for (subset,) in subsets if not subset >= {2, 3}}


def conditional_operation(*conditions: Assignment) -> Operation:
    return Operation(move=0, cost=1, preconditions=(), effects=((tuple(conditions), 1, 1),))


@pytest.mark.parametrize(
    ("conditions", "is_effective"),
    [(((0, 0),), True), (((0, 1),), False), (((0, 0), (2, 0)), True), (((0, 0), (2, 1)), False)],
)
def test_an_effect_comes_under_its_conditions(conditions: tuple[Assignment, ...], is_effective: bool) -> None:
    plain = make_task([2, 2, 2], goal=[(1, 1)])
    mover = Operation(move=1, cost=1, preconditions=((0, 1),), effects=(((), 1, 1), ((), 0, 0)))
    task = FiniteTask(
        names=plain.names, initial=plain.initial, goal=((1, 1),), operations=(conditional_operation(*conditions), mover), mutex_groups=()
    )
    assert Encoded(task, 1).possible(goal=True) == (sets("0") if is_effective else set())
    opposite_task = FiniteTask(names=plain.names, initial=plain.initial, goal=((1, 0),), operations=task.operations, mutex_groups=())
    assert Encoded(opposite_task, 1).possible(goal=True) == (sets("") if is_effective else sets("", "0"))


def test_what_does_something_under_conditions_is_done_alone() -> None:
    plain = make_task([2, 2, 2, 2], ({}, {2: 1}), ({}, {3: 1}))
    operations = (
        conditional_operation((0, 0)),
        *(Operation(move=n, cost=1, preconditions=(), effects=o.effects) for n, o in enumerate(plain.operations, 1)),
        Operation(move=3, cost=1, preconditions=(), effects=((((0, 0),), 0, 0), ((), 1, 0))),
    )
    task = FiniteTask(names=plain.names, initial=plain.initial, goal=(), operations=operations, mutex_groups=())
    assert Encoded(task, 1).possible() == sets("", "0", "1", "2", "12", "3")


@pytest.mark.parametrize(
    ("goal", "least"),
    [([], 0), ([(0, 0)], 0), ([(1, 1)], 1), ([(3, 1)], 3), ([(1, 1), (2, 1)], 2), ([(4, 1)], None), ([(1, 1), (4, 1)], None)],
)
def test_the_least_number_of_steps(goal: list[Assignment], least: int | None) -> None:
    chain = [({}, {1: 1}), ({1: 1}, {2: 1}), ({2: 1}, {3: 1}), ({4: 1}, {4: 1})]
    assert Clauses(make_task([2] * 5, *chain, goal=goal), lambda clause: None).least == least


def test_a_plan_has_the_moves_of_its_steps_in_order() -> None:
    chain = make_task([2] * 4, ({2: 1}, {3: 1}), ({}, {1: 1}), ({1: 1}, {2: 1}), goal=[(3, 1)])
    encoded = Encoded(chain, 3)
    assert encoded.clauses.steps == 3
    assert [1, 2, 0] in encoded.plans()
    assert {frozenset(plan) for plan in encoded.plans()} == {frozenset({0, 1, 2})}
    (true,) = [model for model in [solution(encoded.written, {*encoded.clauses.goal_assumptions(3)})] if model]
    assert len(encoded.clauses.plan(true, 2)) < len(encoded.clauses.plan(true, 3))
    assert [sorted(step_literals) for step_literals in encoded.literals_by_step] == [[1], [1, 2], [0, 1, 2]]


@examples(40)
@given(tasks())
def test_whatever_the_clauses_allow_is_a_plan_and_a_plan_is_allowed(task: FiniteTask) -> None:
    expected = find_plan(task)
    if expected is not None and len(expected) <= 2:
        assert Clauses(task, lambda clause: None).least is not None
        assert Encoded(task, len(expected)).possible(goal=True)
    for steps in (1, 2):
        encoded = Encoded(task, 0)
        if encoded.clauses.least is None or encoded.clauses.least > steps:
            continue
        for plan in Encoded(task, steps).plans():
            state = task.initial
            for move in plan:
                assert is_satisfied(task.operations[move].preconditions, state), plan
                state = apply_operation(task.operations[move], state)
            assert is_satisfied(task.goal, state), plan
