"""That there is no plan, shown by counting: it is never said of a task that has one."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, composite

from somrs.planner.encodings.equation import Equation, companions, definite, equation
from somrs.planner.encodings.sas import encode_sas
from somrs.planner.grounding.finite import Assignment, Effect, FiniteTask, Operation, State
from tests.support.examples import examples

needs_scipy = pytest.mark.skipif(importlib.util.find_spec("scipy") is None, reason="SciPy is not installed")


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
        operations=tuple(Operation(move=n, cost=1, preconditions=needs, effects=made) for n, (needs, made) in enumerate(operations)),
        mutex_groups=(),
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
            if holds(operation.preconditions, state) and (after := done(operation, state)) not in before:
                before[after] = (state, number)
                waiting.append(after)
    return None


def holds(facts: tuple[Assignment, ...], state: State) -> bool:
    return all(state[variable] == value for variable, value in facts)


def done(operation: Operation, state: State) -> State:
    values = {variable: value for conditions, variable, value in operation.effects if holds(conditions, state)}
    return tuple(values.get(variable, value) for variable, value in enumerate(state))


def occurrences(task: FiniteTask, plan: list[int], wanted: Equation) -> list[int]:
    """How often each case occurs in the plan, by carrying it out."""
    times = [0] * len(wanted.cases)
    state = task.initial
    for number in plan:
        for place, (operation, when) in enumerate(wanted.cases):
            times[place] += operation == number and holds(when, state)
        state = done(task.operations[number], state)
    return times


@examples(30)
@given(tasks())
def test_every_plan_satisfies_the_equation_of_whichever_pairs(task: FiniteTask) -> None:
    plan = a_plan(task)
    if plan is None:
        return
    every = list(combinations(sorted(definite(task)), 2))
    for pairs in ([], companions(task), every):
        wanted = equation(task, pairs)
        sums = [0] * len(wanted.least)
        times = occurrences(task, plan, wanted)
        for place, case, change in wanted.terms:
            sums[place] += change * times[case]
        assert all(found >= least for found, least in zip(sums, wanted.least, strict=True)), (pairs, plan)


@examples(30)
@given(tasks())
def test_companions_are_definite_and_what_changes_one_says_the_other(task: FiniteTask) -> None:
    for first, second in companions(task):
        assert {first, second} <= definite(task)
        assert any(
            all(
                one in dict(operation.preconditions)
                for operation in task.operations
                if any(variable == other for _, variable, _ in operation.effects)
            )
            for one, other in ((first, second), (second, first))
        )


def test_a_lamp_that_a_switch_lights_only_if_there_is_power_is_not_looked_at_with_it() -> None:
    switch, lamp, power = range(3)
    pressed = Operation(move=0, cost=1, preconditions=((switch, 0),), effects=(((), switch, 1), (((power, 1),), lamp, 1)))
    plugged = Operation(move=1, cost=1, preconditions=((power, 0),), effects=(((), power, 1),))
    task = FiniteTask(
        names=(("up()", "down()"), ("dark()", "lit()"), ("out()", "in()")),
        initial=(0, 0, 0),
        goal=((lamp, 1),),
        operations=(pressed, plugged),
        mutex_groups=(),
    )
    assert definite(task) == {switch, power}
    assert companions(task) == []


@needs_scipy
@examples(50)
@given(tasks())
def test_no_plan_is_said_of_no_task_that_has_one(task: FiniteTask) -> None:
    from somrs.planner_service.engine_equation import equations, is_unsatisfiable

    if any(map(is_unsatisfiable, equations(task))):
        assert a_plan(task) is None


def proved(task: FiniteTask, place: Path) -> bool:
    file = place / "task.sas"
    file.write_text(encode_sas(task), encoding="ascii")
    from somrs.planner_service.engine_equation import UNSOLVABLE, main

    return main(str(file)) == UNSOLVABLE


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
        operations=tuple(Operation(move=n, cost=1, preconditions=needs, effects=effects) for n, (needs, effects) in enumerate(all_moves)),
        mutex_groups=(),
    )


@needs_scipy
@pytest.mark.parametrize(("passengers", "counted"), [(1, 1), (2, 2), (0, 0), (1, 0), (2, 1), (0, 1)])
def test_a_lift_that_counts_too_few_lets_nobody_out(passengers: int, counted: int, tmp_path: Path) -> None:
    task = lift(passengers, counted)
    assert proved(task, tmp_path) == (counted < passengers)
    assert (a_plan(task) is None) == (counted < passengers)


def sensors(charges: tuple[int, ...], measured: tuple[bool, ...]) -> FiniteTask:
    """Sensors in a row, the last one beside the base, that are to send what they measure to it. Each has a message of its own and a
    charge, of which measuring and sending take one each. Data is put on a message and taken off it where the message is."""
    row = range(len(charges))
    base = len(charges)
    names = [tuple(f"charge{sensor}({left})" for left in range(max(charges) + 1)) for sensor in row]
    names += [tuple(f"at{message}({place})" for place in range(base + 1)) for message in row]
    names += [("out()", "has()") for _ in range(base * (base + 1))]  # whose data is where
    names += [("off()", "on()") for _ in range(base * base)]  # whose data is on which message

    def at(message: int) -> int:
        return base + message

    def has(place: int, data: int) -> int:
        return 2 * base + place * base + data

    def on(message: int, data: int) -> int:
        return 2 * base + base * (base + 1) + message * base + data

    def moves() -> Iterator[tuple[tuple[Assignment, ...], tuple[Effect, ...]]]:
        for sensor in row:
            for left in range(1, charges[sensor] + 1):
                yield ((sensor, left),), (((), sensor, left - 1), ((), has(sensor, sensor), 1))
                for message in row:
                    sent = ((), at(message), sensor + 1)
                    yield ((sensor, left), (at(message), sensor)), (((), sensor, left - 1), sent)
        for message in row:
            for data in row:
                for place in range(base + 1):
                    here, there = has(place, data), on(message, data)
                    yield ((at(message), place), (here, 1), (there, 0)), (((), here, 0), ((), there, 1))
                    yield ((at(message), place), (there, 1)), (((), there, 0), ((), here, 1))

    initial = [*charges, *row, *(0 for _ in names[2 * base :])]
    for sensor in row:
        initial[has(sensor, sensor)] = int(measured[sensor])
    return FiniteTask(
        names=tuple(names),
        initial=tuple(initial),
        goal=tuple((has(base, data), 1) for data in row),
        operations=tuple(Operation(move=n, cost=1, preconditions=needs, effects=effects) for n, (needs, effects) in enumerate(moves())),
        mutex_groups=(),
    )


@needs_scipy
@pytest.mark.parametrize(
    ("charges", "measured", "possible"),
    [
        ((2,), (False,), True),
        ((1,), (True,), True),
        ((1,), (False,), False),
        ((2, 2), (False, False), True),
        ((1, 1), (True, True), True),
        ((1, 2), (False, True), False),
        ((2, 1), (False, False), False),
        ((1, 0), (True, True), False),
    ],
)
def test_data_reaches_the_base_only_if_a_charge_is_left_to_send_it(
    charges: tuple[int, ...], measured: tuple[bool, ...], possible: bool, tmp_path: Path
) -> None:
    task = sensors(charges, measured)
    assert (a_plan(task) is not None) == possible
    assert proved(task, tmp_path) != possible
