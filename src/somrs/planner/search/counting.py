"""Search for tasks with counters, such as a battery's charge: a state has facts and numbers, and a number can take any value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

from somrs.entish import Arithmetic, Attribute, Comparison, Name, Not, Number, Term, Variable
from somrs.entish.formula import Literal
from somrs.ontology.types import AttributeType
from somrs.ontology.units import convert_unit
from somrs.ontology.values import MeasuredValue, attribute_at, compare, measure, value_of
from somrs.planner.grounding.task import Move, State, Task
from somrs.planner.model.world import World
from somrs.planner.search.search import AdditiveHeuristic

Numbers = tuple[float | None, ...]
"""The values of the counters, each in its attribute's unit; None for a counter without a value."""


class CountingFailed(Exception):
    """Planning with counters gave up. There may or may not be a plan."""


@dataclass(frozen=True, slots=True)
class NumericCondition:
    """A comparison `literal`, in which variables stand for the counters `read_counters`."""

    literal: Literal
    read_counters: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class NumericEffect:
    """An assignment of `source` to `counter`; variables in `source` stand for the counters `read_counters`."""

    counter: int
    source: Term
    read_counters: tuple[int, ...]


class Counters:
    """The counters of a task, with the numeric conditions and effects of its moves."""

    def __init__(self, task: Task, world: World) -> None:
        self._world = world
        self._place: dict[tuple[str, str], int] = {}
        self.names: list[str] = []
        """The names of the variables that stand for the counters."""
        self.attributes: list[AttributeType | None] = []
        self._initial: list[float | None] = []
        self.numeric_conditions: dict[Move, tuple[NumericCondition, ...]] = {}
        self.numeric_effects: dict[Move, tuple[NumericEffect, ...]] = {}
        for move in task.moves:
            self.numeric_conditions[move] = tuple(self._numeric_condition(literal) for literal in move.action.numeric_conditions)
            self.numeric_effects[move] = tuple(self._numeric_effect(target, source) for target, source in move.action.numeric_effects)
        self._answers: dict[tuple[NumericCondition, Numbers], bool] = {}

    @property
    def initial(self) -> Numbers:
        return tuple(self._initial)

    def unit(self, counter: int) -> str | None:
        attribute = self.attributes[counter]
        return attribute.unit if attribute is not None else None

    def measure_term(self, term: Term) -> Number | None:
        """The value of a term without counters; None if it is no number."""
        measurement = measure(term, self._world.map, self._world.ontology)
        return measurement.constant if measurement is not None and isinstance(measurement.constant, Number) else None

    def allows(self, move: Move, numbers: Numbers) -> bool:
        """Whether the move's numeric conditions hold."""
        return all(self._is_satisfied(condition, numbers) for condition in self.numeric_conditions[move])

    def apply(self, move: Move, numbers: Numbers) -> Numbers | None:
        """The counters after the move; None if a counter would be undefined or out of range."""
        effects = self.numeric_effects[move]
        if not effects:
            return numbers
        new_numbers = list(numbers)
        for effect in effects:
            value = self._value(effect, numbers)
            if value is None:
                return None
            new_numbers[effect.counter] = value
        return tuple(new_numbers)

    def gap(self, move: Move, numbers: Numbers) -> float:
        """A measure of how far the move's numeric conditions are from being satisfied; 0 if they are."""
        return sum(
            self._gap(condition, numbers) for condition in self.numeric_conditions[move] if not self._is_satisfied(condition, numbers)
        )

    def _gap(self, condition: NumericCondition, numbers: Numbers) -> float:
        """The gap of an unsatisfied condition: between 1 and 2, increasing with the difference of the two sides."""
        atom = condition.literal.atom if isinstance(condition.literal, Not) else condition.literal
        assert isinstance(atom, Comparison), "counters are compared"
        binding = self._binding(condition.read_counters, numbers)
        apart = self._measure_side(Arithmetic(atom.left, "-", atom.right), binding)
        if apart is None or not isinstance(apart.constant, Number):
            return 2.0
        return 2.0 - 1.0 / (1.0 + abs(apart.constant.value))

    def _is_satisfied(self, condition: NumericCondition, numbers: Numbers) -> bool:
        key = condition, tuple(numbers[counter] for counter in condition.read_counters)
        if key not in self._answers:
            self._answers[key] = self._compare_sides(condition, numbers)
        return self._answers[key]

    def _compare_sides(self, condition: NumericCondition, numbers: Numbers) -> bool:
        atom = condition.literal.atom if isinstance(condition.literal, Not) else condition.literal
        assert isinstance(atom, Comparison), "counters are compared"
        binding = self._binding(condition.read_counters, numbers)
        left_value, right_value = self._measure_side(atom.left, binding), self._measure_side(atom.right, binding)
        is_true = left_value is not None and right_value is not None and compare(left_value, atom.operator, right_value)
        return is_true is not isinstance(condition.literal, Not)

    def _measure_side(self, side: Term, binding: dict[str, Term]) -> MeasuredValue | None:
        measurement = measure(side, self._world.map, self._world.ontology, binding)
        if measurement is not None and isinstance(side, Variable):
            attribute = attribute_at(side.name.partition(".")[2], self._world.ontology)
            return MeasuredValue(measurement.constant, attribute.tolerance if attribute is not None else 0.0)
        return measurement

    def _value(self, effect: NumericEffect, numbers: Numbers) -> float | None:
        measured = measure(effect.source, self._world.map, self._world.ontology, self._binding(effect.read_counters, numbers))
        attribute = self.attributes[effect.counter]
        if measured is None or not isinstance(measured.constant, Number) or attribute is None:
            return None
        value: float | None = measured.constant.value
        if measured.constant.unit is not None and attribute.unit is not None:
            value = convert_unit(measured.constant.value, measured.constant.unit, attribute.unit)
        low, high = attribute.minimum, attribute.maximum
        is_in_range = value is not None and (low is None or value >= low) and (high is None or value <= high)
        return value if is_in_range else None

    def _binding(self, read_counters: tuple[int, ...], numbers: Numbers) -> dict[str, Term]:
        binding: dict[str, Term] = {}
        for counter in read_counters:
            value = numbers[counter]
            if value is not None:
                binding[self.names[counter]] = Number(value, self.unit(counter))
        return binding

    # Reading formulas

    def _numeric_condition(self, literal: Literal) -> NumericCondition:
        read_counters: list[int] = []
        atom = literal.atom if isinstance(literal, Not) else literal
        assert isinstance(atom, Comparison), "counters are compared"
        hidden = Comparison(self._hidden(atom.left, read_counters), atom.operator, self._hidden(atom.right, read_counters))
        return NumericCondition(Not(hidden) if isinstance(literal, Not) else hidden, tuple(read_counters))

    def _numeric_effect(self, target: Attribute, source: Term) -> NumericEffect:
        read_counters: list[int] = []
        hidden = self._hidden(source, read_counters)
        return NumericEffect(self._counter(target), hidden, tuple(read_counters))

    def _hidden(self, term: Term, read_counters: list[int]) -> Term:
        """The term with variables in place of counters; the function adds the counters to `read_counters`."""
        if isinstance(term, Arithmetic):
            return Arithmetic(self._hidden(term.left, read_counters), term.operator, self._hidden(term.right, read_counters))
        attribute = self._world.vocabulary.counter(term)
        if attribute is None:
            return term
        read_counters.append(self._counter(attribute))
        return Variable(str(attribute))

    def _counter(self, attribute: Attribute) -> int:
        assert isinstance(attribute.owner, Name), "the action is ground"
        key = attribute.owner.name, attribute.path
        if key not in self._place:
            self._place[key] = len(self.attributes)
            self.names.append(str(attribute))
            self.attributes.append(attribute_at(attribute.path, self._world.ontology))
            value = value_of(attribute.owner.name, attribute.path, self._world.map, self._world.ontology)
            self._initial.append(value if isinstance(value, int | float) and not isinstance(value, bool) else None)
        return self._place[key]


def search_with_counters(task: Task, counters: Counters, max_states: int) -> list[Move] | None:
    """The moves of a plan that satisfies all numeric conditions, or None if there is no plan. Raises CountingFailed after `max_states`
    states.

    Greedy best-first search. The heuristic takes only facts into account; ties are broken by the gap of the numeric conditions of the goal
    and of the helpful moves.
    """
    goals = [move for move in task.moves if move.action.operator.reaches_goal]
    heuristic = AdditiveHeuristic(task)
    start = task.initial, counters.initial
    parents: dict[tuple[State, Numbers], tuple[tuple[State, Numbers], Move] | None] = {start: None}
    open_: list[tuple[float, float, bool, int, tuple[State, Numbers]]] = [(0.0, 0.0, True, 0, start)]
    distances: dict[State, tuple[float | None, set[Move]]] = {}
    while open_:
        *_, node = heappop(open_)
        state, numbers = node
        if state not in distances:
            distances[state] = heuristic.evaluate(state)
        distance, helpful = distances[state]
        if distance is None:
            continue
        for move in task.moves:
            if not move.is_applicable(state) or not counters.allows(move, numbers):
                continue
            new_numbers = counters.apply(move, numbers)
            if new_numbers is None:
                continue
            if move in goals:
                return _path(parents, node)
            successor = task.apply(move, state), new_numbers
            if successor not in parents:
                parents[successor] = node, move
                hopeful = distances[successor[0]][1] if successor[0] in distances else set()
                gap = min(counters.gap(goal, new_numbers) for goal in goals)
                gap += min((counters.gap(helpful_move, new_numbers) for helpful_move in hopeful), default=0.0)
                heappush(open_, (distance, gap, move not in helpful, len(parents), successor))
        if len(parents) > max_states:
            raise CountingFailed(f"{len(parents)} states were looked at")
    return None


def _path(parents: dict[tuple[State, Numbers], tuple[tuple[State, Numbers], Move] | None], node: tuple[State, Numbers]) -> list[Move]:
    moves: list[Move] = []
    while (step := parents[node]) is not None:
        node, move = step
        moves.append(move)
    return moves[::-1]


def remove_redundant_moves(moves: Sequence[Move], task: Task, counters: Counters) -> list[Move]:
    """The plan without redundant moves; each move is tested by itself."""
    kept_moves = list(moves)
    for move in moves:
        rest = list(kept_moves)
        rest.remove(move)
        if reaches_goal(rest, task, counters):
            kept_moves = rest
    return kept_moves


def reaches_goal(moves: Sequence[Move], task: Task, counters: Counters) -> bool:
    """Whether the moves are applicable in sequence and reach the goal."""
    state, numbers = task.initial, counters.initial
    for move in moves:
        if not move.is_applicable(state) or not counters.allows(move, numbers):
            return False
        new_numbers = counters.apply(move, numbers)
        if new_numbers is None:
            return False
        state, numbers = task.apply(move, state), new_numbers
    goals = (move for move in task.moves if move.action.operator.reaches_goal)
    return any(move.is_applicable(state) and counters.allows(move, numbers) for move in goals)
