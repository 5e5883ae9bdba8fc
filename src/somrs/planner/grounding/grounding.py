"""From operators to actions: the facts and actions that are reachable in the delete relaxation, where no fact becomes false.

Grounding evaluates static conditions on the map; the conditions of the actions depend only on what services change.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice

from somrs.entish import Attribute, Comparison, Name, Not, Number, Relation, Term, Text, Truth, Variable
from somrs.entish.formula import Constant, Literal, substitute, substitute_term, variables
from somrs.ontology.services import PROVIDER, ServiceKind
from somrs.ontology.types import AttributeType, Kind
from somrs.ontology.units import convert_unit
from somrs.ontology.values import attribute_at, constant, measure
from somrs.planner.grounding.relevance import Demand
from somrs.planner.model.facts import Facts
from somrs.planner.model.operators import EXISTS_SUFFIX, GOAL, KNOWN, Argument, Fact, NegativePrecondition, Operator, Pattern, Test
from somrs.planner.model.world import Binding, World, as_term

ACTIONS = 100_000
"""The maximum number of actions."""
EFFORT = 10_000_000
"""The default maximum number of facts to match with conditions: about ten seconds."""
PLACES = 16
"""With `narrow`, the maximum number of objects to try for a variable that only a type restricts: objects that are in such a place now, and
others of their types."""
STANDING_LIMIT = 500
"""The maximum number of objects in an argument place to examine, to find those."""


@dataclass(frozen=True, slots=True, eq=False)
class Action:
    """An operator with all its variables bound."""

    operator: Operator
    binding: Binding
    preconditions: tuple[Fact, ...]
    add_effects: tuple[Fact, ...]
    delete_effects: tuple[Fact, ...]
    numeric_conditions: tuple[Literal, ...] = ()
    numeric_effects: tuple[tuple[Attribute, Term], ...] = ()

    @property
    def provider(self) -> str | None:
        """The device that has to execute the action, if the service type's formulas use `?Provider`."""
        provider = self.binding.get(PROVIDER)
        return provider if isinstance(provider, str) else None


class TooLarge(Exception):
    """The problem exceeds a limit. There may or may not be a plan."""


class Grounding:
    """The actions that are demanded and reachable, and the facts that they add. The constructor raises TooLarge."""

    def __init__(
        self, world: World, demanded: list[Demand], *, narrow: bool = False, effort: int = EFFORT, max_actions: int | None = None
    ) -> None:
        self.world = world
        self.narrow = narrow
        self.guessed = False
        """Whether a service has a number or text as input that the goal does not determine; such inputs are not tried."""
        self._effort = effort
        self._max_actions = ACTIONS if max_actions is None else max_actions
        self.facts = Facts(world)
        self.actions: list[Action] = []
        self._action_keys: set[tuple[Operator, tuple[Argument, ...]]] = set()
        self._waiting: list[Fact] = []
        self._run(demanded)

    @property
    def is_goal_reachable(self) -> bool:
        return GOAL in self.facts.new

    def _run(self, demanded: list[Demand]) -> None:
        # The preconditions that a fact may meet, by its predicate and the place and value of a known argument; place -1 if none is known.
        demands_by_precondition: dict[tuple[str, int, Argument], list[tuple[Demand, Binding, Pattern]]] = {}
        for demand in demanded:
            binding = dict(demand.values)
            for precondition in dict.fromkeys(demand.operator.preconditions):
                known_arguments = [self._argument(term, binding) for term in precondition[1]]
                place = next((place for place, argument in enumerate(known_arguments) if argument is not None), -1)
                demands_by_precondition.setdefault((precondition[0], place, known_arguments[place] or "" if place >= 0 else ""), []).append(
                    (demand, binding, precondition)
                )
            self._extend(demand, binding, None)
        while self._waiting:
            fact = self._waiting.pop()
            if not self.facts.add(fact):
                continue
            for arguments in self._orders(*fact):
                for place, argument in ((-1, ""), *enumerate(arguments)):
                    for demand, binding, precondition in demands_by_precondition.get((fact[0], place, argument), ()):
                        matched = self._match(demand, precondition, arguments, binding)
                        if matched is not None:
                            self._extend(demand, matched, precondition)

    def _orders(self, predicate: str, arguments: tuple[Argument, ...]) -> tuple[tuple[Argument, ...], ...]:
        return (arguments, arguments[::-1]) if self.world.vocabulary.is_symmetric(predicate) else (arguments,)

    def _extend(self, demand: Demand, binding: Binding, met_precondition: Pattern | None) -> None:
        operator = demand.operator
        conditions: list[Pattern | Literal | Test] = [
            precondition for precondition in operator.preconditions if precondition != met_precondition
        ]
        conditions += [*operator.static_conditions, *operator.tests]
        for complete in self._complete(demand, conditions, binding):
            self._add(operator, complete)

    def _complete(self, demand: Demand, conditions: list[Pattern | Literal | Test], binding: Binding) -> Iterator[Binding]:
        """The bindings that meet the conditions; the condition with the fewest matches comes next."""
        open_conditions: list[Pattern | Literal | Test] = []
        for condition in conditions:
            ready = self._ready(demand.operator, condition, binding)
            if ready is None:
                open_conditions.append(condition)
            elif not ready:
                return
        best: tuple[int, Pattern | Literal] | None = None
        for condition in open_conditions:
            if not isinstance(condition, Test):
                count = self._count(condition, binding)
                if count is not None and (best is None or count < best[0]):
                    best = count, condition
        if best is not None:
            rest = [condition for condition in open_conditions if condition is not best[1]]
            for arguments in self._possibilities(best[1], binding):
                matched = self._match(demand, best[1], arguments, binding)
                if matched is not None:
                    yield from self._complete(demand, rest, matched)
            return
        for condition in open_conditions:
            if isinstance(condition, Comparison) and self._defines(condition, binding):
                for extended in self.world.find_bindings(condition, binding):
                    yield from self._complete(demand, [c for c in open_conditions if c is not condition], extended)
                return
        name = next((name for name in demand.operator.variables if name not in binding), None)
        if name is None:
            if not open_conditions:
                yield binding
            return
        for value in self._domain(demand, name):
            yield from self._complete(demand, open_conditions, {**binding, name: value})

    def _ready(self, operator: Operator, condition: Pattern | Literal | Test, binding: Binding) -> bool | None:
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
                known_arguments = [self._argument(argument, binding) for argument in arguments]
                if any(argument is None for argument in known_arguments):
                    return None
                return self.world.canonical((predicate, tuple(value for value in known_arguments if value is not None))) in self.facts

    def _argument(self, term: Argument | Term, binding: Binding) -> Argument | None:
        if isinstance(term, Variable):
            return binding.get(term.name)
        assert isinstance(term, str | Name | Number | Text | Truth)
        return term

    def _partial_fact(self, condition: Pattern | Literal, binding: Binding) -> tuple[str, list[Argument | None]] | None:
        """The predicate or relation, and its arguments as far as they are known; None for a comparison."""
        match condition:
            case Relation(relation, arguments):
                return relation, [argument.name if isinstance(argument, Name) else binding.get(argument.name) for argument in arguments]
            case (str(predicate), arguments):
                return predicate, [self._argument(argument, binding) for argument in arguments]
        return None

    def _count(self, condition: Pattern | Literal, binding: Binding) -> int | None:
        """An estimate of the number of matching facts; None for what is only tested: a comparison, or that an object is known."""
        partial_fact = self._partial_fact(condition, binding)
        if partial_fact is None:
            return None
        predicate, known_arguments = partial_fact
        if predicate == KNOWN:
            return None
        count = self.world.count if isinstance(condition, Relation) else self.facts.count
        backwards = count(predicate, known_arguments[::-1]) if self.world.vocabulary.is_symmetric(predicate) else 0
        return count(predicate, known_arguments) + backwards

    def _possibilities(self, condition: Pattern | Literal, binding: Binding) -> list[tuple[Argument, ...]]:
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

    def _match(self, demand: Demand, condition: Pattern | Literal, arguments: tuple[Argument, ...], binding: Binding) -> Binding | None:
        """The binding extended by matching the condition with a fact's arguments; None if they do not match. Raises TooLarge."""
        self._effort -= 1
        if self._effort < 0:
            raise TooLarge(f"there are too many ways to use services, {_operator_name(demand.operator)} among them")
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

    def _defines(self, comparison: Comparison, binding: Binding) -> bool:
        """Whether the comparison determines its only unbound variable: `?w = term`."""
        unbound = [name for name in variables(comparison) if name not in binding]
        sides = (comparison.left, comparison.right)
        return comparison.operator == "=" and len(unbound) == 1 and any(isinstance(s, Variable) and s.name == unbound[0] for s in sides)

    def _domain(self, demand: Demand, name: str) -> list[Argument]:
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
        return list(likely)[:PLACES]

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

    # Actions

    def _add(self, operator: Operator, binding: Binding) -> None:
        key = operator, tuple(binding[name] for name in operator.variables)
        if key in self._action_keys:
            return
        self._action_keys.add(key)
        add_effects = [self._effect(pattern, binding) for pattern in operator.add_effects]
        if any(fact is None for fact in add_effects):
            return
        if operator.tells and operator.service is not None:
            if operator.service.kind is not ServiceKind.PHYSICAL:
                add_effects = [fact for fact in add_effects if fact is not None and self.world.is_open(fact)]
            if not add_effects or self.world.is_fruitless(operator.service, binding):
                return
        self.actions.append(action := self._action(operator, binding, [fact for fact in add_effects if fact is not None]))
        if len(self.actions) > self._max_actions:
            raise TooLarge(f"there are more than {self._max_actions} ways to use services, the last one of them {_operator_name(operator)}")
        for predicate, arguments in action.add_effects:
            self._waiting.append((predicate, arguments))
            if predicate in self.world.ontology.relations:
                self._waiting.append((predicate + EXISTS_SUFFIX, arguments[:1]))

    def _action(self, operator: Operator, binding: Binding, add_effects: list[Fact]) -> Action:
        def ground(pattern: Pattern) -> Fact:
            arguments = tuple(argument for term in pattern[1] if (argument := self._argument(term, binding)) is not None)
            return self.world.canonical((pattern[0], arguments))

        preconditions = tuple(dict.fromkeys(map(ground, operator.preconditions)))
        substitution = (
            {name: as_term(value) for name, value in binding.items()} if operator.numeric_conditions or operator.numeric_effects else {}
        )
        numeric_conditions = tuple(substitute(literal, substitution) for literal in operator.numeric_conditions)
        numeric_effects = tuple(
            (substitute_term(target, substitution), substitute_term(source, substitution)) for target, source in operator.numeric_effects
        )
        return Action(
            operator,
            binding,
            preconditions,
            tuple(dict.fromkeys(add_effects)),
            tuple(map(ground, operator.delete_effects)),
            numeric_conditions,  # type: ignore[arg-type]
            numeric_effects,  # type: ignore[arg-type]
        )

    def _effect(self, pattern: Pattern, binding: Binding) -> Fact | None:
        """The fact that the effect adds; None for an invalid fact (an object in a place relation to itself, an undefined value)."""
        predicate, terms = pattern
        if predicate.startswith("."):
            owner = self._argument(terms[0], binding)
            attribute = attribute_at(predicate[1:], self.world.ontology)
            value = self._value(terms[1], attribute, binding)
            fits = isinstance(owner, str) and value is not None and self.world.has_attribute(owner, predicate[1:])
            return (predicate, (owner, value)) if fits and owner is not None and value is not None else None
        arguments = tuple(argument for term in terms if (argument := self._argument(term, binding)) is not None)
        if predicate not in self.world.ontology.relations:
            return predicate, arguments
        if any(argument not in self.world.map.objects for argument in arguments):
            return None
        if len(set(arguments)) < len(arguments) and not self._with_itself(predicate):
            return None
        return self.world.canonical((predicate, arguments))

    def _with_itself(self, predicate: str) -> bool:
        """Whether an object may have the relation to itself: not in functional, symmetric or exclusive relations, such as places."""
        relation = self.world.ontology.relations.get(predicate)
        return relation is not None and not (relation.functional or relation.symmetric or relation.excludes)

    def _value(self, term: Argument | Term, attribute: AttributeType | None, binding: Binding) -> Constant | None:
        """The new value of the attribute, in the attribute's unit; None if it is undefined or out of range."""
        terms: Mapping[str, Term] = {name: as_term(value) for name, value in binding.items()}
        measured = measure(term, self.world.map, self.world.ontology, terms) if not isinstance(term, str) else None
        if measured is None or attribute is None:
            return None
        match attribute.kind, measured.constant:
            case Kind.NUMBER, Number(value, unit):
                number = value if unit is None or attribute.unit is None else convert_unit(value, unit, attribute.unit)
                is_in_range = number is not None and _at_least(number, attribute.minimum) and _at_least(attribute.maximum, number)
                return constant(number, attribute) if number is not None and is_in_range else None
            case Kind.TRUTH, Truth() as truth:
                return truth
            case Kind.TEXT, Text() as text:
                return text
            case Kind.ENUMERATION, (Name(word) | Text(word)):
                return Name(word) if not attribute.values or word in attribute.values else None
        return None

    def forbidden_facts(self, action: Action) -> list[Fact]:
        """The reachable facts that must not hold when the action starts."""
        return [fact for forbidden in action.operator.negative_preconditions for fact in self._forbidden_by(forbidden, action)]

    def _forbidden_by(self, forbidden: NegativePrecondition, action: Action) -> Iterator[Fact]:
        predicate, terms = forbidden.pattern
        hidden = forbidden.test.hidden if forbidden.test is not None else {}
        for arguments in self._possibilities(forbidden.pattern, action.binding):
            matched: Binding = dict(action.binding)
            for term, argument in zip(terms, arguments, strict=True):
                if isinstance(term, Variable):
                    if matched.setdefault(term.name, argument) != argument:
                        break
                    types = action.operator.types.get(term.name, frozenset())
                    if term.name not in hidden and not self.world.has_types(argument, types):
                        break
                elif term != argument:
                    break
            else:
                if forbidden.test is None or self.world.passes(forbidden.test, matched):
                    yield self.world.canonical((predicate, arguments))


def _operator_name(operator: Operator) -> str:
    return operator.service.name if operator.service is not None else "the task's goal"


def _at_least(number: float | None, least: float | None) -> bool:
    return number is None or least is None or number >= least
