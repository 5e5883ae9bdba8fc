"""The map as the planner asks about it: what is of which type, what holds now, and what is settled because no service changes it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from somrs.entish import Name, Number, Term, Text, Truth, Variable
from somrs.entish.formula import Constant, Literal, variables
from somrs.ontology.objects import Map
from somrs.ontology.truth import bindings
from somrs.ontology.types import ROOT, Ontology
from somrs.ontology.values import Measured, attribute_at, compare, constant, measure, value_of
from somrs.planner.operators import SOME, Argument, Fact, Facts, Test, Vocabulary
from somrs.planner.problem import Problem

Bound = dict[str, Argument]
"""What variables stand for."""
VALUES: Mapping[str, tuple[type, ...]] = {"number": (Number,), "text": (Text, Name), "truth": (Truth,)}
"""What an input that is a value can be."""


class World:
    """One problem's map and ontology, with answers kept."""

    def __init__(self, problem: Problem, known: Vocabulary) -> None:
        self.map: Map = problem.map
        self.ontology: Ontology = problem.ontology
        self.known = known
        self.excluded = problem.excluded
        self._is_a: dict[tuple[str, str], bool] = {}
        self._settled: dict[tuple[Literal, tuple[tuple[str, Argument], ...]], bool] = {}
        self._domains: dict[frozenset[str], list[str]] = {}
        self._paths: dict[str, frozenset[str]] = {}

    def is_a(self, argument: Argument, types: Iterable[str]) -> bool:
        """Whether an object or value is of all the types."""
        return argument not in self.excluded and self.is_of(argument, types)

    def is_of(self, argument: Argument, types: Iterable[str]) -> bool:
        """The same, for objects that no step may involve, too."""
        if isinstance(argument, str):
            object = self.map.objects.get(argument)
            return all(object is not None and self._type_is_a(object.type, type_name) for type_name in types)
        return all(isinstance(argument, VALUES.get(type_name, ())) for type_name in types)

    def _type_is_a(self, type_name: str, ancestor: str) -> bool:
        key = type_name, ancestor
        if key not in self._is_a:
            self._is_a[key] = self.ontology.is_a(type_name, ancestor)
        return self._is_a[key]

    def has(self, name: str, path: str) -> bool:
        """Whether the object may have the attribute."""
        object = self.map.objects.get(name)
        if object is None:
            return False
        if object.type not in self._paths:
            self._paths[object.type] = frozenset(self.ontology.attributes_of(object.type))
        return path in self._paths[object.type]

    def domain(self, types: frozenset[str]) -> list[str]:
        """The objects that are of all the types."""
        if types not in self._domains:
            narrowest = max(types, key=lambda name: sum(1 for _ in self.ontology.ancestors(name)), default=ROOT)
            of_one = (name for subtype in self.ontology.subtypes(narrowest) for name in self.map.of_type(subtype))
            self._domains[types] = [name for name in of_one if self.is_a(name, types)]
        return self._domains[types]

    def now(self) -> Facts:
        """What holds now, of what services change."""
        found = Facts()
        for fact in self._initial():
            found.add(fact)
        return found

    def _initial(self) -> Iterator[Fact]:
        for relation in self.known.relations:
            for fact in self.map.facts(relation):
                yield self.canonical((relation, fact.arguments))
                yield relation + SOME, fact.arguments[:1]
        for path in self.known.paths:
            attribute = attribute_at(path, self.ontology)
            for name in self.map.objects:
                value = value_of(name, path, self.map, self.ontology)
                if value is not None:
                    yield "." + path, (name, constant(value, attribute))

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
        for row in bindings(literal, self.map, self.ontology, given):
            yield {**bound, **{name: as_argument(term) for name, term in row.items()}}

    def passes(self, test: Test, bound: Bound) -> bool:
        """Whether the comparison holds with these values of attributes."""
        terms = {name: as_term(value) for name, value in bound.items()}
        sides = []
        for side in (test.comparison.left, test.comparison.right):
            measured = measure(side, self.map, self.ontology, terms)
            if measured is not None and isinstance(side, Variable) and side.name in test.hidden:
                measured = Measured(measured.constant, test.hidden[side.name])
            sides.append(measured)
        left, right = sides
        return left is not None and right is not None and compare(left, test.comparison.operator, right)


def as_term(argument: Argument) -> Constant:
    return Name(argument) if isinstance(argument, str) else argument


def as_argument(term: Term) -> Argument:
    if isinstance(term, Name):
        return term.name
    assert isinstance(term, Number | Text | Truth), f"{term} is not a constant"
    return term
