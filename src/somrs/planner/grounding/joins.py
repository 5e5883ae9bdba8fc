"""Joins: the bindings of an operator's variables with which all its conditions hold, looked up in a growing set of facts."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from somrs.entish import Comparison, Name, Not, Relation, Truth, Variable
from somrs.entish.formula import Literal, variables
from somrs.ontology.services import PROVIDER
from somrs.planner.grounding.actions import argument_of
from somrs.planner.grounding.relevance import Demand
from somrs.planner.model.facts import Facts
from somrs.planner.model.operators import Operator, Test
from somrs.planner.model.vocabulary import KNOWN, Argument, Pattern
from somrs.planner.model.world import Binding, World

PLACES = 16
"""With `narrow`, the maximum number of objects to try for a variable that only a type restricts: objects that are in such a place now, and
others of their types."""
STANDING_LIMIT = 500
"""The maximum number of objects in an argument place to examine, to find those."""

EFFORT_BETWEEN_LOOKS = 10_000
"""The effort between two looks at the time: some hundredths of a second."""

Condition = Pattern | Literal | Test
"""A fact that services change, a static condition, or a comparison of values that services change."""


class TooLarge(Exception):
    """The problem exceeds a limit. There may or may not be a plan."""


class Joins:
    """Finds bindings. Its methods raise TooLarge when more than `effort` is spent: 1 for each fact that is matched with a condition, and
    for each set of conditions that is looked at."""

    def __init__(self, world: World, facts: Facts, *, narrow: bool, effort: int) -> None:
        self.world, self.facts, self.narrow = world, facts, narrow
        self.guessed = False
        """Whether a service has a number or text as input that the goal does not determine; such inputs are not tried."""
        self.limited = False
        """Whether objects were left out, because only likely ones are tried (`narrow`)."""
        self.effort = effort
        """The effort that is left."""
        self._next_look = effort - EFFORT_BETWEEN_LOOKS

    def spend(self, effort: int, operator: Operator) -> None:
        """Count effort. Raises TooLarge at the limit, and when the time for planning is over."""
        self.effort -= effort
        if self.effort < 0:
            raise TooLarge(f"there are too many ways to use services, {operator_name(operator)} among them")
        if self.effort < self._next_look:
            self._next_look = self.effort - EFFORT_BETWEEN_LOOKS
            if self.world.is_overdue():
                raise TooLarge(f"there are more ways to use services than could be listed in time, {operator_name(operator)} among them")

    def orders(self, predicate: str, arguments: tuple[Argument, ...]) -> tuple[tuple[Argument, ...], ...]:
        """The arguments in each order in which the fact can be stated."""
        return (arguments, arguments[::-1]) if self.world.vocabulary.is_symmetric(predicate) else (arguments,)

    def complete(self, demand: Demand, conditions: list[Condition], binding: Binding) -> Iterator[Binding]:
        """The bindings that meet the conditions; the condition with the fewest matches comes next."""
        self.spend(1, demand.operator)
        open_conditions: list[Condition] = []
        for condition in conditions:
            ready = self.ready(demand.operator, condition, binding)
            if ready is None:
                open_conditions.append(condition)
            elif not ready:
                return
        best: tuple[int, Pattern | Literal] | None = None
        for condition in open_conditions:
            if not isinstance(condition, Test):
                count = self.count(demand.operator, condition, binding)
                if count is not None and (best is None or count < best[0]):
                    best = count, condition
        if best is not None:
            rest = [condition for condition in open_conditions if condition is not best[1]]
            for arguments in self.possibilities(best[1], binding):
                matched = self.match(demand, best[1], arguments, binding)
                if matched is not None:
                    yield from self.complete(demand, rest, matched)
            return
        for condition in open_conditions:
            comparison = condition.comparison if isinstance(condition, Test) else condition
            if isinstance(comparison, Comparison) and self.defines(comparison, binding):
                for extended in self.world.find_bindings(comparison, binding):
                    yield from self.complete(demand, [c for c in open_conditions if c is not condition], extended)
                return
        name = next((name for name in demand.operator.variables if name not in binding), None)
        if name is None:
            if not open_conditions:
                yield binding
            return
        for value in self.domain(demand, name):
            yield from self.complete(demand, open_conditions, {**binding, name: value})

    def ready(self, operator: Operator, condition: Condition, binding: Binding) -> bool | None:
        """Whether the condition is met; None while its variables are not all bound."""
        match condition:
            case Test(comparison):
                return self.world.passes(condition, binding) if all(name in binding for name in variables(comparison)) else None
            case Not():
                # a variable after NOT that nothing else binds stands for any object
                has_unbound = any(name in operator.variables and name not in binding for name in variables(condition))
                return None if has_unbound else self.world.holds_statically(condition, binding)
            case Relation() | Comparison():
                return self.world.holds_statically(condition, binding) if all(name in binding for name in variables(condition)) else None
            case (predicate, arguments):
                known_arguments = [argument_of(argument, binding) for argument in arguments]
                if any(argument is None for argument in known_arguments):
                    return None
                fact = self.world.canonical((predicate, tuple(value for value in known_arguments if value is not None)))
                return fact in self.facts or self.world.is_settled(fact, operator)

    def _partial_fact(self, condition: Pattern | Literal, binding: Binding) -> tuple[str, list[Argument | None]] | None:
        """The predicate or relation, and its arguments as far as they are known; None for a comparison."""
        match condition:
            case Relation(relation, arguments):
                return relation, [argument.name if isinstance(argument, Name) else binding.get(argument.name) for argument in arguments]
            case (str(predicate), arguments):
                return predicate, [argument_of(argument, binding) for argument in arguments]
        return None

    def count(self, operator: Operator, condition: Pattern | Literal, binding: Binding) -> int | None:
        """An estimate of the number of matching facts; None for what is only tested: a comparison, that an object is known, or a choice
        that the map may settle."""
        partial_fact = self._partial_fact(condition, binding)
        if partial_fact is None:
            return None
        predicate, known_arguments = partial_fact
        if predicate == KNOWN or predicate in operator.static_ways:
            return None
        count = self.world.count if isinstance(condition, Relation) else self.facts.count
        backwards = count(predicate, known_arguments[::-1]) if self.world.vocabulary.is_symmetric(predicate) else 0
        return count(predicate, known_arguments) + backwards

    def possibilities(self, condition: Pattern | Literal, binding: Binding) -> list[tuple[Argument, ...]]:
        partial_fact = self._partial_fact(condition, binding)
        if partial_fact is None:
            return []
        predicate, known_arguments = partial_fact
        lookup = self.world.find_facts if isinstance(condition, Relation) else self.facts.find_facts
        if self.world.vocabulary.is_symmetric(predicate):
            return list(
                dict.fromkeys(
                    [*lookup(predicate, known_arguments), *(arguments[::-1] for arguments in lookup(predicate, known_arguments[::-1]))]
                )
            )
        return lookup(predicate, known_arguments)

    def match(self, demand: Demand, condition: Pattern | Literal, arguments: tuple[Argument, ...], binding: Binding) -> Binding | None:
        """The binding extended by matching the condition with a fact's arguments; None if they do not match. Raises TooLarge."""
        self.spend(1, demand.operator)
        pattern_terms = condition.arguments if isinstance(condition, Relation) else condition[1]  # type: ignore[index]
        if len(pattern_terms) != len(arguments):
            return None
        matched = dict(binding)
        for term, argument in zip(pattern_terms, arguments, strict=True):
            if isinstance(term, Variable):
                if term.name in matched:
                    if matched[term.name] != argument:
                        return None
                elif self._admits(demand, term.name, argument):
                    matched[term.name] = argument
                else:
                    return None
            elif (term.name if isinstance(term, Name) and isinstance(argument, str) else term) != argument:
                return None
        return matched

    def _admits(self, demand: Demand, name: str, value: Argument) -> bool:
        types = self._types(demand, name)
        return self.world.is_eligible(value, types)

    def _types(self, demand: Demand, name: str) -> frozenset[str]:
        types = demand.operator.types.get(name, frozenset())
        for variable, kinds in demand.kinds:
            if variable == name:
                return types | kinds
        return types

    def defines(self, comparison: Comparison, binding: Binding) -> bool:
        """Whether the comparison determines its only unbound variable: `?w = term`."""
        unbound = [name for name in variables(comparison) if name not in binding]
        sides = (comparison.left, comparison.right)
        return comparison.operator == "=" and len(unbound) == 1 and any(isinstance(s, Variable) and s.name == unbound[0] for s in sides)

    def domain(self, demand: Demand, name: str) -> list[Argument]:
        types = self._types(demand, name)
        if name in demand.operator.found_values:
            return self.world.favourable_values(demand.operator.found_values[name])
        if "truth" in types:
            return [Truth(True), Truth(False)]
        if types & {"number", "text"}:
            self.guessed = True
            return []  # the goal does not determine the value
        if not self.narrow or name == PROVIDER:
            return [*self.world.domain(types)]
        objects = self.world.map.objects
        usual = list(islice(self._usual(demand.operator, name, types), PLACES))
        kinds = {objects[place].type for place in usual}
        likely: dict[Argument, None] = dict.fromkeys(usual)
        alike = (place for kind in kinds for place in self.world.map.of_type(kind) if self.world.is_eligible(place, types))
        likely.update(dict.fromkeys(islice(alike if kinds else self.world.domain(types), PLACES)))
        tried = list(likely)[:PLACES]
        self.limited = self.limited or any(object not in tried for object in self.world.domain(types))
        return tried

    def _usual(self, operator: Operator, name: str, types: frozenset[str]) -> Iterator[str]:
        """The objects that now have the variable's argument place in facts of the predicates that the operator adds: the usual places."""
        for predicate, terms in operator.add_effects:
            for place, term in enumerate(terms):
                if isinstance(term, Variable) and term.name == name and not predicate.startswith("."):
                    standing = islice(self.world.map.objects_at(predicate, place), STANDING_LIMIT)
                    yield from (
                        object_name
                        for object_name in standing
                        if object_name in self.world.map.objects and self.world.is_eligible(object_name, types)
                    )


def operator_name(operator: Operator) -> str:
    return operator.service.name if operator.service is not None else "the task's goal"
