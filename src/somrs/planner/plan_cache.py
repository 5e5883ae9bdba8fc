"""A cache of planning results: a task that is submitted again on the same facts is not planned again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from somrs.entish import Attribute, Call, Comparison, Formula, Not, Relation
from somrs.entish.formula import literals, terms
from somrs.entish.parse import parse
from somrs.ontology.differences import differences
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, FactAdded, FactRemoved, ValueSet
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem

SIZE = 32
"""The number of results to keep; the oldest is dropped first."""

Question = tuple[Formula, Formula | None, tuple[tuple[ServiceType, tuple[str, ...]], ...], frozenset[str], frozenset[str], bool, int]
"""The cache key of a problem. It leaves prices out: a plan stays valid when prices change."""


@dataclass(frozen=True, slots=True)
class _Answer:
    """A result, the map that it was found on, and the relations and attributes (with a leading dot) that it depends on (`subjects`)."""

    ontology: Ontology
    map: Map
    subjects: frozenset[str]
    result: Plan | NoPlan


class PlanCache:
    """The results of the latest problems."""

    def __init__(self) -> None:
        self._answers: dict[Question, _Answer] = {}

    def store(self, problem: Problem, result: Plan | NoPlan) -> None:
        """Store the result, unless it is undecided, or depends on bids."""
        if problem.bids or (isinstance(result, NoPlan) and result.undecided):
            return
        self._answers.pop(_question(problem), None)
        self._answers[_question(problem)] = _Answer(problem.ontology, problem.map, frozenset(_find_subjects(problem)), result)
        if len(self._answers) > SIZE:
            del self._answers[next(iter(self._answers))]

    def recall(self, problem: Problem) -> Plan | NoPlan | None:
        """The stored result, if all facts that it depends on are unchanged on the map; else None."""
        answer = self._answers.get(_question(problem)) if not problem.bids else None
        if answer is None or answer.ontology is not problem.ontology:
            return None
        is_unchanged = not any(_matters(change, answer.subjects) for change in differences(answer.map, problem.map))
        return answer.result if is_unchanged else None


def _question(problem: Problem) -> Question:
    services = tuple((available.service_type, available.providers) for available in problem.services)
    return problem.goal, problem.precondition, services, problem.excluded, problem.unknown, problem.hurry, problem.most_plans


def _matters(change: Change, subjects: frozenset[str]) -> bool:
    match change:
        case FactAdded(fact) | FactRemoved(fact):
            return fact.relation in subjects
        case ValueSet(_, path):
            return "." + path in subjects
    return True  # an object was added or removed


def _find_subjects(problem: Problem) -> Iterator[str]:
    """The relations and attributes that occur in the problem's formulas, and the relations that exclude those."""
    formulas = [problem.goal, *([problem.precondition] if problem.precondition is not None else [])]
    for available in problem.services:
        service = available.service_type
        formulas += [parse(text) for text in (service.start_condition, service.effect) if text is not None]
    relations = problem.ontology.relations
    for predicate in set(_mentioned_predicates(formulas, problem.ontology)):
        yield predicate
        relation_type = relations.get(predicate)
        if relation_type is not None and relation_type.excludes is not None:
            yield from (relation.name for relation in relations.values() if relation.excludes == relation_type.excludes)


def _mentioned_predicates(formulas: Iterable[Formula], ontology: Ontology) -> Iterator[str]:
    for formula in formulas:
        for literal in literals(formula):
            match literal.atom if isinstance(literal, Not) else literal:
                case Relation(name):
                    yield name
                case Comparison() as comparison:
                    for term in terms(comparison):
                        if isinstance(term, Attribute):
                            yield "." + term.path
                        elif isinstance(term, Call):
                            function = ontology.functions.get(term.function)
                            read = [function.attribute] if function is not None and function.attribute is not None else POSITION
                            yield from ("." + path for path in read)


POSITION = ["PositionX", "PositionY", "PositionZ"]
"""The attributes that the built-in function `distance` reads."""
