"""The map as the planner asks about it: what is of which type, what holds now, and what is settled because no service changes it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from somrs.entish import Formula, Name, Number, Term, Text, Truth, Variable
from somrs.entish.formula import Constant, Literal, substitute, variables
from somrs.entish.parse import parse_term
from somrs.ontology.objects import Map
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.truth import bindings
from somrs.ontology.types import ROOT, Ontology
from somrs.ontology.values import MeasuredValue, attribute_at, compare, constant, measure, value_of
from somrs.planner.model.operators import SOME, Argument, Fact, Test, providers_of
from somrs.planner.model.problem import Problem
from somrs.planner.model.repertoire import repertoire

Bound = dict[str, Argument]
"""What variables stand for."""
VALUES: Mapping[str, tuple[type, ...]] = {"number": (Number,), "text": (Text, Name), "truth": (Truth,)}
"""What an input that is a value can be."""


class World:
    """One problem's map and ontology, with answers kept."""

    def __init__(self, problem: Problem, counting: bool = False) -> None:
        self.map: Map = problem.map
        self.ontology: Ontology = problem.ontology
        self.repertoire = repertoire(problem.ontology, tuple(available.service_type for available in problem.services), counting)
        self.known = self.repertoire.known
        self.excluded, self.hurry = problem.excluded, problem.hurry
        self.providers: Mapping[str, tuple[str, ...]] = {
            available.service_type.name: tuple(name for name in available.providers if name not in problem.excluded)
            for available in problem.services
        }
        """The devices that offer a service type, those that may take part."""
        self._of: dict[str, frozenset[str]] = {providers_of(name): frozenset(found) for name, found in self.providers.items()}
        self._prices = {available.service_type.name: dict(available.prices) for available in problem.services}
        self._by_type = any(available.service_type.cost is not None for available in problem.services)
        every = [price for asked in self._prices.values() for price in asked.values()]
        self._usual = sum(every) / len(every) if every else 1.0
        self._is_a: dict[tuple[str, str], bool] = {}
        self._settled: dict[tuple[Literal, tuple[tuple[str, Argument], ...]], bool] = {}
        self._paths: dict[str, frozenset[str]] = {}
        self._like: dict[tuple[str, int, Argument] | str, list[tuple[Argument, ...]]] = {}

    @property
    def priced(self) -> bool:
        """Whether it is known that uses of services may cost more or less."""
        return self._by_type or len({price for asked in self._prices.values() for price in asked.values()}) > 1

    def cost(self, service: ServiceType | None, bound: Bound) -> float:
        """What a use of the service costs, as far as can be told before anybody is asked: by the service type; by what its provider, or
        the cheapest, asked last; or what services cost as a rule."""
        if service is None:
            return 0.0
        if service.cost is not None:
            terms = {name: as_term(value) for name, value in bound.items()}
            measured = measure(parse_term(service.cost), self.map, self.ontology, terms)
            if measured is not None and isinstance(measured.constant, Number):
                return max(0.0, measured.constant.value)
        asked, provider = self._prices[service.name], bound.get(PROVIDER)
        if isinstance(provider, str) and provider in asked:
            return asked[provider]
        return min(asked.values(), default=self._usual)

    def is_a(self, argument: Argument, types: Iterable[str]) -> bool:
        """Whether an object or value is of all the types."""
        return argument not in self.excluded and self.is_of(argument, types)

    def is_of(self, argument: Argument, types: Iterable[str]) -> bool:
        """The same, for objects that no step may involve, too."""
        if isinstance(argument, str):
            object = self.map.objects.get(argument)
            for type_name in types:
                if type_name in self._of:
                    if argument not in self._of[type_name]:
                        return False
                elif object is None or not self._type_is_a(object.type, type_name):
                    return False
            return True
        return all(isinstance(argument, VALUES.get(type_name, ())) for type_name in types)

    def all_of(self, type_name: str, other: str) -> bool:
        """Whether everything that is of the one is of the other; either may be the devices that offer a service."""
        if other in self._of:
            return type_name in self._of and self._of[type_name] <= self._of[other]
        return type_name not in self._of and self._type_is_a(type_name, other)

    def _type_is_a(self, type_name: str, ancestor: str) -> bool:
        key = type_name, ancestor
        if key not in self._is_a:
            self._is_a[key] = self.ontology.is_subtype(type_name, ancestor)
        return self._is_a[key]

    def has(self, name: str, path: str) -> bool:
        """Whether the object may have the attribute."""
        object = self.map.objects.get(name)
        if object is None:
            return False
        if object.type not in self._paths:
            self._paths[object.type] = frozenset(self.ontology.attributes_of(object.type))
        return path in self._paths[object.type]

    def domain(self, types: frozenset[str]) -> Iterator[str]:
        """The objects that are of all the types."""
        for type_name in types:
            if type_name in self._of:
                candidates: Iterable[str] = next(found for name, found in self.providers.items() if providers_of(name) == type_name)
                break
        else:
            narrowest = max(types, key=lambda name: len(self.ontology.ancestors(name)), default=ROOT)
            candidates = (name for subtype in self.ontology.subtypes(narrowest) for name in self.map.of_type(subtype))
        return (name for name in candidates if self.is_a(name, types))

    # What holds now, of what services change

    def so(self, fact: Fact) -> bool:
        """Whether the fact holds now."""
        predicate, arguments = fact
        if predicate.startswith("."):
            return self._value(arguments[0], predicate[1:]) == arguments[1]
        names = self._names(arguments)
        if predicate.endswith(SOME):
            return bool(self.map.facts_with(predicate.removesuffix(SOME), 0, names[0]))
        return self.map.has_fact(predicate, names) or (self.known.symmetric(predicate) and self.map.has_fact(predicate, names[::-1]))

    def count(self, predicate: str, known: Sequence[Argument | None]) -> int:
        """About how many facts hold now that `like` would look at; never fewer."""
        if predicate.startswith("."):
            return 1 if known[0] is not None else len(self.map.objects) if known[1] is None else len(self.like(predicate, known))
        relation = predicate.removesuffix(SOME)
        places = (0, 1) if self.known.symmetric(relation) else None
        return min(
            (
                sum(len(self.map.facts_with(relation, p, value)) for p in places or (place,))
                for place, value in enumerate(known)
                if isinstance(value, str)
            ),
            default=self.map.count(relation),
        )

    def like(self, predicate: str, known: Sequence[Argument | None]) -> list[tuple[Argument, ...]]:
        """The arguments of facts that hold now and may have the known ones, of which at least one was looked at."""
        places = [place for place, value in enumerate(known) if value is not None]
        place = min(places, key=lambda place: self._few(predicate, place, known[place]), default=None)
        key = (predicate, place, known[place]) if place is not None else predicate
        if key not in self._like:
            self._like[key] = list(self._found(predicate, place, known[place] if place is not None else None))  # type: ignore[index]
        return self._like[key]  # type: ignore[index]

    def _few(self, predicate: str, place: int, value: Argument | None) -> int:
        """How many facts there are with the value at the place; fewer are better."""
        if predicate.startswith("."):
            return place
        return len(self.map.facts_with(predicate.removesuffix(SOME), place, value)) if isinstance(value, str) else 0

    def _found(self, predicate: str, place: int | None, value: Argument | None) -> Iterator[tuple[Argument, ...]]:
        if predicate.startswith("."):
            for name in self._owners(predicate[1:], place, value):
                if (known := self._value(name, predicate[1:])) is not None:
                    yield name, known
            return
        relation = predicate.removesuffix(SOME)
        if place is None:
            tuples: Iterable[tuple[str, ...]] = (fact.arguments for fact in self.map.facts(relation))
        else:
            name = value if isinstance(value, str) else ""
            either = (place, 1 - place) if self.known.symmetric(relation) else (place,)
            tuples = (arguments for place in either for arguments in self.map.facts_with(relation, place, name))
        if predicate.endswith(SOME):
            yield from dict.fromkeys(arguments[:1] for arguments in tuples)
        elif self.known.symmetric(relation):
            every = dict.fromkeys(self.canonical((relation, arguments))[1] for arguments in tuples)
            yield from (arguments for arguments in every if place is None or arguments[place] == value)
        else:
            yield from tuples

    def _owners(self, path: str, place: int | None, value: Argument | None) -> Iterable[str]:
        """The objects whose attribute may have the value."""
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

    def _value(self, owner: Argument, path: str) -> Constant | None:
        value = value_of(owner, path, self.map, self.ontology) if isinstance(owner, str) else None
        return constant(value, attribute_at(path, self.ontology)) if value is not None else None

    def _names(self, arguments: tuple[Argument, ...]) -> tuple[str, ...]:
        return tuple(argument if isinstance(argument, str) else "" for argument in arguments)

    def canonical(self, fact: Fact) -> Fact:
        """One way of writing facts of symmetric relations."""
        predicate, arguments = fact
        return (predicate, tuple(sorted(arguments, key=str))) if self.known.symmetric(predicate) else fact

    def settles(self, literal: Literal, bound: Bound) -> bool:
        """Whether a literal over what no service changes holds."""
        key = literal, tuple((name, bound[name]) for name in variables(literal) if name in bound)
        if key not in self._settled:
            self._settled[key] = next(self.answers(literal, dict(key[1])), None) is not None
        return self._settled[key]

    def answers(self, literal: Literal, bound: Bound) -> Iterator[Bound]:
        """The ways in which such a literal holds."""
        given = {name: as_term(value) for name, value in bound.items() if name in variables(literal)}
        for row in rows(literal, given, self.map, self.ontology):
            yield {**bound, **{name: as_argument(term) for name, term in row.items()}}

    def passes(self, test: Test, bound: Bound) -> bool:
        """Whether the comparison holds with these values of attributes."""
        terms = {name: as_term(value) for name, value in bound.items()}
        sides = []
        for side in (test.comparison.left, test.comparison.right):
            measured = measure(side, self.map, self.ontology, terms)
            if measured is not None and isinstance(side, Variable) and side.name in test.hidden:
                measured = MeasuredValue(measured.constant, test.hidden[side.name])
            sides.append(measured)
        left, right = sides
        return left is not None and right is not None and compare(left, test.comparison.operator, right)


def rows(formula: Formula, given: Mapping[str, Term], map: Map, ontology: Ontology) -> Iterator[Mapping[str, Term]]:
    """The ways in which the formula holds, of a provider too that is not on the map."""
    provider = given.get(PROVIDER)
    if isinstance(provider, Name) and provider.name not in map.objects:
        formula = substitute(formula, {PROVIDER: provider})
        return ({**row, PROVIDER: provider} for row in bindings(formula, map, ontology, {n: t for n, t in given.items() if n != PROVIDER}))
    return bindings(formula, map, ontology, given)


def as_term(argument: Argument) -> Constant:
    return Name(argument) if isinstance(argument, str) else argument


def as_argument(term: Term) -> Argument:
    if isinstance(term, Name):
        return term.name
    assert isinstance(term, Number | Text | Truth), f"{term} is not a constant"
    return term
