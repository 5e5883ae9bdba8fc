"""Answers of a moment ago: a task that is stated again on the same facts is not planned again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from somrs.entish import Attribute, Call, Comparison, Formula, Not, Relation
from somrs.entish.formula import literals, terms
from somrs.entish.parse import parse
from somrs.ontology.objects import Change, FactAdded, FactRemoved, Map, ValueSet, differences
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem

SIZE = 32
"""So many answers are kept, the last ones."""

Question = tuple[Formula, Formula | None, tuple[tuple[ServiceType, tuple[str, ...]], ...], frozenset[str], bool]
"""What services cost is not in it: a plan stays one when prices move."""


@dataclass(frozen=True, slots=True)
class _Answer:
    """What was found, and on which map; it is about these relations, and these attributes with a dot before them."""

    ontology: Ontology
    map: Map
    subjects: frozenset[str]
    result: Plan | NoPlan


class PlanCache:
    """What was found for the last problems."""

    def __init__(self) -> None:
        self._answers: dict[Question, _Answer] = {}

    def store(self, problem: Problem, result: Plan | NoPlan) -> None:
        """Remember the answer, unless it is that none was found in time."""
        if isinstance(result, NoPlan) and result.undecided:
            return
        self._answers.pop(_question(problem), None)
        self._answers[_question(problem)] = _Answer(problem.ontology, problem.map, frozenset(_find_subjects(problem)), result)
        if len(self._answers) > SIZE:
            del self._answers[next(iter(self._answers))]

    def recall(self, problem: Problem) -> Plan | NoPlan | None:
        """The answer that was found on the same facts, whatever else has changed on the map."""
        answer = self._answers.get(_question(problem))
        if answer is None or answer.ontology is not problem.ontology:
            return None
        is_unchanged = not any(_matters(change, answer.subjects) for change in differences(answer.map, problem.map))
        return answer.result if is_unchanged else None


def _question(problem: Problem) -> Question:
    services = tuple((available.service_type, available.providers) for available in problem.services)
    return problem.goal, problem.precondition, services, problem.excluded, problem.hurry


def _matters(change: Change, subjects: frozenset[str]) -> bool:
    match change:
        case FactAdded(fact) | FactRemoved(fact):
            return fact.relation in subjects
        case ValueSet(_, path):
            return "." + path in subjects
    return True  # an object came or went


def _find_subjects(problem: Problem) -> Iterator[str]:
    """The relations and attributes that the problem's formulas speak of, and the relations that end with those."""
    formulas = [problem.goal, *([problem.precondition] if problem.precondition is not None else [])]
    for available in problem.services:
        service = available.service_type
        formulas += [parse(text) for text in (service.precondition, service.effect) if text is not None]
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
"""What a function that SO-MRS computes, `distance`, reads."""
