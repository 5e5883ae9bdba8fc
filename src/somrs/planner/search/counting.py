"""A task with counters, such as a battery's charge: states have numbers beside their facts, which may come to any value."""

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
from somrs.planner.search.search import Estimate

Numbers = tuple[float | None, ...]
"""The counters' values, each in its attribute's unit; None where there is none."""


class TooMany(Exception):
    """Not found among so many states; which does not say that there is no plan."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A comparison of counters, `reads`, which variables of their names stand for in `literal`."""

    literal: Literal
    reads: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Setting:
    """The counter `sets` gets the value of `source`, in which variables stand for the counters `reads`."""

    sets: int
    source: Term
    reads: tuple[int, ...]


class Counters:
    """The counters of a task, and what its moves ask and make of them."""

    def __init__(self, task: Task, world: World) -> None:
        self._world = world
        self._place: dict[tuple[str, str], int] = {}
        self.names: list[str] = []
        """What the variables that stand for them are called."""
        self.attributes: list[AttributeType | None] = []
        self._initial: list[float | None] = []
        self.conditions: dict[Move, tuple[Condition, ...]] = {}
        self.settings: dict[Move, tuple[Setting, ...]] = {}
        for move in task.moves:
            self.conditions[move] = tuple(self._condition(literal) for literal in move.action.counts)
            self.settings[move] = tuple(self._setting(target, source) for target, source in move.action.sets)
        self._answers: dict[tuple[Condition, Numbers], bool] = {}

    @property
    def initial(self) -> Numbers:
        return tuple(self._initial)

    def unit(self, counter: int) -> str | None:
        attribute = self.attributes[counter]
        return attribute.unit if attribute is not None else None

    def measured(self, term: Term) -> Number | None:
        """What a term without counters stands for."""
        found = measure(term, self._world.map, self._world.ontology)
        return found.constant if found is not None and isinstance(found.constant, Number) else None

    def allows(self, move: Move, numbers: Numbers) -> bool:
        """Whether all that the move asks of the counters is so."""
        return all(self._so(condition, numbers) for condition in self.conditions[move])

    def after(self, move: Move, numbers: Numbers) -> Numbers | None:
        """The counters after the move; None when one of them would be out of its range."""
        settings = self.settings[move]
        if not settings:
            return numbers
        made = list(numbers)
        for setting in settings:
            value = self._value(setting, numbers)
            if value is None:
                return None
            made[setting.sets] = value
        return tuple(made)

    def gap(self, move: Move, numbers: Numbers) -> float:
        """How far what the move asks of the counters is from being so: 0 when it is."""
        return sum(self._gap(condition, numbers) for condition in self.conditions[move] if not self._so(condition, numbers))

    def _gap(self, condition: Condition, numbers: Numbers) -> float:
        """Between 1 and 2, the more so the farther the two sides are apart."""
        atom = condition.literal.atom if isinstance(condition.literal, Not) else condition.literal
        assert isinstance(atom, Comparison), "counters are compared"
        bound = self._bound(condition.reads, numbers)
        apart = self._measured(Arithmetic(atom.left, "-", atom.right), bound)
        if apart is None or not isinstance(apart.constant, Number):
            return 2.0
        return 2.0 - 1.0 / (1.0 + abs(apart.constant.value))

    def _so(self, condition: Condition, numbers: Numbers) -> bool:
        key = condition, tuple(numbers[counter] for counter in condition.reads)
        if key not in self._answers:
            self._answers[key] = self._holds(condition, numbers)
        return self._answers[key]

    def _holds(self, condition: Condition, numbers: Numbers) -> bool:
        atom = condition.literal.atom if isinstance(condition.literal, Not) else condition.literal
        assert isinstance(atom, Comparison), "counters are compared"
        bound = self._bound(condition.reads, numbers)
        left, right = self._measured(atom.left, bound), self._measured(atom.right, bound)
        so = left is not None and right is not None and compare(left, atom.operator, right)
        return so is not isinstance(condition.literal, Not)

    def _measured(self, side: Term, bound: dict[str, Term]) -> MeasuredValue | None:
        found = measure(side, self._world.map, self._world.ontology, bound)
        if found is not None and isinstance(side, Variable):
            attribute = attribute_at(side.name.partition(".")[2], self._world.ontology)
            return MeasuredValue(found.constant, attribute.tolerance if attribute is not None else 0.0)
        return found

    def _value(self, setting: Setting, numbers: Numbers) -> float | None:
        measured = measure(setting.source, self._world.map, self._world.ontology, self._bound(setting.reads, numbers))
        attribute = self.attributes[setting.sets]
        if measured is None or not isinstance(measured.constant, Number) or attribute is None:
            return None
        value: float | None = measured.constant.value
        if measured.constant.unit is not None and attribute.unit is not None:
            value = convert_unit(measured.constant.value, measured.constant.unit, attribute.unit)
        low, high = attribute.minimum, attribute.maximum
        within = value is not None and (low is None or value >= low) and (high is None or value <= high)
        return value if within else None

    def _bound(self, reads: tuple[int, ...], numbers: Numbers) -> dict[str, Term]:
        found: dict[str, Term] = {}
        for counter in reads:
            value = numbers[counter]
            if value is not None:
                found[self.names[counter]] = Number(value, self.unit(counter))
        return found

    # Reading formulas

    def _condition(self, literal: Literal) -> Condition:
        reads: list[int] = []
        atom = literal.atom if isinstance(literal, Not) else literal
        assert isinstance(atom, Comparison), "counters are compared"
        hidden = Comparison(self._hidden(atom.left, reads), atom.operator, self._hidden(atom.right, reads))
        return Condition(Not(hidden) if isinstance(literal, Not) else hidden, tuple(reads))

    def _setting(self, target: Attribute, source: Term) -> Setting:
        reads: list[int] = []
        hidden = self._hidden(source, reads)
        return Setting(self._counter(target), hidden, tuple(reads))

    def _hidden(self, term: Term, reads: list[int]) -> Term:
        """The term with variables in place of counters, which are added to `reads`."""
        if isinstance(term, Arithmetic):
            return Arithmetic(self._hidden(term.left, reads), term.operator, self._hidden(term.right, reads))
        attribute = self._world.known.counter(term)
        if attribute is None:
            return term
        reads.append(self._counter(attribute))
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


def count(task: Task, counters: Counters, states: int) -> list[Move] | None:
    """The moves that reach the goal with all counters as they must be, or None if nothing does. Raises TooMany, when more than so
    many states were looked at.

    Greedy best-first; the estimate knows of facts only, and then how far the comparisons of the goal, and of what would lead there, are
    from being so.
    """
    goals = [move for move in task.moves if move.action.operator.service is None]
    estimate = Estimate(task)
    start = task.initial, counters.initial
    came: dict[tuple[State, Numbers], tuple[tuple[State, Numbers], Move] | None] = {start: None}
    open_: list[tuple[float, float, bool, int, tuple[State, Numbers]]] = [(0.0, 0.0, True, 0, start)]
    distances: dict[State, tuple[float | None, set[Move]]] = {}
    while open_:
        *_, node = heappop(open_)
        state, numbers = node
        if state not in distances:
            distances[state] = estimate.of(state)
        distance, helpful = distances[state]
        if distance is None:
            continue
        for move in task.moves:
            if not move.applicable(state) or not counters.allows(move, numbers):
                continue
            counted = counters.after(move, numbers)
            if counted is None:
                continue
            if move in goals:
                return _path(came, node)
            after = move.apply(state), counted
            if after not in came:
                came[after] = node, move
                hopeful = distances[after[0]][1] if after[0] in distances else set()
                gap = min(counters.gap(goal, counted) for goal in goals)
                gap += min((counters.gap(other, counted) for other in hopeful), default=0.0)
                heappush(open_, (distance, gap, move not in helpful, len(came), after))
        if len(came) > states:
            raise TooMany(f"{len(came)} states were looked at")
    return None


def _path(came: dict[tuple[State, Numbers], tuple[tuple[State, Numbers], Move] | None], node: tuple[State, Numbers]) -> list[Move]:
    moves: list[Move] = []
    while (step := came[node]) is not None:
        node, move = step
        moves.append(move)
    return moves[::-1]


def without_useless(moves: Sequence[Move], task: Task, counters: Counters) -> list[Move]:
    """The plan without single moves that it can do without."""
    kept = list(moves)
    for move in moves:
        rest = list(kept)
        rest.remove(move)
        if reaches(rest, task, counters):
            kept = rest
    return kept


def reaches(moves: Sequence[Move], task: Task, counters: Counters) -> bool:
    """Whether the moves can be done one after the other, and lead to the goal."""
    state, numbers = task.initial, counters.initial
    for move in moves:
        if not move.applicable(state) or not counters.allows(move, numbers):
            return False
        counted = counters.after(move, numbers)
        if counted is None:
            return False
        state, numbers = move.apply(state), counted
    goals = (move for move in task.moves if move.action.operator.service is None)
    return any(move.applicable(state) and counters.allows(move, numbers) for move in goals)
