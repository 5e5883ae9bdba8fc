"""From a sequence of steps to the order that is needed: who brings about what a step needs, and who must not undo it."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Or, Relation, Term, Variable
from somrs.entish.formula import Literal, alternatives, conjunction, conjuncts, substitute, terms, variables
from somrs.ontology.objects import Map
from somrs.ontology.truth import bindings, formula_holds
from somrs.ontology.types import Ontology
from somrs.ontology.values import measure
from somrs.planner.model.plan import Link, Step
from somrs.planner.model.problem import Problem


def derive_links(steps: Sequence[Step], maps: Sequence[Map], problem: Problem, written: Sequence[Formula] = ()) -> tuple[Link, ...]:
    """The links among steps that can be done in the order given; `maps` are the one before the first, and those after each,
    `written` the steps' effects before anything was calculated in them.

    For each condition of a step, the last step before it that brings it about comes before it (the causal link); a step
    that could undo it comes before that one or after it (Penberthy and Weld 1992). The goal is the last step's condition.
    """
    if len(steps) < 2:
        return ()
    support_table = _SupportTable(steps, maps, problem.ontology)
    causal: dict[tuple[int, int], dict[str, None]] = {}
    protections: dict[tuple[int, int], Literal] = {}
    for place, condition in _conditions(steps, maps, problem, written or [step.effect for step in steps]):
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
    """The places of the steps that the goal needs, or others that it needs."""
    support_table = _SupportTable(steps, maps, problem.ontology)
    conditions_by_place: dict[int, list[Literal]] = {}
    for place, condition in _conditions(steps, maps, problem, [step.effect for step in steps]):
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
    """What becomes of a condition: the steps that bring it about where it was not so, and those after which it may not be so."""

    achievers: tuple[int, ...]
    deleters: tuple[int, ...]

    def supporter(self, place: int) -> int:
        """The last step before the place that brings it about; -1 when it is so from the start."""
        number = bisect_left(self.achievers, place)
        return self.achievers[number - 1] if number else -1


class _SupportTable:
    """The fate of each condition, found once, from the steps that speak of what it speaks of."""

    def __init__(self, steps: Sequence[Step], maps: Sequence[Map], ontology: Ontology) -> None:
        self._maps, self._ontology = maps, ontology
        self._effects: list[list[Formula]] = [[*conjuncts(step.effect)] for step in steps]
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
        """What it is about: what touches a condition shares one of its subjects. Effects have the objects in them that they are about;
        a condition with a variable is about the same of any object."""
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


def _conditions(steps: Sequence[Step], maps: Sequence[Map], problem: Problem, written: Sequence[Formula]) -> Iterator[tuple[int, Literal]]:
    """Every condition, with the place of the step that needs it; the goal's come behind the last step."""
    for place, step in enumerate(steps):
        if step.precondition is not None:
            for part in conjuncts(step.precondition):
                assert not isinstance(part, Or), "a step's precondition is one alternative"
                yield place, part  # type: ignore[misc]  # conjuncts of a conjunction of literals
        for reading in _readings(written[place]):
            measured = measure(reading, maps[place], problem.ontology)
            if measured is not None:
                yield place, Comparison(reading, "=", measured.constant)
    for branch in alternatives(problem.goal):
        row = next((row for row in bindings(conjunction(*branch), maps[-1], problem.ontology)), None)
        if row is not None:
            for literal in branch:
                yield len(steps), substitute(literal, row)  # type: ignore[misc]
            return


def _readings(effect: Formula) -> Iterator[Term]:
    """What an effect is made of: of `?A.Level = ?B.Level + 2`, the level of ?B, which has to be what it is by then."""
    for part in conjuncts(effect):
        if isinstance(part, Comparison):
            source = part.right if isinstance(part.left, Attribute) else part.left
            yield from (term for term in terms(source) if isinstance(term, Attribute | Call))


def touches(effect: Formula, condition: Literal, ontology: Ontology) -> bool:
    """Whether the effect may change if the condition holds: both are about one relation of one object, or one attribute."""
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
    """Whether the object that enters into the one relation leaves the other."""
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
    """The pairs without orders that the others give already."""
    successors: list[list[int]] = [[] for _ in range(count)]
    for first, second in pairs:
        successors[first].append(second)
    descendants = [0] * count
    """For each step the steps that come somewhere after it, as bits."""
    for first in reversed(range(count)):
        for second in sorted(successors[first]):  # a way round leads through a step that comes before the other
            if not descendants[first] >> second & 1:
                yield first, second
                descendants[first] |= descendants[second] | 1 << second
