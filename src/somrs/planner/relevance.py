"""What can matter for a goal: backward from it, over the effects of operators that are not grounded yet.

Without it, a service that puts anything anywhere would be considered for every thing and place on a map of thousands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from somrs.entish import Comparison, Name, Number, Text, Truth, Variable
from somrs.planner.operators import SOME, Argument, Facts, Operator, Pattern, Vocabulary

Kinds = frozenset[str]
"""In place of an argument that is not known: the types that it is of."""
ANYTHING: Kinds = frozenset()
Wanted = tuple[bool, str, tuple[Argument | Kinds, ...]]
"""That such facts hold (True) or do not hold."""


@dataclass(frozen=True, slots=True)
class Demand:
    """An operator, as far as the goal says what its variables stand for."""

    operator: Operator
    values: tuple[tuple[str, Argument], ...]
    kinds: tuple[tuple[str, Kinds], ...]


def demands(
    operators: Iterable[Operator], known: Vocabulary, is_a: Callable[[Argument, Iterable[str]], bool], now: Facts | None = None
) -> list[Demand]:
    """Every use of an operator that may help, the goal's own first.

    With `now`, what is so at the start, fewer: nobody needs to bring about a `SOME` fact that is so already, and of facts
    that must not hold, those that do hold now are looked at one by one. That may lose plans, but seldom does.
    """
    by_predicate: dict[tuple[bool, str], list[tuple[Operator, Pattern]]] = {}
    goals: list[Operator] = []
    for operator in operators:
        if operator.service is None:
            goals.append(operator)
        for truth, pattern in _brings_about(operator, known):
            by_predicate.setdefault((truth, pattern[0]), []).append((operator, pattern))

    found: dict[Demand, None] = {}
    seen: set[Wanted] = set()
    open_: list[Wanted] = []

    def demand(new: Demand) -> None:
        if new in found:
            return
        found[new] = None
        for wanted in _wants(new) if now is None else _narrowed(_wants(new), now, is_a):
            if wanted not in seen:
                seen.add(wanted)
                open_.append(wanted)

    for operator in goals:
        demand(Demand(operator, (), ()))
    while open_:
        truth, predicate, arguments = open_.pop()
        for operator, pattern in by_predicate.get((truth, predicate), ()):
            new = _matched(operator, pattern, arguments, is_a)
            if new is not None:
                demand(new)
    return list(found)


def _narrowed(every: Iterable[Wanted], now: Facts, is_a: Callable[[Argument, Iterable[str]], bool]) -> Iterator[Wanted]:
    for truth, predicate, arguments in every:
        known = [None if isinstance(argument, frozenset) else argument for argument in arguments]
        if truth:
            if not (predicate.endswith(SOME) and known[0] is not None and (predicate, (known[0],)) in now.all):
                yield truth, predicate, arguments
            continue
        for fact in now.like(predicate, known):
            pairs = zip(arguments, fact, strict=True)
            if all(is_a(mine, wanted) if isinstance(wanted, frozenset) else mine == wanted for wanted, mine in pairs):
                yield truth, predicate, fact


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
                relation = known.ontology.relations[other]
                if other != predicate or relation.functional:
                    rest = tuple(Variable("") for _ in relation.joins[1:])
                    yield False, (other, (arguments[0], *rest))
                    if known.symmetric(other):
                        yield False, (other, (*rest, arguments[0]))
    for predicate, arguments in operator.removes:
        yield False, (predicate, arguments)
        if known.symmetric(predicate):
            yield False, (predicate, arguments[::-1])


def _wants(demand: Demand) -> Iterator[Wanted]:
    values, kinds = dict(demand.values), dict(demand.kinds)
    for test in demand.operator.tests:
        match test.comparison:  # a value that would pass is the one that a service with a value as input should be given
            case Comparison(Variable(name), "=" | "<=" | ">=", (Number() | Text() | Truth() | Name()) as value) | Comparison(
                (Number() | Text() | Truth() | Name()) as value, "=" | "<=" | ">=", Variable(name)
            ) if name in test.hidden:
                values.setdefault(name, value)

    def argument(term: object) -> Argument | Kinds:
        match term:
            case Variable(name):
                return values.get(name) or kinds.get(name, ANYTHING) | demand.operator.types.get(name, ANYTHING)
            case str() | Name() | Number() | Text() | Truth():
                return term
        return ANYTHING

    for predicate, arguments in demand.operator.needs:
        yield True, predicate, tuple(map(argument, arguments))
    for forbidden in demand.operator.forbids:
        predicate, arguments = forbidden.pattern
        yield False, predicate, tuple(map(argument, arguments))


def _matched(
    operator: Operator, pattern: Pattern, wanted: tuple[Argument | Kinds, ...], is_a: Callable[[Argument, Iterable[str]], bool]
) -> Demand | None:
    """The operator bound so that the pattern of its effect is what is wanted; None when it cannot be."""
    values: dict[str, Argument] = {}
    kinds: dict[str, Kinds] = {}
    for mine, theirs in zip(pattern[1], wanted, strict=False):
        if isinstance(mine, Variable):
            if not mine.name or "." in mine.name:
                continue  # any partner; or the value that an attribute has by then, which is not for the goal to say
            if isinstance(theirs, frozenset):
                kinds[mine.name] = kinds.get(mine.name, ANYTHING) | theirs - operator.types.get(mine.name, ANYTHING)
            elif values.setdefault(mine.name, theirs) != theirs or not is_a(theirs, operator.types.get(mine.name, ())):
                return None
        elif isinstance(theirs, frozenset):
            if isinstance(mine, str) and not is_a(mine, theirs):
                return None
        elif isinstance(mine, str) and mine != theirs:
            return None
    for name, value in values.items():
        if not is_a(value, kinds.pop(name, ())):
            return None
    return Demand(operator, tuple(sorted(values.items(), key=_name)), tuple(sorted((n, k) for n, k in kinds.items() if k)))


def _name(item: tuple[str, object]) -> str:
    return item[0]
