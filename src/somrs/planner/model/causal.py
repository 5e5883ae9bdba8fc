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


def linked(steps: Sequence[Step], maps: Sequence[Map], problem: Problem, written: Sequence[Formula] = ()) -> tuple[Link, ...]:
    """The links among steps that can be done in the order given; `maps` are the one before the first, and those after each,
    `written` the steps' effects before anything was calculated in them.

    For each condition of a step, the last step before it that brings it about comes before it (the causal link); a step
    that could undo it comes before that one or after it (Penberthy and Weld 1992). The goal is the last step's condition.
    """
    if len(steps) < 2:
        return ()
    fates = _Fates(steps, maps, problem.ontology)
    causal: dict[tuple[int, int], dict[str, None]] = {}
    keeps: dict[tuple[int, int], Literal] = {}
    for place, condition in _conditions(steps, maps, problem, written or [step.effect for step in steps]):
        fate = fates.of(condition)
        supporter = fate.supporter(place)
        if supporter >= 0 and place < len(steps):
            causal.setdefault((supporter, place), {})[str(condition)] = None
        for n in fate.spoilers:
            if n < supporter:
                keeps.setdefault((n, supporter), condition)
            elif n > place:
                keeps.setdefault((place, n), condition)
            elif n < place < len(steps):
                keeps.setdefault((n, place), condition)
    links = [Link(steps[one].id, steps[other].id, fact) for (one, other), facts in causal.items() for fact in facts]
    needed = [pair for pair in _needed({*causal, *keeps}, len(steps)) if pair not in causal]
    links += [Link(steps[one].id, steps[other].id, str(keeps[one, other]), keeps=True) for one, other in needed]
    place_of = {step.id: number for number, step in enumerate(steps)}
    return tuple(sorted(links, key=lambda link: (place_of[link.after], link.keeps, place_of[link.before])))


def useful(steps: Sequence[Step], maps: Sequence[Map], problem: Problem) -> list[int]:
    """The places of the steps that the goal needs, or others that it needs."""
    fates = _Fates(steps, maps, problem.ontology)
    needs: dict[int, list[Literal]] = {}
    for place, condition in _conditions(steps, maps, problem, [step.effect for step in steps]):
        needs.setdefault(place, []).append(condition)
    found: set[int] = set()
    waiting = [len(steps)]
    while waiting:
        place = waiting.pop()
        for condition in needs.get(place, ()):
            supporter = fates.of(condition).supporter(place)
            if supporter >= 0 and supporter not in found:
                found.add(supporter)
                waiting.append(supporter)
    return sorted(found)


@dataclass(frozen=True, slots=True)
class _Fate:
    """What becomes of a condition: the steps that bring it about where it was not so, and those after which it may not be so."""

    makers: tuple[int, ...]
    spoilers: tuple[int, ...]

    def supporter(self, place: int) -> int:
        """The last step before the place that brings it about; -1 when it is so from the start."""
        number = bisect_left(self.makers, place)
        return self.makers[number - 1] if number else -1


class _Fates:
    """The fate of each condition, found once, from the steps that speak of what it speaks of."""

    def __init__(self, steps: Sequence[Step], maps: Sequence[Map], ontology: Ontology) -> None:
        self._maps, self._ontology = maps, ontology
        self._effects: list[list[Formula]] = [[*conjuncts(step.effect)] for step in steps]
        self._about: dict[object, list[int]] = {}
        for number, effect in enumerate(self._effects):
            for subject in dict.fromkeys(subject for part in effect for subject in self._subjects(part)):
                self._about.setdefault(subject, []).append(number)
        self._known: dict[Literal, _Fate] = {}

    def of(self, condition: Literal) -> _Fate:
        if condition not in self._known:
            self._known[condition] = self._find(condition)
        return self._known[condition]

    def _find(self, condition: Literal) -> _Fate:
        subjects = [*self._subjects(condition)]
        if not variables(condition):
            subjects = [(what, object) for what, object in subjects if object is not None]
        near = sorted({number for subject in subjects for number in self._about.get(subject, ())})
        touching = [n for n in near if any(touches(part, condition, self._ontology) for part in self._effects[n])]
        so = [n for n in touching if self._holds(condition, n + 1)]
        held = set(so)
        return _Fate(tuple(n for n in so if not self._holds(condition, n)), tuple(n for n in touching if n not in held))

    def _holds(self, condition: Literal, number: int) -> bool:
        map = self._maps[number]
        match condition:
            case Relation(name, arguments):
                wanted = True
            case Not(Relation(name, arguments)):
                wanted = False
            case _:
                return formula_holds(condition, map, self._ontology)
        fact = tuple(argument.name for argument in arguments if isinstance(argument, Name))
        if len(fact) < len(arguments) or name not in self._ontology.relations:
            return formula_holds(condition, map, self._ontology)
        there = map.has_fact(name, fact) or (self._ontology.relations[name].symmetric and map.has_fact(name, fact[::-1]))
        return there is wanted

    def _subjects(self, part: Formula) -> Iterator[tuple[object, Term | None]]:
        """What it is about: what touches a condition shares one of its subjects. Effects have the objects in them that they are about;
        a condition with a variable is about the same of any object."""
        match part.atom if isinstance(part, Not) else part:
            case Relation(name, arguments):
                relation = self._ontology.relations.get(name)
                names = (name,) if relation is None or relation.excludes is None else (name, ("excludes", relation.excludes))
                yield from _about(names, arguments)
            case Comparison() as comparison:
                for term in terms(comparison):
                    if isinstance(term, Attribute):
                        yield from _about((("attribute", term.path),), (term.owner,))
                    elif isinstance(term, Call) and (function := self._ontology.functions.get(term.function)) is not None:
                        yield from _about((("attribute", function.attribute),), term.arguments)


def _about(what: Iterable[object], objects: Sequence[Term]) -> Iterator[tuple[object, Term | None]]:
    for one in what:
        yield from ((one, object) for object in dict.fromkeys(objects))
        yield one, None


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
        case Relation() as made, Relation() as wanted:
            return _same_fact(made, wanted, ontology) or (isinstance(effect, Relation) and _displaces(made, wanted, ontology))
        case Comparison() as made, Comparison() as wanted:
            target = made.left if isinstance(made.left, Attribute) else made.right
            return isinstance(target, Attribute) and any(_reads(term, target, ontology) for term in terms(wanted))
    return False


def _reads(term: object, target: Attribute, ontology: Ontology) -> bool:
    match term:
        case Attribute(of, path):
            return path == target.path and (of == target.owner or isinstance(of, Variable))
        case Call(name, arguments):
            function = ontology.functions.get(name)
            mine = any(argument == target.owner or isinstance(argument, Variable) for argument in arguments)
            return function is not None and function.attribute == target.path and mine
    return False


def _matches(made: tuple[Name | Variable, ...], wanted: tuple[Name | Variable, ...]) -> bool:
    return len(made) == len(wanted) and all(isinstance(w, Variable) or m == w for m, w in zip(made, wanted, strict=True))


def _same_fact(made: Relation, wanted: Relation, ontology: Ontology) -> bool:
    relation = ontology.relations.get(made.relation)
    if made.relation != wanted.relation or relation is None:
        return False
    return _matches(made.arguments, wanted.arguments) or (relation.symmetric and _matches(made.arguments[::-1], wanted.arguments))


def _displaces(made: Relation, wanted: Relation, ontology: Ontology) -> bool:
    """Whether the object that enters into the one relation leaves the other."""
    one, other = ontology.relations.get(made.relation), ontology.relations.get(wanted.relation)
    if one is None or other is None:
        return False
    gives_up = one.functional if one.name == other.name else one.excludes is not None and one.excludes == other.excludes
    losing = wanted.arguments if other.symmetric else wanted.arguments[:1]
    return gives_up and any(isinstance(argument, Variable) or argument == made.arguments[0] for argument in losing)


def _needed(pairs: Iterable[tuple[int, int]], count: int) -> Iterator[tuple[int, int]]:
    """The pairs without orders that the others give already."""
    after: list[list[int]] = [[] for _ in range(count)]
    for one, other in pairs:
        after[one].append(other)
    beyond = [0] * count
    """For each step the steps that come somewhere after it, as bits."""
    for one in reversed(range(count)):
        for other in sorted(after[one]):  # a way round leads through a step that comes before the other
            if not beyond[one] >> other & 1:
                yield one, other
                beyond[one] |= beyond[other] | 1 << other
