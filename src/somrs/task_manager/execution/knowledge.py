"""What a step tells: what a cognitive service finds out, and what the outputs of a service are (paper, "Services")."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from somrs.entish import Attribute, Comparison, Formula, Name, Relation
from somrs.entish.formula import conjunction, conjuncts, names
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.types import UNKNOWN, Ontology, Value
from somrs.ontology.values import constant, value_of
from somrs.planner.model.plan import Step
from somrs.task_manager.execution.workflow import StepRun


def told(run: StepRun, map: Map, ontology: Ontology) -> bool:
    """Whether the step has told anything that it had to tell; of a step of which the plan assumes nothing, that it is completed."""
    answers = [*_answers(run, map, ontology)]
    return any(answers) or not answers


def told_all(run: StepRun, map: Map, ontology: Ontology) -> bool:
    """Whether the step has told all that it had to tell."""
    return all(_answers(run, map, ontology))


def subjects(step: Step) -> tuple[str, ...]:
    """What the step is to tell: objects whose place and state it finds out, attributes, and facts about outputs."""
    return tuple(dict.fromkeys(_subject(part) for part in conjuncts(step.effect))) if step.tells else ()


def relevant_parts(run: StepRun, situation: str) -> str | None:
    """The parts of a reported situation about the objects of the step, without their exact poses; None if there are none."""
    objects = {name for term in run.step.inputs.values() for name in names(term)} | set(run.outputs.values())
    parts = [part for part in conjuncts(parse(situation)) if not objects.isdisjoint(_concerned(part)) and not _is_pose(part)]
    return str(conjunction(*parts)) if parts else None


def _concerned(part: Formula) -> tuple[str, ...]:
    """The objects that the part says something about: all that it relates, or the owner of its attribute."""
    return names(part) if isinstance(part, Relation) else names(part)[:1]


def _is_pose(part: Formula) -> bool:
    return isinstance(part, Comparison) and isinstance(part.left, Attribute) and part.left.path.startswith(("Position", "Rotation"))


def output_texts(outputs: Mapping[str, Value]) -> dict[str, str]:
    """Outputs as text: the names of objects and texts as they are, numbers and truth values as in Entish."""
    return {name: value if isinstance(value, str) else str(constant(value, None)) for name, value in outputs.items()}


def _subject(part: Formula) -> str:
    match part:
        case Comparison(Attribute(owner, path)):
            return str(owner) if path == UNKNOWN else f"{owner}.{path}"
    return str(part)


def _answers(run: StepRun, map: Map, ontology: Ontology) -> Iterator[bool]:
    if any(name not in map.objects for name in run.step.finds):
        yield bool(run.outputs)
    for part in conjuncts(run.step.assumed) if run.step.assumed is not None else ():
        match part:
            case Comparison(Attribute(Name(name), path)) if name in map.objects:
                value = value_of(name, path, map, ontology)
                yield value is not True if path == UNKNOWN else value is not None
            case Relation(relation, arguments) if names(part) and arguments[0].name in map.objects:
                excluded = ontology.relations[relation].excludes
                group = [other.name for other in ontology.relations.values() if excluded is not None and other.excludes == excluded]
                yield not group or any(map.facts_with(other, 0, arguments[0].name) for other in group)
