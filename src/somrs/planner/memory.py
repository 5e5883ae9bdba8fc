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
    about: frozenset[str]
    found: Plan | NoPlan


class Memory:
    """What was found for the last problems."""

    def __init__(self) -> None:
        self._answers: dict[Question, _Answer] = {}

    def keep(self, problem: Problem, found: Plan | NoPlan) -> None:
        """Remember the answer, unless it is that none was found in time."""
        if isinstance(found, NoPlan) and found.undecided:
            return
        self._answers.pop(_question(problem), None)
        self._answers[_question(problem)] = _Answer(problem.ontology, problem.map, frozenset(_about(problem)), found)
        if len(self._answers) > SIZE:
            del self._answers[next(iter(self._answers))]

    def recall(self, problem: Problem) -> Plan | NoPlan | None:
        """The answer that was found on the same facts, whatever else has changed on the map."""
        answer = self._answers.get(_question(problem))
        if answer is None or answer.ontology is not problem.ontology:
            return None
        same = not any(_matters(change, answer.about) for change in differences(answer.map, problem.map))
        return answer.found if same else None


def _question(problem: Problem) -> Question:
    services = tuple((available.service_type, available.providers) for available in problem.services)
    return problem.goal, problem.precondition, services, problem.excluded, problem.hurry


def _matters(change: Change, about: frozenset[str]) -> bool:
    match change:
        case FactAdded(fact) | FactRemoved(fact):
            return fact.relation in about
        case ValueSet(_, path):
            return "." + path in about
    return True  # an object came or went


def _about(problem: Problem) -> Iterator[str]:
    """The relations and attributes that the problem's formulas speak of, and the relations that end with those."""
    formulas = [problem.goal, *([problem.precondition] if problem.precondition is not None else [])]
    for available in problem.services:
        service = available.service_type
        formulas += [parse(text) for text in (service.precondition, service.effect) if text is not None]
    relations = problem.ontology.relations
    for spoken in set(_spoken(formulas, problem.ontology)):
        yield spoken
        known = relations.get(spoken)
        if known is not None and known.excludes is not None:
            yield from (other.name for other in relations.values() if other.excludes == known.excludes)


def _spoken(formulas: Iterable[Formula], ontology: Ontology) -> Iterator[str]:
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
