"""A task as clauses: they can be satisfied in so many steps just when there is such a plan."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations, product

import pytest
from hypothesis import given

from somrs.planner.encodings.satisfiability import Clauses
from somrs.planner.grounding.finite import Assignment, FiniteTask, Operation
from tests.support.examples import examples
from tests.unit.planner.encodings.test_equation import a_plan, done, holds, tasks

Needs = dict[int, int]


class Encoded:
    """The clauses of a task for so many steps, and what can be done in them."""

    def __init__(self, task: FiniteTask, steps: int, *, busy: bool = False) -> None:
        self.steps = steps
        self.written: list[list[int]] = []
        self.clauses = Clauses(task, self.written.append, busy=busy)
        for _ in range(steps):
            self.clauses.extend()
        self.of: list[dict[int, int]] = [{} for _ in range(steps)]
        """For each step the moves that may be done in it, and their literals."""
        for literal in range(1, self.clauses.literals + 1):
            for step in range(steps):
                if move := self.clauses.plan({literal}, step + 1):
                    self.of[step][move[0]] = literal
                    break

    def possible(self, goal: bool = False) -> set[tuple[frozenset[int], ...]]:
        """All that can be done in the steps; so that the goal is reached, if that is asked for."""
        assumed = self.clauses.goal_assumptions(self.steps) if goal else []
        every = [[frozenset(some) for n in range(len(of) + 1) for some in combinations(sorted(of), n)] for of in self.of]
        return {chosen for chosen in product(*every) if self._model(chosen, assumed) is not None}

    def plans(self) -> list[list[int]]:
        """The moves of the solutions, in order."""
        assumed = self.clauses.goal_assumptions(self.steps)
        found = (self._model(chosen, assumed) for chosen in self.possible(goal=True))
        return [self.clauses.plan(true, self.steps) for true in found if true is not None]

    def _model(self, chosen: tuple[frozenset[int], ...], assumed: list[int]) -> set[int] | None:
        moves = [literal if move in some else -literal for of, some in zip(self.of, chosen, strict=True) for move, literal in of.items()]
        return solution(self.written, {*moves, *assumed})


def solution(clauses: list[list[int]], true: set[int]) -> set[int] | None:
    """What is true in a model in which these literals are; None if there is none."""
    true, changed = set(true), True
    while changed:
        changed, left = False, []
        for clause in clauses:
            if true.isdisjoint(clause):
                free = [literal for literal in clause if -literal not in true]
                if not free:
                    return None
                if len(free) == 1:
                    true.add(free[0])
                    changed = True
                else:
                    left.append(free)
        clauses = left
    if not clauses:
        return true
    choice = clauses[0][0]
    found = solution(clauses, true | {choice})
    return found if found is not None else solution(clauses, true | {-choice})


def task(
    sizes: list[int],
    *operations: tuple[Needs, Needs],
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
                preconditions=tuple(needs.items()),
                effects=tuple(((), variable, value) for variable, value in made.items()),
                device=devices[number] if devices else 0,
            )
            for number, (needs, made) in enumerate(operations)
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
def test_what_can_be_done_in_one_step(operations: list[tuple[Needs, Needs]], possible: list[str]) -> None:
    assert Encoded(task([2, 2, 2], *operations), 1).possible() == sets(*possible)


@pytest.mark.parametrize("number", [2, 3, 5, 6, 7, 10])
def test_of_what_excludes_each_other_one_is_done_at_most(number: int) -> None:
    asked = task([2] * number, *(({}, {n: 1}) for n in range(number)), exclusive=(tuple((n, 1) for n in range(number)),))
    assert Encoded(asked, 1).possible() == sets("", *map(str, range(number)))


@pytest.mark.parametrize("number", [2, 6])
def test_a_variable_has_one_value_at_a_time(number: int) -> None:
    """None of these takes away what another needs."""
    asked = task([number + 1], *(({}, {0: n + 1}) for n in range(number)))
    assert Encoded(asked, 1).possible() == sets("", *map(str, range(number)))


def test_a_device_does_one_thing_in_a_step_if_that_is_asked_for() -> None:
    asked = task([2] * 5, *(({}, {n: 1}) for n in range(5)), devices=(0, 0, 1, 1, 2))
    every = {(frozenset(some),) for n in range(6) for some in combinations(range(5), n)}
    assert Encoded(asked, 1).possible() == every
    assert Encoded(asked, 1, busy=True).possible() == {(some,) for (some,) in every if not some >= {2, 3}}


def under(*conditions: Assignment) -> Operation:
    return Operation(move=0, cost=1, preconditions=(), effects=((tuple(conditions), 1, 1),))


@pytest.mark.parametrize(
    ("conditions", "comes"),
    [(((0, 0),), True), (((0, 1),), False), (((0, 0), (2, 0)), True), (((0, 0), (2, 1)), False)],
)
def test_an_effect_comes_under_its_conditions(conditions: tuple[Assignment, ...], comes: bool) -> None:
    plain = task([2, 2, 2], goal=[(1, 1)])
    mover = Operation(move=1, cost=1, preconditions=((0, 1),), effects=(((), 1, 1), ((), 0, 0)))
    asked = FiniteTask(names=plain.names, initial=plain.initial, goal=((1, 1),), operations=(under(*conditions), mover), mutex_groups=())
    assert Encoded(asked, 1).possible(goal=True) == (sets("0") if comes else set())
    left = FiniteTask(names=plain.names, initial=plain.initial, goal=((1, 0),), operations=asked.operations, mutex_groups=())
    assert Encoded(left, 1).possible(goal=True) == (sets("") if comes else sets("", "0"))


def test_what_does_something_under_conditions_is_done_alone() -> None:
    plain = task([2, 2, 2, 2], ({}, {2: 1}), ({}, {3: 1}))
    operations = (
        under((0, 0)),
        *(Operation(move=n, cost=1, preconditions=(), effects=o.effects) for n, o in enumerate(plain.operations, 1)),
        Operation(move=3, cost=1, preconditions=(), effects=((((0, 0),), 0, 0), ((), 1, 0))),
    )
    asked = FiniteTask(names=plain.names, initial=plain.initial, goal=(), operations=operations, mutex_groups=())
    assert Encoded(asked, 1).possible() == sets("", "0", "1", "2", "12", "3")


@pytest.mark.parametrize(
    ("goal", "least"),
    [([], 0), ([(0, 0)], 0), ([(1, 1)], 1), ([(3, 1)], 3), ([(1, 1), (2, 1)], 2), ([(4, 1)], None), ([(1, 1), (4, 1)], None)],
)
def test_the_least_number_of_steps(goal: list[Assignment], least: int | None) -> None:
    chain = [({}, {1: 1}), ({1: 1}, {2: 1}), ({2: 1}, {3: 1}), ({4: 1}, {4: 1})]
    assert Clauses(task([2] * 5, *chain, goal=goal), lambda clause: None).least == least


def test_a_plan_has_the_moves_of_its_steps_in_order() -> None:
    chain = task([2] * 4, ({2: 1}, {3: 1}), ({}, {1: 1}), ({1: 1}, {2: 1}), goal=[(3, 1)])
    encoded = Encoded(chain, 3)
    assert encoded.clauses.steps == 3
    assert [1, 2, 0] in encoded.plans()
    assert {frozenset(plan) for plan in encoded.plans()} == {frozenset({0, 1, 2})}
    (true,) = [found for found in [solution(encoded.written, {*encoded.clauses.goal_assumptions(3)})] if found]
    assert len(encoded.clauses.plan(true, 2)) < len(encoded.clauses.plan(true, 3))
    assert [sorted(of) for of in encoded.of] == [[1], [1, 2], [0, 1, 2]]


@examples(40)
@given(tasks())
def test_whatever_the_clauses_allow_is_a_plan_and_a_plan_is_allowed(asked: FiniteTask) -> None:
    expected = a_plan(asked)
    if expected is not None and len(expected) <= 2:
        assert Clauses(asked, lambda clause: None).least is not None
        assert Encoded(asked, len(expected)).possible(goal=True)
    for steps in (1, 2):
        encoded = Encoded(asked, 0)
        if encoded.clauses.least is None or encoded.clauses.least > steps:
            continue
        for plan in Encoded(asked, steps).plans():
            state = asked.initial
            for move in plan:
                assert holds(asked.operations[move].preconditions, state), plan
                state = done(asked.operations[move], state)
            assert holds(asked.goal, state), plan
