"""Relevance analysis: a backward search from the goal over the effects of operators that are not grounded yet.

Without it, grounding would try a service that puts any object in any place with all of the thousands of objects and places of a map.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from somrs.entish import Attribute, Comparison, Name, Number, Relation, Text, Truth, Variable
from somrs.entish.formula import terms, variables
from somrs.ontology.services import PROVIDER
from somrs.planner.model.operators import Operator
from somrs.planner.model.vocabulary import EXISTS_SUFFIX, KNOWN, Argument, Pattern, strip_type
from somrs.planner.model.world import World

Kinds = frozenset[str]
"""The types of an unknown argument."""
_ANY_KIND: Kinds = frozenset()
Subgoal = tuple[bool, str, tuple[Argument | Kinds, ...]]
"""Facts that have to hold (True) or must not hold (False)."""

MOST_DEMANDS = 30_000
"""The number of demands from which on they do not name objects any more: it takes some seconds to find as many."""


@dataclass(frozen=True, slots=True)
class Demand:
    """An operator whose variables are bound as far as the goal determines them."""

    operator: Operator
    values: tuple[tuple[str, Argument], ...]
    kinds: tuple[tuple[str, Kinds], ...]


def demands(
    goals: Sequence[Operator],
    world: World,
    *,
    narrow: bool = False,
    direct: bool = False,
    depth: int | None = None,
    most: int = MOST_DEMANDS,
) -> list[Demand]:
    """Every use of an operator that may help to reach the goal, the goal's operators first.

    With `narrow`, an `EXISTS_SUFFIX` fact that already holds is no subgoal, and of the facts that must not hold, only those that hold now
    are subgoals. With `direct`, a thing that is in any place is in no other place first: what holds already of a known object and any
    partner is no subgoal. With `depth`, chains of services are limited to that length. All can lose plans, but seldom do.

    From `most` demands on, what helps is demanded for any objects.
    """
    collected_demands: dict[Demand, None] = dict.fromkeys(Demand(goal, (), ()) for goal in goals)
    seen_subgoals: set[Subgoal] = set()
    new = list(collected_demands)
    while new and (depth is None or depth > 0):
        depth = depth - 1 if depth is not None else None
        subgoals = {
            subgoal: None
            for demand in new
            for subgoal in (_narrow(_find_subgoals(demand, world), world) if narrow else _find_subgoals(demand, world))
            if not (direct and _has_partner(subgoal, world))
        }
        fresh = [subgoal for subgoal in subgoals if subgoal not in seen_subgoals]
        seen_subgoals.update(fresh)
        helpful: dict[Demand, None] = {}
        for subgoal in fresh:
            if len(collected_demands) + len(helpful) >= most:
                subgoal = _widened(subgoal)
                if subgoal in seen_subgoals:
                    continue
                seen_subgoals.add(subgoal)
            helpful.update((demand, None) for demand in _find_helpful(subgoal, world) if demand not in collected_demands)
        new = list(helpful)
        collected_demands.update(helpful)
    return _without_special(collected_demands, world, narrow)


def _widened(subgoal: Subgoal) -> Subgoal:
    """The subgoal for any objects. Numbers and texts stay: grounding would not find them."""
    truth, predicate, arguments = subgoal
    return truth, predicate, tuple(_ANY_KIND if isinstance(argument, str | frozenset) else argument for argument in arguments)


def _without_special(candidates: Iterable[Demand], world: World, narrow: bool) -> list[Demand]:
    """The demands without special cases of other demands: a demand to move any crate covers a demand to move one crate.

    With `narrow`, grounding does not try all objects for an unbound variable, so a special case that names an object is kept.
    """
    kept_demands: list[Demand] = []
    general: dict[Operator, dict[tuple[str, ...], dict[tuple[Argument, ...], list[Demand]]]] = {}
    for demand in sorted(candidates, key=lambda demand: (len(demand.values), len(demand.kinds))):
        values = dict(demand.values)
        by_names = general.setdefault(demand.operator, {})
        if not any(
            _covers(general_demand, demand, world, narrow)
            for names, by_values in by_names.items()
            if all(name in values for name in names)
            for general_demand in by_values.get(tuple(values[name] for name in names), ())
        ):
            kept_demands.append(demand)
            by_names.setdefault(tuple(values), {}).setdefault(tuple(values.values()), []).append(demand)
    return kept_demands


def _covers(general: Demand, special: Demand, world: World, narrow: bool) -> bool:
    """Whether every binding that the special demand admits is admitted by the general demand."""
    values, kinds = dict(special.values), dict(special.kinds)
    if narrow and not {*values} - {name for name, _ in general.values} <= {PROVIDER, *_fact_bound_variables(special.operator)}:
        return False
    for name, required_kinds in general.kinds:
        if name in values:
            if not world.is_eligible(values[name], required_kinds):
                return False
        elif not _implies_kinds(special.operator.types.get(name, _ANY_KIND) | kinds.get(name, _ANY_KIND), required_kinds, world):
            return False
    return True


def _implies_kinds(kinds: Kinds, required_kinds: Kinds, world: World) -> bool:
    """Whether an object of the given kinds is of all required kinds."""
    return all(required_kind in kinds or any(world.is_subtype(kind, required_kind) for kind in kinds) for required_kind in required_kinds)


def _find_helpful(subgoal: Subgoal, world: World) -> Iterator[Demand]:
    truth, predicate, arguments = subgoal
    for operator, pattern in world.repertoire.achievers.get((truth, predicate), ()):
        if operator.service is None or world.providers.get(operator.service.name):
            demand = _match_operator(operator, pattern, arguments, world)
            if demand is not None:
                yield demand


def _narrow(subgoals: Iterable[Subgoal], world: World) -> Iterator[Subgoal]:
    for truth, predicate, arguments in subgoals:
        known_arguments = [None if isinstance(argument, frozenset) else argument for argument in arguments]
        if truth:
            if not (
                predicate.endswith(EXISTS_SUFFIX)
                and known_arguments[0] is not None
                and world.fact_holds((predicate, (known_arguments[0],)))
            ):
                yield truth, predicate, arguments
            continue
        for fact in world.find_facts(predicate, known_arguments):
            pairs = zip(arguments, fact, strict=True)
            if all(
                world.is_eligible(actual, expected) if isinstance(expected, frozenset) else actual == expected for expected, actual in pairs
            ):
                yield truth, predicate, fact


def _has_partner(subgoal: Subgoal, world: World) -> bool:
    """Whether the subgoal is met now, and says nothing of the partner but its type."""
    truth, predicate, arguments = subgoal
    if not truth or len(arguments) < 2 or isinstance(arguments[0], frozenset) or predicate.startswith("."):
        return False
    known_arguments = [None if isinstance(argument, frozenset) else argument for argument in arguments]
    return any(
        fact[0] == arguments[0]
        and all(
            world.is_eligible(value, kinds) for value, kinds in zip(fact[1:], arguments[1:], strict=True) if isinstance(kinds, frozenset)
        )
        for fact in world.find_facts(predicate, known_arguments)
        if all(isinstance(kinds, frozenset) for kinds in arguments[1:])
    )


def _find_subgoals(demand: Demand, world: World) -> Iterator[Subgoal]:
    values, kinds = dict(demand.values), dict(demand.kinds)
    for test in demand.operator.tests:
        match test.comparison:  # a value that passes the test is a candidate for an input of an achieving service
            case Comparison(Variable(name), "=" | "<=" | ">=", (Number() | Text() | Truth() | Name()) as value) | Comparison(
                (Number() | Text() | Truth() | Name()) as value, "=" | "<=" | ">=", Variable(name)
            ) if name in test.hidden:
                values.setdefault(name, value)

    def argument(term: object) -> Argument | Kinds:
        match term:
            case Variable(name):
                return values.get(name) or world.narrowest(kinds.get(name, _ANY_KIND) | demand.operator.types.get(name, _ANY_KIND))
            case str() | Name() | Number() | Text() | Truth():
                return term
        return _ANY_KIND

    for predicate, arguments in demand.operator.preconditions:
        yield True, predicate, tuple(map(argument, arguments))
    for literal in demand.operator.numeric_conditions:
        for term in terms(literal):
            if isinstance(term, Attribute):
                yield True, "." + term.path, (argument(strip_type(term.owner)), _ANY_KIND)
    for forbidden in demand.operator.negative_preconditions:
        predicate, arguments = forbidden.pattern
        yield False, predicate, tuple(map(argument, arguments))


def _match_operator(operator: Operator, pattern: Pattern, arguments: tuple[Argument | Kinds, ...], world: World) -> Demand | None:
    """The operator, bound so that the pattern of its effect matches the subgoal's arguments; None if they do not match, or no object is of
    the types that a variable then has."""
    values: dict[str, Argument] = {}
    kinds: dict[str, Kinds] = {}
    for pattern_term, argument in zip(pattern[1], arguments, strict=False):
        if isinstance(pattern_term, Variable):
            if not pattern_term.name or "." in pattern_term.name:
                continue  # any partner; or the current value of an attribute, which the goal does not determine
            types = operator.types.get(pattern_term.name, _ANY_KIND)
            if isinstance(argument, frozenset):
                kinds[pattern_term.name] = kinds.get(pattern_term.name, types) | argument
            elif values.setdefault(pattern_term.name, argument) != argument or not world.is_eligible(argument, types):
                return None
        elif isinstance(argument, frozenset):
            if isinstance(pattern_term, str) and not world.is_eligible(pattern_term, argument):
                return None
        elif isinstance(pattern_term, str) and pattern_term != argument:
            return None
    for name, value in values.items():
        if not world.is_eligible(value, kinds.pop(name, ())):
            return None
    narrowest = {name: world.narrowest(required_kinds) for name, required_kinds in kinds.items()}
    if not all(map(world.has_domain, narrowest.values())):
        return None
    new_kinds = ((name, required_kinds - operator.types.get(name, _ANY_KIND)) for name, required_kinds in narrowest.items())
    return Demand(operator, tuple(sorted(values.items(), key=_name)), tuple(sorted((n, k) for n, k in new_kinds if k)))


def _name(item: tuple[str, object]) -> str:
    return item[0]


def _fact_bound_variables(operator: Operator) -> Iterator[str]:
    """The variables that the operator's preconditions and static relations bind."""
    for predicate, arguments in operator.preconditions:
        if predicate != KNOWN:
            yield from (argument.name for argument in arguments if isinstance(argument, Variable))
    for literal in operator.static_conditions:
        if isinstance(literal, Relation):
            yield from variables(literal)
