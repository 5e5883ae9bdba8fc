"""From a sequence of steps to a partial order: causal links to the steps that achieve conditions, and protection from steps that undo
them."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Relation, Term, Variable
from somrs.entish.formula import Literal, conjuncts, substitute, terms, variables
from somrs.ontology.map import Map
from somrs.ontology.truth import bindings, formula_holds
from somrs.ontology.types import Ontology
from somrs.ontology.values import measure
from somrs.planner.model.plan import Link, Step
from somrs.planner.model.problem import Problem
from somrs.planner.model.supporting_literals import supporting_literals


def derive_links(steps: Sequence[Step], maps: Sequence[Map], problem: Problem, written: Sequence[Formula | None] = ()) -> tuple[Link, ...]:
    """The links among steps that can be executed in the given order. `maps` are the map before the first step and the map after each step,
    `written` the steps' effects before their terms were evaluated.

    For each condition of a step, a causal link leads from the last earlier step that achieves it. A step that could undo the condition
    comes before the achieving step or after the step with the condition (Penberthy and Weld 1992). The goal counts as the condition of a
    final step.
    """
    if len(steps) < 2:
        return ()
    support_table = _SupportTable(steps, maps, problem.ontology)
    causal: dict[tuple[int, int], dict[str, None]] = {}
    protections: dict[tuple[int, int], Literal] = {}
    for place, condition in _conditions(steps, maps, problem, written or _outcomes(steps)):
        support = support_table.find_support(condition)
        supporter = support.supporter(place)
        if supporter >= 0 and place < len(steps):
            causal.setdefault((supporter, place), {})[str(condition)] = None
        for n in support.deleters:
            if n < supporter:
                protections.setdefault((n, supporter), condition)
            elif n > place:
                protections.setdefault((place, n), condition)
            elif n < place < len(steps):
                protections.setdefault((n, place), condition)
    links = [Link(steps[producer].id, steps[consumer].id, fact) for (producer, consumer), facts in causal.items() for fact in facts]
    protection_pairs = [pair for pair in _reduce_transitively({*causal, *protections}, len(steps)) if pair not in causal]
    links += [
        Link(steps[first].id, steps[second].id, str(protections[first, second]), is_protection=True) for first, second in protection_pairs
    ]
    place_of = {step.id: number for number, step in enumerate(steps)}
    return tuple(sorted(links, key=lambda link: (place_of[link.after], link.is_protection, place_of[link.before])))


def find_useful_steps(steps: Sequence[Step], maps: Sequence[Map], problem: Problem) -> list[int]:
    """The places of the steps that the goal needs, directly or for other needed steps."""
    support_table = _SupportTable(steps, maps, problem.ontology)
    conditions_by_place: dict[int, list[Literal]] = {}
    for place, condition in _conditions(steps, maps, problem, _outcomes(steps)):
        conditions_by_place.setdefault(place, []).append(condition)
    useful_places: set[int] = set()
    waiting = [len(steps)]
    while waiting:
        place = waiting.pop()
        for condition in conditions_by_place.get(place, ()):
            supporter = support_table.find_support(condition).supporter(place)
            if supporter >= 0 and supporter not in useful_places:
                useful_places.add(supporter)
                waiting.append(supporter)
    return sorted(useful_places)


@dataclass(frozen=True, slots=True)
class _ConditionSupport:
    """The steps that make a condition true, and those after which it may be false, in order."""

    achievers: tuple[int, ...]
    deleters: tuple[int, ...]

    def supporter(self, place: int) -> int:
        """The last step before the place that makes the condition true; -1 if the condition holds from the start."""
        number = bisect_left(self.achievers, place)
        return self.achievers[number - 1] if number else -1


class _SupportTable:
    """The support of each condition, cached. Only steps that share a subject with the condition are examined."""

    def __init__(self, steps: Sequence[Step], maps: Sequence[Map], ontology: Ontology) -> None:
        self._maps, self._ontology = maps, ontology
        self._effects: list[list[Formula]] = [[*conjuncts(step.outcome)] if step.outcome is not None else [] for step in steps]
        self._steps_by_subject: dict[object, list[int]] = {}
        for number, effect in enumerate(self._effects):
            for subject in dict.fromkeys(subject for part in effect for subject in self._subjects(part)):
                self._steps_by_subject.setdefault(subject, []).append(number)
        self._support_cache: dict[Literal, _ConditionSupport] = {}

    def find_support(self, condition: Literal) -> _ConditionSupport:
        if condition not in self._support_cache:
            self._support_cache[condition] = self._compute_support(condition)
        return self._support_cache[condition]

    def _compute_support(self, condition: Literal) -> _ConditionSupport:
        subjects = [*self._subjects(condition)]
        if not variables(condition):
            subjects = [(topic, object) for topic, object in subjects if object is not None]
        candidate_steps = sorted({number for subject in subjects for number in self._steps_by_subject.get(subject, ())})
        touching = [n for n in candidate_steps if any(touches(part, condition, self._ontology) for part in self._effects[n])]
        supporting_steps = [n for n in touching if self._condition_holds(condition, n + 1)]
        held = set(supporting_steps)
        return _ConditionSupport(
            tuple(n for n in supporting_steps if not self._condition_holds(condition, n)), tuple(n for n in touching if n not in held)
        )

    def _condition_holds(self, condition: Literal, number: int) -> bool:
        map = self._maps[number]
        match condition:
            case Relation(name, arguments):
                expected_truth = True
            case Not(Relation(name, arguments)):
                expected_truth = False
            case _:
                return formula_holds(condition, map, self._ontology)
        fact = tuple(argument.name for argument in arguments if isinstance(argument, Name))
        if len(fact) < len(arguments) or name not in self._ontology.relations:
            return formula_holds(condition, map, self._ontology)
        fact_holds = map.has_fact(name, fact) or (self._ontology.relations[name].symmetric and map.has_fact(name, fact[::-1]))
        return fact_holds is expected_truth

    def _subjects(self, part: Formula) -> Iterator[tuple[object, Term | None]]:
        """The subjects of an effect or a condition: a relation or an attribute, with an object or (None) with any object. An effect that
        touches a condition shares a subject with it."""
        match part.atom if isinstance(part, Not) else part:
            case Relation(name, arguments):
                relation = self._ontology.relations.get(name)
                names = (name,) if relation is None or relation.excludes is None else (name, ("excludes", relation.excludes))
                yield from _pair_topics(names, arguments)
            case Comparison() as comparison:
                for term in terms(comparison):
                    if isinstance(term, Attribute):
                        yield from _pair_topics((("attribute", term.path),), (term.owner,))
                    elif isinstance(term, Call) and (function := self._ontology.functions.get(term.function)) is not None:
                        yield from _pair_topics((("attribute", function.attribute),), term.arguments)


def _pair_topics(topics: Iterable[object], objects: Sequence[Term]) -> Iterator[tuple[object, Term | None]]:
    for topic in topics:
        yield from ((topic, object) for object in dict.fromkeys(objects))
        yield topic, None


def _conditions(
    steps: Sequence[Step], maps: Sequence[Map], problem: Problem, written: Sequence[Formula | None]
) -> Iterator[tuple[int, Literal]]:
    """Every condition, with the place of the step that needs it; the goal's conditions have the place after the last step."""
    for place, step in enumerate(steps):
        if step.precondition is not None:
            for part in conjuncts(step.precondition):
                assert isinstance(part, Literal), "a step's precondition is one alternative"
                yield from ((place, condition) for condition in _for_each_object(part, maps, problem.ontology))
        for reading in _readings(written[place]):
            measured = measure(reading, maps[place], problem.ontology)
            if measured is not None:
                yield place, Comparison(reading, "=", measured.constant)
    support = supporting_literals(problem.goal, maps[-1], problem.ontology)
    for literal in support[0] if support is not None else ():
        yield from ((len(steps), condition) for condition in _for_each_object(literal, maps, problem.ontology))


def _for_each_object(literal: Literal, maps: Sequence[Map], ontology: Ontology) -> Iterator[Literal]:
    """`NOT ?x isOn Table1` for each object that is on it on one of the maps: each is a condition by itself."""
    if not isinstance(literal, Not) or not variables(literal):
        yield literal
        return
    rows = (row for map in maps for row in bindings(literal.atom, map, ontology))
    yield from dict.fromkeys(negated for row in rows if isinstance(negated := substitute(literal, row), Literal))


def _outcomes(steps: Sequence[Step]) -> list[Formula | None]:
    return [step.outcome for step in steps]


def _readings(effect: Formula | None) -> Iterator[Term]:
    """The attributes and functions that an effect reads: in `?A.Level = ?B.Level + 2`, the level of ?B. Their values are conditions of the
    step."""
    for part in conjuncts(effect) if effect is not None else ():
        if isinstance(part, Comparison):
            source = part.right if isinstance(part.left, Attribute) else part.left
            yield from (term for term in terms(source) if isinstance(term, Attribute | Call))


def touches(effect: Formula, condition: Literal, ontology: Ontology) -> bool:
    """Whether the effect may change the truth of the condition: both are about a relation or an attribute of the same object."""
    atom = condition.atom if isinstance(condition, Not) else condition
    written = effect.atom if isinstance(effect, Not) else effect
    match written, atom:
        case Relation() as effect_atom, Relation() as condition_atom:
            return _same_fact(effect_atom, condition_atom, ontology) or (
                isinstance(effect, Relation) and _displaces(effect_atom, condition_atom, ontology)
            )
        case Comparison() as effect_atom, Comparison() as condition_atom:
            target = effect_atom.left if isinstance(effect_atom.left, Attribute) else effect_atom.right
            return isinstance(target, Attribute) and any(_reads(term, target, ontology) for term in terms(condition_atom))
    return False


def _reads(term: object, target: Attribute, ontology: Ontology) -> bool:
    match term:
        case Attribute(owner, path):
            return path == target.path and (owner == target.owner or isinstance(owner, Variable))
        case Call(name, arguments):
            function = ontology.functions.get(name)
            mine = any(argument == target.owner or isinstance(argument, Variable) for argument in arguments)
            return function is not None and function.attribute == target.path and mine
    return False


def _matches(effect_arguments: tuple[Name | Variable, ...], condition_arguments: tuple[Name | Variable, ...]) -> bool:
    return len(effect_arguments) == len(condition_arguments) and all(
        isinstance(w, Variable) or m == w for m, w in zip(effect_arguments, condition_arguments, strict=True)
    )


def _same_fact(effect_atom: Relation, condition_atom: Relation, ontology: Ontology) -> bool:
    relation = ontology.relations.get(effect_atom.relation)
    if effect_atom.relation != condition_atom.relation or relation is None:
        return False
    return _matches(effect_atom.arguments, condition_atom.arguments) or (
        relation.symmetric and _matches(effect_atom.arguments[::-1], condition_atom.arguments)
    )


def _displaces(effect_atom: Relation, condition_atom: Relation, ontology: Ontology) -> bool:
    """Whether an object that enters the relation of the effect leaves the relation of the condition."""
    effect_relation, condition_relation = ontology.relations.get(effect_atom.relation), ontology.relations.get(condition_atom.relation)
    if effect_relation is None or condition_relation is None:
        return False
    is_displaced = (
        effect_relation.functional
        if effect_relation.name == condition_relation.name
        else effect_relation.excludes is not None and effect_relation.excludes == condition_relation.excludes
    )
    losing = condition_atom.arguments if condition_relation.symmetric else condition_atom.arguments[:1]
    return is_displaced and any(isinstance(argument, Variable) or argument == effect_atom.arguments[0] for argument in losing)


def _reduce_transitively(pairs: Iterable[tuple[int, int]], count: int) -> Iterator[tuple[int, int]]:
    """The transitive reduction of the pairs of ordered steps."""
    successors: list[list[int]] = [[] for _ in range(count)]
    for first, second in pairs:
        successors[first].append(second)
    descendants = [0] * count
    """For each step, the bit set of the steps after it."""
    for first in reversed(range(count)):
        for second in sorted(successors[first]):  # an indirect order leads through a step before `second`
            if not descendants[first] >> second & 1:
                yield first, second
                descendants[first] |= descendants[second] | 1 << second
