"""That there is no plan, shown by counting: it is never said of a task that has one."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, composite

from somrs.planner.equation import equation
from somrs.planner.finite import Assignment, Effect, FiniteTask, Operation, State
from somrs.planner.sas import written

needs_scipy = pytest.mark.skipif(importlib.util.find_spec("scipy") is None, reason="SciPy is not installed")
PROVED = 11


@composite
def tasks(draw: DrawFn) -> FiniteTask:
    sizes = draw(st.lists(st.integers(2, 3), min_size=1, max_size=4))
    variables = st.integers(0, len(sizes) - 1)
    facts = variables.flatmap(lambda v: st.tuples(st.just(v), st.integers(0, sizes[v] - 1)))
    some = st.lists(facts, max_size=2, unique_by=lambda fact: fact[0]).map(tuple)
    effects = st.lists(
        st.tuples(st.one_of(st.just(()), some), facts).map(lambda drawn: (drawn[0], *drawn[1])),
        min_size=1,
        max_size=2,
        unique_by=lambda effect: effect[1],
    ).map(tuple)
    operations = draw(st.lists(st.tuples(some, effects), max_size=4))
    return FiniteTask(
        names=tuple(tuple(f"fact{v}({x})" for x in range(size)) for v, size in enumerate(sizes)),
        initial=tuple(draw(st.integers(0, size - 1)) for size in sizes),
        goal=draw(st.lists(facts, min_size=1, max_size=3, unique_by=lambda fact: fact[0]).map(tuple)),
        operations=tuple(Operation(move=n, cost=1, needs=needs, effects=made) for n, (needs, made) in enumerate(operations)),
        exclusive=(),
    )


def a_plan(task: FiniteTask) -> list[int] | None:
    """By going through all states."""
    before: dict[State, tuple[State, int] | None] = {task.initial: None}
    for state in (waiting := [task.initial]):
        if all(state[variable] == value for variable, value in task.goal):
            found: list[int] = []
            at: State = state
            while (step := before[at]) is not None:
                found.append(step[1])
                at = step[0]
            return found[::-1]
        for number, operation in enumerate(task.operations):
            if holds(operation.needs, state) and (after := done(operation, state)) not in before:
                before[after] = (state, number)
                waiting.append(after)
    return None


def holds(facts: tuple[Assignment, ...], state: State) -> bool:
    return all(state[variable] == value for variable, value in facts)


def done(operation: Operation, state: State) -> State:
    values = {variable: value for conditions, variable, value in operation.effects if holds(conditions, state)}
    return tuple(values.get(variable, value) for variable, value in enumerate(state))


@given(tasks())
def test_every_plan_satisfies_the_equation(task: FiniteTask) -> None:
    plan = a_plan(task)
    if plan is None:
        return
    wanted, times = equation(task), Counter(plan)
    for fact, least in enumerate(wanted.least):
        assert sum(change * times[operation] for place, operation, change in wanted.terms if place == fact) >= least, wanted.facts[fact]


def proved(task: FiniteTask, place: Path) -> bool:
    file = place / "task.sas"
    file.write_text(written(task), encoding="ascii")
    return subprocess.run([sys.executable, "-m", "somrs.app.engine_equation", str(file)], check=False).returncode == PROVED


def lift(passengers: int, counted: int) -> FiniteTask:
    """Passengers in a lift for two, who want out, and one who waits; and how many the lift believes that it has."""
    names = [tuple(f"in{n}({where})" for where in ("waiting", "lift", "out")) for n in range(3)]
    count = len(names)

    def moves(who: int, start: int, end: int, by: int) -> list[tuple[tuple[Assignment, ...], tuple[Effect, ...]]]:
        counts = [(n, n + by) for n in range(3) if 0 <= n + by < 3]
        return [(((who, start), (count, n)), (((), who, end), ((), count, after))) for n, after in counts]

    all_moves = [move for who in range(3) for start, end, by in ((0, 1, 1), (1, 2, -1)) for move in moves(who, start, end, by)]
    return FiniteTask(
        names=(*names, ("count(0)", "count(1)", "count(2)")),
        initial=(*(1 if who < passengers else 0 for who in range(3)), counted),
        goal=tuple((who, 2) for who in range(3)),
        operations=tuple(Operation(move=n, cost=1, needs=needs, effects=effects) for n, (needs, effects) in enumerate(all_moves)),
        exclusive=(),
    )


@needs_scipy
@pytest.mark.parametrize(("passengers", "counted"), [(1, 1), (2, 2), (0, 0), (1, 0), (2, 1), (0, 1)])
def test_a_lift_that_counts_too_few_lets_nobody_out(passengers: int, counted: int, tmp_path: Path) -> None:
    task = lift(passengers, counted)
    assert proved(task, tmp_path) == (counted < passengers)
    assert (a_plan(task) is None) == (counted < passengers)
