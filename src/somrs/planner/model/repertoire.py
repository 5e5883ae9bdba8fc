"""The operators of a set of service types, compiled once for all tasks that are planned with them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from somrs.entish import Formula, Term, Variable
from somrs.entish.parse import parse
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology
from somrs.planner.model.operators import Operator, operators
from somrs.planner.model.reading import Reading, tells
from somrs.planner.model.vocabulary import EXISTS_SUFFIX, Argument, Inexpressible, Pattern, Vocabulary, strip_type

Outcome = tuple[bool, str]
"""Facts of a predicate become true (True) or false (False)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Repertoire:
    """The operators of service types, by their outcomes."""

    vocabulary: Vocabulary
    achievers: Mapping[Outcome, tuple[tuple[Operator, Pattern], ...]]
    omissions: tuple[Inexpressible, ...]
    """The service types that the planner cannot express, and why."""


@lru_cache(maxsize=32)  # an ontology is immutable, so its identity can be the key
def repertoire(ontology: Ontology, services: tuple[ServiceType, ...], counting: bool = False, reading: Reading | None = None) -> Repertoire:
    vocabulary = Vocabulary(ontology, _effects(services, ontology, reading), counting, reading)
    achievers: dict[Outcome, list[tuple[Operator, Pattern]]] = {}
    omissions: list[Inexpressible] = []
    for service in services:
        try:
            service_operators = list(operators(service, vocabulary))
        except Inexpressible as inexpressible:
            omissions.append(Inexpressible(f"{service.name}: {inexpressible.formula}", inexpressible.reason))
            continue
        for operator in service_operators:
            for truth, pattern in _find_outcomes(operator, vocabulary):
                achievers.setdefault((truth, pattern[0]), []).append((operator, pattern))
    return Repertoire(
        vocabulary=vocabulary,
        achievers={key: tuple(dict.fromkeys(entries)) for key, entries in achievers.items()},
        omissions=tuple(omissions),
    )


def _effects(services: Iterable[ServiceType], ontology: Ontology, reading: Reading | None) -> Iterator[Formula]:
    """What the services bring about and, in an optimistic reading, tell."""
    for service in services:
        if not tells(service):
            yield parse(service.effect)
        elif reading is not None:
            yield from (part for parts in reading.outcomes(service, parse(service.effect), ontology) for part in parts)


def _find_outcomes(operator: Operator, vocabulary: Vocabulary) -> Iterator[tuple[bool, Pattern]]:
    """What the operator makes true and false, including the facts that its effects replace."""
    for predicate, arguments in operator.add_effects:
        yield True, (predicate, arguments)
        if predicate.startswith("."):
            yield False, (predicate, (arguments[0], Variable("")))
        elif predicate in vocabulary.ontology.relations:
            yield True, (predicate + EXISTS_SUFFIX, arguments[:1])
            if vocabulary.is_symmetric(predicate):
                yield True, (predicate, arguments[::-1])
            for abandoned_relation in (predicate, *vocabulary.excluded_by(predicate)):
                yield from ((False, pattern) for pattern in _deleted_patterns(predicate, abandoned_relation, arguments, vocabulary))
    for target, _ in operator.numeric_effects:
        yield True, ("." + target.path, (strip_type(target.owner), Variable("")))
    for predicate, arguments in operator.delete_effects:
        yield False, (predicate, arguments)
        if vocabulary.is_symmetric(predicate):
            yield False, (predicate, arguments[::-1])


def _deleted_patterns(
    entered: str, abandoned_relation: str, arguments: tuple[Argument | Term, ...], vocabulary: Vocabulary
) -> Iterable[Pattern]:
    """The facts of `abandoned_relation` that become false for the first argument when it enters the relation `entered`."""
    relation = vocabulary.ontology.relations[abandoned_relation]
    if abandoned_relation == entered and not relation.functional:
        return
    rest = tuple(Variable("") for _ in relation.joins[1:])
    yield abandoned_relation, (arguments[0], *rest)
    if vocabulary.is_symmetric(abandoned_relation):
        yield abandoned_relation, (*rest, arguments[0])
