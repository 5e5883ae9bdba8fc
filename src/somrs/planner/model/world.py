"""The map as the planner queries it: types of objects, facts that hold now, and static conditions, which no service changes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy

from somrs.entish import Formula, Name, Number, Term, Text, Truth, Variable
from somrs.entish.formula import Constant, Literal, substitute, variables
from somrs.entish.parse import parse, parse_term
from somrs.ontology.map import Map
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.truth import bindings
from somrs.ontology.types import ROOT, UNKNOWN, Ontology
from somrs.ontology.values import MeasuredValue, attribute_at, compare, constant, measure, value_of
from somrs.planner.model.favourable_values import favourable_values
from somrs.planner.model.operators import Operator, Test
from somrs.planner.model.plan import describe_use
from somrs.planner.model.problem import Problem
from somrs.planner.model.repertoire import repertoire
from somrs.planner.model.vocabulary import EXISTS_SUFFIX, KNOWN, Argument, Fact, providers_of

Binding = dict[str, Argument]
"""The values of variables, by name."""
VALUES: Mapping[str, tuple[type, ...]] = {"number": (Number,), "text": (Text, Name), "truth": (Truth,)}
"""The constants that an input of a value type admits."""


class World:
    """The map and ontology of one problem, with caches of query results."""

    def __init__(self, problem: Problem, counting: bool = False, is_overdue: Callable[[], bool] = lambda: False) -> None:
        """`is_overdue`: whether the time for planning is over."""
        self.map: Map = problem.map
        self.ontology: Ontology = problem.ontology
        self.reading = problem.reading
        self._goal = problem.goal
        self._service_types = tuple(available.service_type for available in problem.services)
        self.repertoire = repertoire(problem.ontology, self._service_types, counting, problem.reading)
        self.vocabulary = self.repertoire.vocabulary
        self.is_overdue = is_overdue
        self.excluded, self.hurry, self.fruitless = problem.excluded, problem.hurry, problem.fruitless
        self._set_providers(
            {
                available.service_type.name: tuple(name for name in available.providers if name not in problem.excluded)
                for available in problem.services
            }
        )
        self._prices = {available.service_type.name: dict(available.prices) for available in problem.services}
        self._has_service_costs = any(available.service_type.cost is not None for available in problem.services)
        all_prices = [price for quotes in self._prices.values() for price in quotes.values()]
        self._average_price = sum(all_prices) / len(all_prices) if all_prices else 1.0
        self._subtype_cache: dict[tuple[str, str], bool] = {}
        self._settled: dict[tuple[Literal, tuple[tuple[str, Argument], ...]], bool] = {}
        self._narrowest: dict[frozenset[str], frozenset[str]] = {}
        self._domains: dict[frozenset[str], bool] = {}
        self._paths: dict[str, frozenset[str]] = {}
        self._favourable_values: dict[str, list[Argument]] = {}
        self._match_cache: dict[tuple[str, int, Argument] | str, list[tuple[Argument, ...]]] = {}

    def _set_providers(self, providers: Mapping[str, tuple[str, ...]]) -> None:
        self.providers = providers
        """The devices that offer each service type, without excluded ones."""
        self._providers_by_type = {providers_of(name): frozenset(device_names) for name, device_names in providers.items()}

    def at(self, map: Map) -> World:
        """The same world with a later map. Static conditions stay as they are, and what is known of them is kept."""
        later = copy(self)
        later.map, later._match_cache, later._domains = map, {}, {}
        return later

    def without(self, devices: Iterable[str]) -> World:
        """The same world, in which no step may involve the devices."""
        smaller = copy(self)
        smaller._narrowest, smaller._domains = {}, {}
        smaller.excluded = self.excluded.union(devices)
        smaller._set_providers(
            {name: tuple(n for n in device_names if n not in smaller.excluded) for name, device_names in self.providers.items()}
        )
        return smaller

    @property
    def has_varying_costs(self) -> bool:
        """Whether the known costs of services differ."""
        return self._has_service_costs or len({price for quotes in self._prices.values() for price in quotes.values()}) > 1

    def cost(self, service: ServiceType | None, binding: Binding) -> float:
        """The estimated cost of a use of the service in euros, before a service quotes a price.

        In this order: the cost term of the service type; the latest price of the provider, or the lowest if there is no provider; the
        average of all known prices.
        """
        if service is None:
            return 0.0
        if service.cost is not None:
            terms = {name: as_term(value) for name, value in binding.items()}
            measured = measure(parse_term(service.cost), self.map, self.ontology, terms)
            if measured is not None and isinstance(measured.constant, Number):
                return max(0.0, measured.constant.value)
        quotes, provider = self._prices[service.name], binding.get(PROVIDER)
        if isinstance(provider, str) and provider in quotes:
            return quotes[provider]
        return min(quotes.values(), default=self._average_price)

    def is_eligible(self, argument: Argument, types: Iterable[str]) -> bool:
        """Whether an object or value is not excluded and is of all the types."""
        return argument not in self.excluded and self.has_types(argument, types)

    def has_types(self, argument: Argument, types: Iterable[str]) -> bool:
        """Whether an object or value is of all the types, excluded or not."""
        if isinstance(argument, str):
            object = self.map.objects.get(argument)
            for type_name in types:
                if type_name in self._providers_by_type:
                    if argument not in self._providers_by_type[type_name]:
                        return False
                elif object is None or not self._type_is_a(object.type, type_name):
                    return False
            return True
        return all(isinstance(argument, VALUES.get(type_name, ())) for type_name in types)

    def is_subtype(self, type_name: str, supertype: str) -> bool:
        """Whether `type_name` is a subtype of `supertype`. Either may be the devices that offer a service (`providers_of`)."""
        if supertype in self._providers_by_type:
            return type_name in self._providers_by_type and self._providers_by_type[type_name] <= self._providers_by_type[supertype]
        return type_name not in self._providers_by_type and self._type_is_a(type_name, supertype)

    def _type_is_a(self, type_name: str, ancestor: str) -> bool:
        key = type_name, ancestor
        if key not in self._subtype_cache:
            self._subtype_cache[key] = self.ontology.is_subtype(type_name, ancestor)
        return self._subtype_cache[key]

    def narrowest(self, types: frozenset[str]) -> frozenset[str]:
        """The types without those that follow from others: an object that is a carbon atom is an atom."""
        if types not in self._narrowest:
            narrowest: list[str] = []
            for name in sorted(types):
                if not any(self.is_subtype(kept_name, name) for kept_name in narrowest):
                    narrowest = [kept_name for kept_name in narrowest if not self.is_subtype(name, kept_name)] + [name]
            self._narrowest[types] = frozenset(narrowest)
        return self._narrowest[types]

    def has_domain(self, types: frozenset[str]) -> bool:
        """Whether there are eligible objects that are of all the types, or values."""
        if types not in self._domains:
            self._domains[types] = not types.isdisjoint(VALUES) or next(self.domain(types), None) is not None
        return self._domains[types]

    def has_attribute(self, name: str, path: str) -> bool:
        """Whether the object's type has the attribute."""
        object = self.map.objects.get(name)
        if object is None:
            return False
        if object.type not in self._paths:
            self._paths[object.type] = frozenset(self.ontology.attributes_of(object.type))
        return path in self._paths[object.type]

    def domain(self, types: frozenset[str]) -> Iterator[str]:
        """The eligible objects that are of all the types."""
        for type_name in types:
            if type_name in self._providers_by_type:
                candidates: Iterable[str] = next(
                    device_names for name, device_names in self.providers.items() if providers_of(name) == type_name
                )
                break
        else:
            narrowest = max(types, key=lambda name: len(self.ontology.ancestors(name)), default=ROOT)
            candidates = (name for subtype in self.ontology.subtypes(narrowest) for name in self.map.of_type(subtype))
        return (name for name in candidates if self.is_eligible(name, types))

    # Changing facts that hold now

    def fact_holds(self, fact: Fact) -> bool:
        """Whether the fact holds now."""
        predicate, arguments = fact
        if predicate.startswith("."):
            return self.value(arguments[0], predicate[1:]) == arguments[1]
        names = self._names(arguments)
        if predicate == KNOWN:
            return self.reading is None or names[0] not in self.reading.unknown_objects
        if predicate.endswith(EXISTS_SUFFIX):
            return bool(self.map.facts_with(predicate.removesuffix(EXISTS_SUFFIX), 0, names[0]))
        return self.map.has_fact(predicate, names) or (
            self.vocabulary.is_symmetric(predicate) and self.map.has_fact(predicate, names[::-1])
        )

    def count(self, predicate: str, known_arguments: Sequence[Argument | None]) -> int:
        """An upper bound of the number of facts that `find_facts` returns."""
        if predicate == KNOWN:
            return len(self.map.objects)
        if predicate.startswith("."):
            return (
                1
                if known_arguments[0] is not None
                else len(self.map.objects)
                if known_arguments[1] is None
                else len(self.find_facts(predicate, known_arguments))
            )
        relation = predicate.removesuffix(EXISTS_SUFFIX)
        places = (0, 1) if self.vocabulary.is_symmetric(relation) else None
        return min(
            (
                sum(len(self.map.facts_with(relation, p, value)) for p in places or (place,))
                for place, value in enumerate(known_arguments)
                if isinstance(value, str)
            ),
            default=self.map.count(relation),
        )

    def find_facts(self, predicate: str, known_arguments: Sequence[Argument | None]) -> list[tuple[Argument, ...]]:
        """The arguments of facts that hold now and may have the known arguments (None: unknown). Only one of the known arguments is
        compared; the caller compares the rest."""
        places = [place for place, value in enumerate(known_arguments) if value is not None]
        place = min(places, key=lambda place: self._count_matches(predicate, place, known_arguments[place]), default=None)
        key = (predicate, place, known_arguments[place]) if place is not None else predicate
        if key not in self._match_cache:
            self._match_cache[key] = list(self._scan_facts(predicate, place, known_arguments[place] if place is not None else None))  # type: ignore[index]
        return self._match_cache[key]  # type: ignore[index]

    def _count_matches(self, predicate: str, place: int, value: Argument | None) -> int:
        """The number of facts with the value at the place, to choose the most selective argument."""
        if predicate.startswith("."):
            return place
        return len(self.map.facts_with(predicate.removesuffix(EXISTS_SUFFIX), place, value)) if isinstance(value, str) else 0

    def _scan_facts(self, predicate: str, place: int | None, value: Argument | None) -> Iterator[tuple[Argument, ...]]:
        if predicate == KNOWN:
            yield from ((name,) for name in self.map.objects if value in (None, name) and self.fact_holds((KNOWN, (name,))))
            return
        if predicate.startswith("."):
            for name in self._owners(predicate[1:], place, value):
                if (current_value := self.value(name, predicate[1:])) is not None:
                    yield name, current_value
            return
        relation = predicate.removesuffix(EXISTS_SUFFIX)
        if place is None:
            tuples: Iterable[tuple[str, ...]] = (fact.arguments for fact in self.map.facts(relation))
        else:
            name = value if isinstance(value, str) else ""
            places = (place, 1 - place) if self.vocabulary.is_symmetric(relation) else (place,)
            tuples = (arguments for place in places for arguments in self.map.facts_with(relation, place, name))
        if predicate.endswith(EXISTS_SUFFIX):
            yield from dict.fromkeys(arguments[:1] for arguments in tuples)
        elif self.vocabulary.is_symmetric(relation):
            distinct_tuples = dict.fromkeys(self.canonical((relation, arguments))[1] for arguments in tuples)
            yield from (arguments for arguments in distinct_tuples if place is None or arguments[place] == value)
        else:
            yield from tuples

    def _owners(self, path: str, place: int | None, value: Argument | None) -> Iterable[str]:
        """The objects whose attribute may have the value, explicitly or by the default of their type."""
        if place is None:
            return self.map.objects
        if place == 0:
            return (value,) if isinstance(value, str) else ()
        plain = value.name if isinstance(value, Name) else value.value if isinstance(value, Number | Text | Truth) else None
        if plain is None:
            return ()
        by_default = (t for t in self.ontology.types if self.ontology.default(t, path) == plain)
        alike = (name for t in by_default for name in self.map.of_type(t) if self.map.objects[name].values.get(path) is None)
        return (*self.map.with_value(path, plain), *alike)

    def value(self, owner: Argument, path: str) -> Constant | None:
        """The value of the attribute now, in its unit; None if it has none."""
        value = value_of(owner, path, self.map, self.ontology) if isinstance(owner, str) else None
        return constant(value, attribute_at(path, self.ontology)) if value is not None else None

    def is_open(self, fact: Fact) -> bool:
        """Whether the map does not say whether the fact holds: the object is unknown or an output, the attribute has no value, or the map
        does not say where the object is."""
        predicate, arguments = fact
        if predicate == KNOWN:
            return not self.fact_holds(fact)
        fresh = self.reading.fresh if self.reading is not None else frozenset()
        if arguments[0] in fresh:
            return True
        if predicate == "." + UNKNOWN:
            return self.value(arguments[0], UNKNOWN) != arguments[1]
        if predicate.startswith("."):
            return self.value(arguments[0], predicate[1:]) is None
        if self.ontology.relations[predicate].excludes is None:
            return not fresh.isdisjoint(self._names(arguments))
        [name] = self._names(arguments[:1])
        if self.map.facts_with(predicate, 0, name):
            return False
        return not any(self.map.facts_with(relation, 0, name) for relation in self.vocabulary.excluded_by(predicate))

    def is_fruitless(self, service: ServiceType, binding: Binding) -> bool:
        """Whether all devices that could tell it told nothing a short time ago."""
        if not self.fruitless:
            return False
        use = describe_use(service.name, {parameter.name: as_term(binding[parameter.name]) for parameter in service.inputs})
        providers = (provider,) if isinstance(provider := binding.get(PROVIDER), str) else self.providers[service.name]
        return all((provider, use) in self.fruitless for provider in providers)

    def favourable_values(self, path: str) -> list[Argument]:
        """The values that the plan may assume for an attribute that a service finds out."""
        if path not in self._favourable_values:
            values = favourable_values(path, self._formulas(), self.map, self.ontology)
            self._favourable_values[path] = list(values)
        return self._favourable_values[path]

    def _formulas(self) -> Iterator[Formula]:
        yield self._goal
        for service in self._service_types:
            if service.start_condition is not None:
                yield parse(service.start_condition)

    def _names(self, arguments: tuple[Argument, ...]) -> tuple[str, ...]:
        for argument in arguments:
            if not isinstance(argument, str):
                return tuple(argument if isinstance(argument, str) else "" for argument in arguments)
        return arguments  # type: ignore[return-value]  # all are names

    def canonical(self, fact: Fact) -> Fact:
        """The fact in canonical form: the arguments of a symmetric relation are sorted."""
        predicate, arguments = fact
        return (predicate, tuple(sorted(arguments, key=str))) if self.vocabulary.is_symmetric(predicate) else fact

    def holds_statically(self, literal: Literal, binding: Binding) -> bool:
        """Whether a static literal holds; the result is cached."""
        key = literal, tuple((name, binding[name]) for name in variables(literal) if name in binding)
        if key not in self._settled:
            self._settled[key] = next(self.find_bindings(literal, dict(key[1])), None) is not None
        return self._settled[key]

    def is_settled(self, fact: Fact, operator: Operator) -> bool:
        """Whether the fact is a choice of the operator that holds on the map, whatever services do."""
        static_ways = operator.static_ways.get(fact[0])
        if static_ways is None:
            return False
        binding = dict(zip(static_ways.names, fact[1], strict=True))
        return any(all(self.holds_statically(literal, binding) for literal in way) for way in static_ways.ways)

    def find_bindings(self, literal: Literal, binding: Binding) -> Iterator[Binding]:
        """The extensions of the binding with which a static literal holds."""
        substitution = {name: as_term(value) for name, value in binding.items() if name in variables(literal)}
        for row in rows(literal, substitution, self.map, self.ontology):
            yield {**binding, **{name: as_argument(term) for name, term in row.items()}}

    def passes(self, test: Test, binding: Binding) -> bool:
        """Whether the comparison holds with the values that the binding gives to its hidden variables."""
        terms = {name: as_term(value) for name, value in binding.items()}
        sides = []
        for side in (test.comparison.left, test.comparison.right):
            measured = measure(side, self.map, self.ontology, terms)
            if measured is not None and isinstance(side, Variable) and side.name in test.hidden:
                measured = MeasuredValue(measured.constant, test.hidden[side.name])
            sides.append(measured)
        left_value, right_value = sides
        return left_value is not None and right_value is not None and compare(left_value, test.comparison.operator, right_value)


def rows(formula: Formula, substitution: Mapping[str, Term], map: Map, ontology: Ontology) -> Iterator[Mapping[str, Term]]:
    """The bindings with which the formula holds on the map. The provider may be a device that is not on the map."""
    provider = substitution.get(PROVIDER)
    if isinstance(provider, Name) and provider.name not in map.objects:
        formula = substitute(formula, {PROVIDER: provider})
        return (
            {**row, PROVIDER: provider}
            for row in bindings(formula, map, ontology, {n: t for n, t in substitution.items() if n != PROVIDER})
        )
    return bindings(formula, map, ontology, substitution)


def as_term(argument: Argument) -> Constant:
    return Name(argument) if isinstance(argument, str) else argument


def as_argument(term: Term) -> Argument:
    if isinstance(term, Name):
        return term.name
    assert isinstance(term, Number | Text | Truth), f"{term} is not a constant"
    return term
