"""The relaxed exploration of a task that is not grounded: which facts can become true if none becomes false, cheapest first, and how.

It is a generalised Dijkstra search over Horn rules with the costs of the additive heuristic (Corrêa, Francès, Pommerening, Helmert 2021),
evaluated semi-naively: a new fact is joined with the facts before it. A variable that no later condition and no effect needs is projected
away (Helmert 2009), so a service that moves a robot from any place to any place takes one step for each place, not for each pair.

Only one way to make each fact true is kept, so an exploration is not a grounding: it guides `search/lookahead.py`, and proves nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count

from somrs.entish import Comparison, Variable
from somrs.entish.formula import variables
from somrs.planner.grounding.actions import Action, added_facts, argument_of, make_action
from somrs.planner.grounding.joins import Condition, Joins
from somrs.planner.grounding.relevance import Demand
from somrs.planner.model.facts import Facts
from somrs.planner.model.operators import Test
from somrs.planner.model.vocabulary import GOAL, Argument, Fact, Pattern
from somrs.planner.model.world import Binding, World

EFFORT = 300_000
"""The maximum number of facts to match with conditions: about a second."""


@dataclass(frozen=True, slots=True, eq=False)
class Rule:
    """A demand with its conditions, the variables that each of them has, and those of its effects that have the same variables."""

    demand: Demand
    conditions: tuple[Condition, ...]
    variables: tuple[frozenset[str], ...]
    effects: tuple[Pattern, ...]
    effect_variables: frozenset[str]


class Exploration:
    """The cheapest ways to reach facts, up to the target. The constructor raises TooLarge."""

    def __init__(
        self, world: World, demanded: Iterable[Demand], known: Iterable[Fact] = (), target: Fact = GOAL, effort: int = EFFORT
    ) -> None:
        """`known` are facts that hold besides those of the map."""
        self.world = world
        self.facts = Facts(world)
        self.joins = Joins(world, self.facts, narrow=False, effort=effort)
        self.achievers: dict[Fact, Action] = {}
        """The action that makes each reached fact true that does not hold now."""
        self._costs: dict[Fact, float] = {}
        self._waiting: list[tuple[float, int, Fact, Action]] = []
        self._arrivals = count()
        """Orders what costs the same: values have no order."""
        self._seen: set[tuple[object, ...]] = set()
        self._choices: dict[tuple[int, tuple[int, ...]], int | None] = {}
        self._needed: dict[tuple[int, tuple[int, ...]], tuple[str, ...]] = {}
        for fact in known:
            self.facts.add(fact)
        self._run([rule for demand in demanded for rule in _rules(demand)], target)

    def cost(self, fact: Fact) -> float:
        """The cost of a reached fact; 0 if it holds now."""
        return self._costs.get(fact, 0.0)

    def _run(self, rules: list[Rule], target: Fact) -> None:
        triggers: dict[tuple[str, int, Argument], list[tuple[Rule, Binding, int]]] = {}
        for rule in rules:
            binding = dict(rule.demand.values)
            for index, condition in enumerate(rule.conditions):
                if index < len(rule.demand.operator.preconditions):
                    predicate, pattern_terms = condition  # type: ignore[misc]  # preconditions are patterns
                    known_arguments = [argument_of(term, binding) for term in pattern_terms]
                    place = next((place for place, value in enumerate(known_arguments) if value is not None), -1)
                    key = predicate, place, (known_arguments[place] or "") if place >= 0 else ""
                    triggers.setdefault(key, []).append((rule, binding, index))
            self._complete(rule, tuple(range(len(rule.conditions))), binding)
        while self._waiting:
            cost, _, fact, action = heappop(self._waiting)
            if not self.facts.add(fact):
                continue
            self._costs[fact], self.achievers[fact] = cost, action
            if fact == target:
                return
            for arguments in self.joins.orders(*fact):
                for place, value in ((-1, ""), *enumerate(arguments)):
                    for rule, binding, index in triggers.get((fact[0], place, value), ()):
                        pattern: Pattern = rule.conditions[index]  # type: ignore[assignment]
                        matched = self.joins.match(rule.demand, pattern, arguments, binding)
                        if matched is not None:
                            self._complete(rule, tuple(n for n in range(len(rule.conditions)) if n != index), matched)

    def _complete(self, rule: Rule, remaining: tuple[int, ...], binding: Binding) -> None:
        """Apply the rule with every binding that meets the remaining conditions, once for each choice of the variables that matter."""
        open_indexes: list[int] = []
        for index in remaining:
            ready = self.joins.ready(rule.demand.operator, rule.conditions[index], binding)
            if ready is None:
                open_indexes.append(index)
            elif not ready:
                return
        remaining = tuple(open_indexes)
        key = id(rule), remaining
        if key not in self._needed:
            self._needed[key] = tuple(sorted(rule.effect_variables.union(*(rule.variables[index] for index in remaining))))
        seen_key = (*key, *(binding.get(name) for name in self._needed[key]))
        if seen_key in self._seen:
            return
        self._seen.add(seen_key)
        if remaining and self._is_reached(rule, binding):
            return
        if key not in self._choices:
            self._choices[key] = self._choose(rule, remaining, binding)
        choice = self._choices[key]
        if choice is not None:
            condition = rule.conditions[choice]
            rest = tuple(n for n in remaining if n != choice)
            for arguments in self.joins.possibilities(condition, binding):  # type: ignore[arg-type]  # a pattern or a relation
                matched = self.joins.match(rule.demand, condition, arguments, binding)  # type: ignore[arg-type]
                if matched is not None:
                    self._complete(rule, rest, matched)
        else:
            self._enumerate(rule, remaining, binding)

    def _is_reached(self, rule: Rule, binding: Binding) -> bool:
        """Whether all effects of the rule are reached, with this binding. They were reached at no higher cost, because the cheapest facts
        are joined first: of all places where a van can unload a parcel that lies there, the first is enough."""
        for predicate, pattern_terms in rule.effects:
            if predicate.startswith("."):
                return False  # its value is calculated
            arguments = tuple(value for term in pattern_terms if (value := argument_of(term, binding)) is not None)
            if len(arguments) < len(pattern_terms) or self.world.canonical((predicate, arguments)) not in self.facts:
                return False
        return True

    def _choose(self, rule: Rule, remaining: tuple[int, ...], binding: Binding) -> int | None:
        """The condition with the fewest matches; None if only comparisons remain."""
        counts = {
            index: count
            for index in remaining
            if not isinstance(condition := rule.conditions[index], Test)
            and (count := self.joins.count(rule.demand.operator, condition, binding)) is not None
        }
        return min(counts, key=lambda index: counts[index], default=None)

    def _enumerate(self, rule: Rule, remaining: tuple[int, ...], binding: Binding) -> None:
        """Bind a variable that only a comparison or its type restricts. If nothing depends on its value, any value will do."""
        demand = rule.demand
        for index in remaining:
            condition = rule.conditions[index]
            if isinstance(condition, Comparison) and self.joins.defines(condition, binding):
                for extended in self.world.find_bindings(condition, binding):
                    self._complete(rule, tuple(n for n in remaining if n != index), extended)
                return
        needed = rule.effect_variables.union(*(rule.variables[index] for index in remaining))
        unbound = [name for name in demand.operator.variables if name not in binding]
        if not remaining:
            for name in unbound:
                if name not in needed:
                    value = next(iter(self.joins.domain(demand, name)), None)
                    if value is None:
                        return
                    binding = {**binding, name: value}
        open_name = next((name for name in unbound if name in needed), None)
        if open_name is not None:
            for value in self.joins.domain(demand, open_name):
                self._complete(rule, remaining, {**binding, open_name: value})
        elif not remaining:
            self._apply(rule, binding)

    def _apply(self, rule: Rule, binding: Binding) -> None:
        operator = rule.demand.operator
        action = make_action(operator, binding, self.world)
        if action is None:
            return
        cost = self.world.cost(operator.service, binding) + sum(map(self.cost, action.preconditions))
        for fact in added_facts(action, self.world):
            if fact not in self.facts and cost < self._costs.get(fact, float("inf")):
                self._costs[fact] = cost
                heappush(self._waiting, (cost, next(self._arrivals), fact, action))


def _rules(demand: Demand) -> Iterator[Rule]:
    """A rule for the effects that have the same variables, so that a rule projects away the variables of other effects: how much space a
    van has left does not matter to where its parcels are."""
    operator = demand.operator
    conditions: tuple[Condition, ...] = (*dict.fromkeys(operator.preconditions), *operator.static_conditions, *operator.tests)
    condition_variables = tuple(frozenset(_variables(condition)) for condition in conditions)
    groups: dict[frozenset[str], list[Pattern]] = {}
    for pattern in operator.add_effects:
        groups.setdefault(frozenset(pattern_variables(pattern)), []).append(pattern)
    for effect_variables, effects in groups.items():
        yield Rule(demand, conditions, condition_variables, tuple(effects), effect_variables)


def _variables(condition: Condition) -> Iterator[str]:
    if isinstance(condition, Test):
        yield from variables(condition.comparison)
    elif isinstance(condition, tuple):
        yield from pattern_variables(condition)
    else:
        yield from variables(condition)


def pattern_variables(pattern: Pattern) -> Iterator[str]:
    for term in pattern[1]:
        if isinstance(term, Variable):
            yield term.name
        elif not isinstance(term, str):
            yield from variables(term)
