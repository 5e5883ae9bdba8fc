"""From a sequence of steps to the order that is needed: who brings about what a step needs, and who must not undo it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Or, Relation, Term, Variable
from somrs.entish.formula import Literal, alternatives, conjunction, conjuncts, substitute, terms
from somrs.ontology.objects import Map
from somrs.ontology.truth import bindings, holds
from somrs.ontology.types import Ontology
from somrs.ontology.values import measure
from somrs.planner.plan import Link, Step
from somrs.planner.problem import Problem


def linked(steps: Sequence[Step], maps: Sequence[Map], problem: Problem) -> tuple[Link, ...]:
    """The links among steps that can be done in the order given; `maps` are the one before the first, and those after each.

    For each condition of a step, the last step before it that brings it about comes before it (the causal link); a step
    that could undo it comes before that one or after it (Penberthy and Weld 1992). The goal is the last step's condition.
    """
    if len(steps) < 2:
        return ()
    found: dict[Link, None] = {}
    effects = [conjuncts(step.effect) for step in steps]
    for place, condition in _conditions(steps, maps, problem):
        touching = [n for n, effect in enumerate(effects) if any(touches(part, condition, problem.ontology) for part in effect)]
        makes = {n for n in touching if holds(condition, maps[n + 1], problem.ontology)}
        supporter = max((n for n in makes if n < place and not holds(condition, maps[n], problem.ontology)), default=-1)
        if supporter >= 0 and place < len(steps):
            found[Link(steps[supporter].id, steps[place].id, str(condition))] = None
        for n in touching:
            if n == place or n in makes:
                continue
            if n < supporter:
                found[Link(steps[n].id, steps[supporter].id, str(condition), keeps=True)] = None
            elif n > place:
                found[Link(steps[place].id, steps[n].id, str(condition), keeps=True)] = None
            elif place < len(steps):
                found[Link(steps[n].id, steps[place].id, str(condition), keeps=True)] = None
    return tuple(_needed(list(found), steps))


def _conditions(steps: Sequence[Step], maps: Sequence[Map], problem: Problem) -> Iterator[tuple[int, Literal]]:
    """Every condition, with the place of the step that needs it; the goal's come behind the last step."""
    for place, step in enumerate(steps):
        if step.precondition is not None:
            for part in conjuncts(step.precondition):
                assert not isinstance(part, Or), "a step's precondition is one alternative"
                yield place, part  # type: ignore[misc]  # conjuncts of a conjunction of literals
        for reading in _readings(step.effect):
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
    """What an effect copies: of `?A.Level = ?B.Level`, the level of ?B, which has to be what it is by then."""
    for part in conjuncts(effect):
        if isinstance(part, Comparison):
            source = part.right if isinstance(part.left, Attribute) else part.left
            if isinstance(source, Attribute | Call):
                yield source


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
            return path == target.path and (of == target.of or isinstance(of, Variable))
        case Call(name, arguments):
            function = ontology.functions.get(name)
            return function is not None and function.attribute == target.path and target.of in arguments
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


def _needed(links: list[Link], steps: Sequence[Step]) -> Iterator[Link]:
    """The links without orders that the others give already; causal links all stay, because they say why."""
    place = {step.id: number for number, step in enumerate(steps)}
    after: dict[str, set[str]] = {step.id: set() for step in steps}
    for link in links:
        after[link.before].add(link.after)
    beyond: dict[str, int] = {}
    """For each step the steps that come somewhere after it, as bits."""
    for step in reversed(steps):
        beyond[step.id] = 0
        for next_ in after[step.id]:
            beyond[step.id] |= beyond[next_] | 1 << place[next_]
    causal = {(link.before, link.after) for link in links if not link.keeps}
    said: set[tuple[str, str]] = set()
    for link in links:
        pair = link.before, link.after
        if not link.keeps:
            yield link
        elif pair not in causal | said and not any(beyond[other] >> place[link.after] & 1 for other in after[link.before]):
            said.add(pair)
            yield link
