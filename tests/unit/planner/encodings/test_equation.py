"""That there is no plan, shown by counting: it is never said of a task that has one."""

from __future__ import annotations

import functools
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
from somrs.planner.grounding.finite_task import Assignment, Effect, FiniteTask, Operation, State
from tests.support.examples import examples

needs_scipy = pytest.mark.skipif(importlib.util.find_spec("scipy") is None, reason="SciPy is not installed")


sizes_of_variables = st.lists(st.integers(2, 3), min_size=1, max_size=4).map(tuple)


@functools.cache  # Hypothesis takes longer to make strategies than to draw from them
def goals_and_operations(
    sizes: tuple[int, ...],
) -> tuple[st.SearchStrategy[tuple[Assignment, ...]], st.SearchStrategy[list[tuple[tuple[Assignment, ...], tuple[Effect, ...]]]]]:
    variables = st.integers(0, len(sizes) - 1)
    facts = variables.flatmap(lambda v: st.tuples(st.just(v), st.integers(0, sizes[v] - 1)))
    assignments = st.lists(facts, max_size=2, unique_by=lambda fact: fact[0]).map(tuple)
    effects = st.lists(
        st.tuples(st.one_of(st.just(()), assignments), facts).map(lambda drawn: (drawn[0], *drawn[1])),
        min_size=1,
        max_size=2,
        unique_by=lambda effect: effect[1],
    ).map(tuple)
    goals = st.lists(facts, min_size=1, max_size=3, unique_by=lambda fact: fact[0]).map(tuple)
    return goals, st.lists(st.tuples(assignments, effects), max_size=4)


@composite
def tasks(draw: DrawFn) -> FiniteTask:
    sizes = draw(sizes_of_variables)
    goals, operation_lists = goals_and_operations(sizes)
    operations = draw(operation_lists)
    return FiniteTask(
        names=tuple(tuple(f"fact{v}({x})" for x in range(size)) for v, size in enumerate(sizes)),
        initial=tuple(draw(st.integers(0, size - 1)) for size in sizes),
        goal=draw(goals),
        operations=tuple(
            Operation(move=n, cost=1, preconditions=preconditions, effects=operation_effects)
            for n, (preconditions, operation_effects) in enumerate(operations)
        ),
        mutex_groups=(),
    )


def find_plan(task: FiniteTask) -> list[int] | None:
    """By going through all states."""
    parents: dict[State, tuple[State, int] | None] = {task.initial: None}
    for state in (waiting := [task.initial]):
        if all(state[variable] == value for variable, value in task.goal):
            plan_moves: list[int] = []
            current_state: State = state
            while (step := parents[current_state]) is not None:
                plan_moves.append(step[1])
                current_state = step[0]
            return plan_moves[::-1]
        for number, operation in enumerate(task.operations):
            if is_satisfied(operation.preconditions, state) and (successor := apply_operation(operation, state)) not in parents:
                parents[successor] = (state, number)
                waiting.append(successor)
    return None


def is_satisfied(facts: tuple[Assignment, ...], state: State) -> bool:
    return all(state[variable] == value for variable, value in facts)


def apply_operation(operation: Operation, state: State) -> State:
    values = {variable: value for conditions, variable, value in operation.effects if is_satisfied(conditions, state)}
    return tuple(values.get(variable, value) for variable, value in enumerate(state))


def occurrences(task: FiniteTask, plan: list[int], state_equation: Equation) -> list[int]:
    """How often each case occurs in the plan, by carrying it out."""
    times = [0] * len(state_equation.cases)
    state = task.initial
    for number in plan:
        for place, (operation, conditions) in enumerate(state_equation.cases):
            times[place] += operation == number and is_satisfied(conditions, state)
        state = apply_operation(task.operations[number], state)
    return times


@examples(30)
@given(tasks())
def test_every_plan_satisfies_the_equation_of_whichever_pairs(task: FiniteTask) -> None:
    plan = find_plan(task)
    if plan is None:
        return
    all_pairs = list(combinations(sorted(definite(task)), 2))
    for pairs in ([], companions(task), all_pairs):
        state_equation = equation(task, pairs)
        sums = [0] * len(state_equation.least)
        times = occurrences(task, plan, state_equation)
        for place, case, change in state_equation.terms:
            sums[place] += change * times[case]
        assert all(total >= least for total, least in zip(sums, state_equation.least, strict=True)), (pairs, plan)


@examples(30)
@given(tasks())
def test_companions_are_definite_and_what_changes_one_says_the_other(task: FiniteTask) -> None:
    for first, second in companions(task):
        assert {first, second} <= definite(task)
        assert any(
            all(
                condition_variable in dict(operation.preconditions)
                for operation in task.operations
                if any(variable == changed_variable for _, variable, _ in operation.effects)
            )
            for condition_variable, changed_variable in ((first, second), (second, first))
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
        assert find_plan(task) is None


def is_proved_unsolvable(task: FiniteTask, place: Path) -> bool:
    file = place / "task.sas"
    file.write_text(encode_sas(task), encoding="ascii")
    from somrs.planner_service.engine_equation import UNSOLVABLE, main

    return main(str(file)) == UNSOLVABLE


def lift(passengers: int, counted: int) -> FiniteTask:
    """Passengers in a lift for two, who want out, and one who waits; and how many the lift believes that it has."""
    names = [tuple(f"in{n}({location})" for location in ("waiting", "lift", "out")) for n in range(3)]
    count = len(names)

    def moves(passenger: int, start: int, end: int, change: int) -> list[tuple[tuple[Assignment, ...], tuple[Effect, ...]]]:
        counts = [(n, n + change) for n in range(3) if 0 <= n + change < 3]
        return [(((passenger, start), (count, n)), (((), passenger, end), ((), count, new_count))) for n, new_count in counts]

    all_moves = [
        move for passenger in range(3) for start, end, change in ((0, 1, 1), (1, 2, -1)) for move in moves(passenger, start, end, change)
    ]
    return FiniteTask(
        names=(*names, ("count(0)", "count(1)", "count(2)")),
        initial=(*(1 if passenger < passengers else 0 for passenger in range(3)), counted),
        goal=tuple((passenger, 2) for passenger in range(3)),
        operations=tuple(
            Operation(move=n, cost=1, preconditions=preconditions, effects=effects) for n, (preconditions, effects) in enumerate(all_moves)
        ),
        mutex_groups=(),
    )


@needs_scipy
@pytest.mark.parametrize(("passengers", "counted"), [(1, 1), (2, 2), (0, 0), (1, 0), (2, 1), (0, 1)])
def test_a_lift_that_counts_too_few_lets_nobody_out(passengers: int, counted: int, tmp_path: Path) -> None:
    task = lift(passengers, counted)
    assert is_proved_unsolvable(task, tmp_path) == (counted < passengers)
    assert (find_plan(task) is None) == (counted < passengers)


def sensors(charges: tuple[int, ...], measured: tuple[bool, ...]) -> FiniteTask:
    """Sensors in a row, the last one beside the base, that are to send what they measure to it. Each has a message of its own and a
    charge, of which measuring and sending take one each. Data is put on a message and taken off it where the message is."""
    row = range(len(charges))
    base = len(charges)
    names = [tuple(f"charge{sensor}({charge})" for charge in range(max(charges) + 1)) for sensor in row]
    names += [tuple(f"at{message}({place})" for place in range(base + 1)) for message in row]
    names += [("out()", "has()") for _ in range(base * (base + 1))]  # whose data is where
    names += [("off()", "on()") for _ in range(base * base)]  # whose data is on which message

    def position_variable(message: int) -> int:
        return base + message

    def storage_variable(place: int, data: int) -> int:
        return 2 * base + place * base + data

    def load_variable(message: int, data: int) -> int:
        return 2 * base + base * (base + 1) + message * base + data

    def moves() -> Iterator[tuple[tuple[Assignment, ...], tuple[Effect, ...]]]:
        for sensor in row:
            for charge in range(1, charges[sensor] + 1):
                yield ((sensor, charge),), (((), sensor, charge - 1), ((), storage_variable(sensor, sensor), 1))
                for message in row:
                    sent_effect = ((), position_variable(message), sensor + 1)
                    yield ((sensor, charge), (position_variable(message), sensor)), (((), sensor, charge - 1), sent_effect)
        for message in row:
            for data in row:
                for place in range(base + 1):
                    stored_data, loaded_data = storage_variable(place, data), load_variable(message, data)
                    yield (
                        ((position_variable(message), place), (stored_data, 1), (loaded_data, 0)),
                        (((), stored_data, 0), ((), loaded_data, 1)),
                    )
                    yield ((position_variable(message), place), (loaded_data, 1)), (((), loaded_data, 0), ((), stored_data, 1))

    initial = [*charges, *row, *(0 for _ in names[2 * base :])]
    for sensor in row:
        initial[storage_variable(sensor, sensor)] = int(measured[sensor])
    return FiniteTask(
        names=tuple(names),
        initial=tuple(initial),
        goal=tuple((storage_variable(base, data), 1) for data in row),
        operations=tuple(
            Operation(move=n, cost=1, preconditions=preconditions, effects=effects) for n, (preconditions, effects) in enumerate(moves())
        ),
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
    assert (find_plan(task) is not None) == possible
    assert is_proved_unsolvable(task, tmp_path) != possible
