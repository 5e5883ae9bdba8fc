"""What services of given types can do, compiled once for all tasks that are planned with them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from somrs.entish import Term, Variable
from somrs.entish.parse import parse
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology
from somrs.planner.model.operators import SOME, Argument, Inexpressible, Operator, Pattern, Vocabulary, bare, operators

Outcome = tuple[bool, str]
"""That facts of a predicate hold (True) or do not hold any more."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Repertoire:
    """The operators of service types, and which of them bring about what."""

    known: Vocabulary
    makes: Mapping[Outcome, tuple[tuple[Operator, Pattern], ...]]
    left_out: tuple[Inexpressible, ...]
    """What was said of service types that cannot be expressed."""


@lru_cache(maxsize=32)  # an ontology is never changed: it stands for what it says
def repertoire(ontology: Ontology, services: tuple[ServiceType, ...], counting: bool = False) -> Repertoire:
    known = Vocabulary(ontology, [parse(service.effect) for service in services], counting)
    makes: dict[Outcome, list[tuple[Operator, Pattern]]] = {}
    left_out: list[Inexpressible] = []
    for service in services:
        try:
            found = list(operators(service, known))
        except Inexpressible as inexpressible:
            left_out.append(Inexpressible(f"{service.name}: {inexpressible.formula}", inexpressible.why))
            continue
        for operator in found:
            for truth, pattern in _brings_about(operator, known):
                makes.setdefault((truth, pattern[0]), []).append((operator, pattern))
    return Repertoire(known=known, makes={key: tuple(dict.fromkeys(made)) for key, made in makes.items()}, left_out=tuple(left_out))


def _brings_about(operator: Operator, known: Vocabulary) -> Iterator[tuple[bool, Pattern]]:
    """What the operator makes true and false, what it replaces included."""
    for predicate, arguments in operator.adds:
        yield True, (predicate, arguments)
        if predicate.startswith("."):
            yield False, (predicate, (arguments[0], Variable("")))
        elif predicate in known.ontology.relations:
            yield True, (predicate + SOME, arguments[:1])
            if known.symmetric(predicate):
                yield True, (predicate, arguments[::-1])
            for other in (predicate, *known.excluded_by(predicate)):
                yield from ((False, pattern) for pattern in _given_up(predicate, other, arguments, known))
    for target, _ in operator.sets:
        yield True, ("." + target.path, (bare(target.owner), Variable("")))
    for predicate, arguments in operator.removes:
        yield False, (predicate, arguments)
        if known.symmetric(predicate):
            yield False, (predicate, arguments[::-1])


def _given_up(entered: str, other: str, arguments: tuple[Argument | Term, ...], known: Vocabulary) -> Iterable[Pattern]:
    """What of the other relation the first argument gives up when it enters into the one."""
    relation = known.ontology.relations[other]
    if other == entered and not relation.functional:
        return
    rest = tuple(Variable("") for _ in relation.joins[1:])
    yield other, (arguments[0], *rest)
    if known.symmetric(other):
        yield other, (*rest, arguments[0])
