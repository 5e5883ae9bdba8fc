"""What can matter for a goal: backward from it, over the effects of operators that are not grounded yet.

Without it, a service that puts anything anywhere would be considered for every thing and place on a map of thousands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from somrs.entish import Attribute, Comparison, Name, Number, Relation, Text, Truth, Variable
from somrs.entish.formula import terms, variables
from somrs.ontology.services import PROVIDER
from somrs.planner.model.operators import SOME, Argument, Operator, Pattern, bare
from somrs.planner.model.world import World

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


def demands(goals: Sequence[Operator], world: World, *, narrow: bool = False, depth: int | None = None) -> list[Demand]:
    """Every use of an operator that may help, the goals' own first.

    When narrow, fewer: nobody needs to bring about a `SOME` fact that is so already, and of facts that must not hold, those
    that do hold now are looked at one by one. With a depth, only what helps by way of so many services or fewer.
    Both may lose plans, but seldom do.
    """
    found: dict[Demand, None] = dict.fromkeys(Demand(goal, (), ()) for goal in goals)
    seen: set[Wanted] = set()
    new = list(found)
    while new and (depth is None or depth > 0):
        depth = depth - 1 if depth is not None else None
        wanted = {wish: None for demand in new for wish in (_narrowed(_wants(demand), world) if narrow else _wants(demand))}
        fresh = [wish for wish in wanted if wish not in seen]
        seen.update(fresh)
        new = [demand for wish in fresh for demand in _helping(wish, world) if demand not in found]
        new = list(dict.fromkeys(new))
        found.update(dict.fromkeys(new))
    return _without_special(found, world, narrow)


def _without_special(found: Iterable[Demand], world: World, narrow: bool) -> list[Demand]:
    """The demands without those that are a special case of another one: who may move any crate may move this one.

    When narrow, not all objects are tried where any will do, and the special case stays that names one.
    """
    kept: list[Demand] = []
    general: dict[Operator, dict[tuple[str, ...], dict[tuple[Argument, ...], list[Demand]]]] = {}
    for demand in sorted(found, key=lambda demand: (len(demand.values), len(demand.kinds))):
        values = dict(demand.values)
        by_names = general.setdefault(demand.operator, {})
        if not any(
            _covers(other, demand, world, narrow)
            for names, by_values in by_names.items()
            if all(name in values for name in names)
            for other in by_values.get(tuple(values[name] for name in names), ())
        ):
            kept.append(demand)
            by_names.setdefault(tuple(values), {}).setdefault(tuple(values.values()), []).append(demand)
    return kept


def _covers(general: Demand, special: Demand, world: World, narrow: bool) -> bool:
    """Whether all that is of the types that the special one asks for is of those of the general one."""
    values, kinds = dict(special.values), dict(special.kinds)
    if narrow and not {*values} - {name for name, _ in general.values} <= {PROVIDER, *_found_by_facts(special.operator)}:
        return False
    for name, wanted in general.kinds:
        if name in values:
            if not world.is_a(values[name], wanted):
                return False
        elif not _all_of(special.operator.types.get(name, ANYTHING) | kinds.get(name, ANYTHING), wanted, world):
            return False
    return True


def _all_of(kinds: Kinds, wanted: Kinds, world: World) -> bool:
    """Whether what is of the kinds is of the wanted ones."""
    return all(one in kinds or any(world.all_of(kind, one) for kind in kinds) for one in wanted)


def _helping(wanted: Wanted, world: World) -> Iterator[Demand]:
    truth, predicate, arguments = wanted
    for operator, pattern in world.repertoire.makes.get((truth, predicate), ()):
        if operator.service is not None and world.providers.get(operator.service.name):
            demand = _matched(operator, pattern, arguments, world.is_a)
            if demand is not None:
                yield demand


def _narrowed(every: Iterable[Wanted], world: World) -> Iterator[Wanted]:
    for truth, predicate, arguments in every:
        known = [None if isinstance(argument, frozenset) else argument for argument in arguments]
        if truth:
            if not (predicate.endswith(SOME) and known[0] is not None and world.so((predicate, (known[0],)))):
                yield truth, predicate, arguments
            continue
        for fact in world.like(predicate, known):
            pairs = zip(arguments, fact, strict=True)
            if all(world.is_a(mine, wanted) if isinstance(wanted, frozenset) else mine == wanted for wanted, mine in pairs):
                yield truth, predicate, fact


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
    for literal in demand.operator.counts:
        for term in terms(literal):
            if isinstance(term, Attribute):
                yield True, "." + term.path, (argument(bare(term.owner)), ANYTHING)
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


def _found_by_facts(operator: Operator) -> Iterator[str]:
    """The variables that what the operator needs binds."""
    for _, arguments in operator.needs:
        yield from (argument.name for argument in arguments if isinstance(argument, Variable))
    for literal in operator.static:
        if isinstance(literal, Relation):
            yield from variables(literal)
