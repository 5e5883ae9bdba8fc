"""Reports about objects of neighbours that are not shown here, such as the pose of a neighbour's robot that works for a task here."""

from __future__ import annotations

from collections.abc import Container, Iterator

from somrs.entish.formula import Formula, Name, Not, Relation, conjunction, conjuncts, names
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.map import Map
from somrs.ontology.qualified_names import SEPARATOR, home_of
from somrs.ontology.types import Ontology
from somrs.repository.association import exclusive_relations
from somrs.repository.reports import location_facts


def shown_situation(text: str | None, map: Map, ontology: Ontology, homes: Container[str]) -> str | None:
    """The situation without what it says about objects of these `homes` that are not on the map; None if nothing remains.

    Where it puts another object there, it only says that the object is not where the map has it.
    """
    if text is None or SEPARATOR not in text:
        return text
    try:
        situation = parse(text)
    except FormulaError:
        return text  # whoever reads it says what is wrong
    parts = conjuncts(situation)
    hidden_parts = {part for part in parts if any(home_of(name) in homes and name not in map.objects for name in names(part))}
    if not hidden_parts:
        return text
    shown_parts: list[Formula] = []
    for part in parts:
        shown_parts += _departure(part, map, ontology) if part in hidden_parts else (part,)
    return str(conjunction(*shown_parts)) if shown_parts else None


def _departure(part: Formula, map: Map, ontology: Ontology) -> Iterator[Formula]:
    """That the object which the part puts somewhere is not where the map has it."""
    if isinstance(part, Relation) and part.relation in {*exclusive_relations(ontology)}:
        for fact in location_facts(str(part.arguments[0]), map, ontology):
            yield Not(Relation(fact.relation, tuple(Name(argument) for argument in fact.arguments)))
