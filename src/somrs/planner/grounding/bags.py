"""Bags of devices that differ only in what services change: to an exploration, all devices of a bag are one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from somrs.entish import Attribute, Call, Comparison, Not, Number, Relation
from somrs.entish.formula import Literal, names, terms
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.ontology.values import value_of
from somrs.planner.grounding.relevance import Demand
from somrs.planner.model.problem import Problem
from somrs.planner.model.vocabulary import EXISTS_SUFFIX, Fact
from somrs.planner.model.world import World

VALUES = 8
"""The maximum number of values of a number that the representative of a bag has; of more, it has the smallest and the largest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bag:
    """Devices that are one to an exploration, the representative first, and devices that are left out of it."""

    members: tuple[str, ...]
    others: tuple[str, ...] = ()

    @property
    def representative(self) -> str:
        return self.members[0]

    @property
    def left_out(self) -> tuple[str, ...]:
        """The devices that no action of the exploration may use."""
        return (*self.members[1:], *self.others)

    def only(self, device: str) -> Bag:
        """The bag with a single device; the others are left out."""
        return Bag(members=(device,), others=tuple(name for name in (*self.members, *self.others) if name != device))

    def find_holders(self, map: Map, world: World) -> dict[Fact, list[str]]:
        """The devices of which a fact holds now, by the fact with the representative in place of the device."""
        holders: dict[Fact, list[str]] = {}
        for device in self.members:
            for predicate, arguments in _changing_facts(device, map, world):
                renamed = tuple(self.representative if argument == device else argument for argument in arguments)
                holders.setdefault(world.canonical((predicate, renamed)), []).append(device)
        return _without_middle_numbers(holders)


def find_bags(problem: Problem, world: World, demanded: Sequence[Demand]) -> list[Bag]:
    """The bags with several devices. `problem` has the map; `world` and `demanded` say what matters of a device."""
    literals = [literal for operator in {demand.operator: None for demand in demanded} for literal in operator.static_literals]
    named = {value for demand in demanded for _, value in demand.values if isinstance(value, str)}
    named.update(name for literal in literals for name in names(literal))
    for demand in demanded:
        operator = demand.operator
        patterns = (*operator.preconditions, *operator.add_effects, *operator.delete_effects)
        patterns += tuple(forbidden.pattern for forbidden in operator.negative_preconditions)
        named.update(term for _, pattern_terms in patterns for term in pattern_terms if isinstance(term, str))
    offered: dict[str, list[str]] = {}
    for service, providers in world.providers.items():
        for provider in providers:
            offered.setdefault(provider, []).append(service)
    aspects = _Aspects(world, literals)
    groups: dict[object, list[str]] = {}
    for device, services in offered.items():
        if device not in named and device in problem.map.objects:
            groups.setdefault((tuple(services), aspects.signature(device, problem)), []).append(device)
    return [Bag(members=tuple(devices)) for devices in groups.values() if len(devices) > 1]


class _Aspects:
    """The aspects of a device that services do not change, and that static conditions mention."""

    def __init__(self, world: World, literals: Iterable[Literal]) -> None:
        self.relations: set[str] = set()
        self.paths: set[str] = set()
        self.is_complete = False
        """Whether all attributes matter, because conditions call functions of them."""
        for literal in literals:
            atom = literal.atom if isinstance(literal, Not) else literal
            if isinstance(atom, Relation):
                self.relations.add(atom.relation)
            elif isinstance(atom, Comparison):
                self.paths.update(term.path for term in terms(atom) if isinstance(term, Attribute))
                self.is_complete |= any(isinstance(term, Call) for term in terms(atom))
        self._changing = world.vocabulary.paths | world.vocabulary.counters

    def signature(self, device: str, problem: Problem) -> object:
        map, object = problem.map, problem.map.objects[device]
        paths = sorted(self.paths | set(object.values) if self.is_complete else self.paths)
        values = tuple(value_of(device, path, map, problem.ontology) for path in paths if path not in self._changing)
        facts = frozenset(
            (relation, tuple("" if name == device else name for name in arguments))
            for relation, arguments in _facts_about(device, self.relations, map, problem.ontology)
        )
        return object.type, values, facts


def _without_middle_numbers(holders: dict[Fact, list[str]]) -> dict[Fact, list[str]]:
    """The facts without the values between the smallest and the largest of an attribute, if there are many."""
    by_attribute: dict[str, list[Fact]] = {}
    for fact in holders:
        if isinstance(fact[1][-1], Number):
            by_attribute.setdefault(fact[0], []).append(fact)
    for facts in by_attribute.values():
        if len(facts) > VALUES:
            facts.sort(key=_number)
            for fact in facts[1:-1]:
                del holders[fact]
    return holders


def _number(fact: Fact) -> float:
    number = fact[1][-1]
    assert isinstance(number, Number)
    return number.value


def _changing_facts(device: str, map: Map, world: World) -> Iterator[Fact]:
    for relation, arguments in _facts_about(device, world.vocabulary.relations, map, world.ontology):
        yield relation, arguments
        if arguments[0] == device:
            yield relation + EXISTS_SUFFIX, (device,)
    here = world.at(map)
    for path in world.vocabulary.paths:
        if world.has_attribute(device, path) and (value := here.value(device, path)) is not None:
            yield "." + path, (device, value)


def _facts_about(device: str, relations: Iterable[str], map: Map, ontology: Ontology) -> Iterator[tuple[str, tuple[str, ...]]]:
    for relation in relations:
        for place in range(len(ontology.relations[relation].joins)):
            yield from ((relation, arguments) for arguments in map.facts_with(relation, place, device))
