"""What a device of a symbolic world recognises: what the simulated cameras do, without geometry and noise.

Things and robots have no names on them: they are reported by type, colour, form, size and pose, as typed variables, and the Repository
finds out which objects of the map they are. Everything else is a landmark, which is known by name.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from somrs.entish import Attribute, Comparison, Formula, Name, Term, Variable
from somrs.entish.formula import conjunction, conjuncts, substitute
from somrs.ontology.map import Map
from somrs.ontology.truth import bindings
from somrs.ontology.types import Ontology
from somrs.ontology.values import constant, value_of

RECOGNISED = ("Graspable", "MobileRobot")
"""The types of the objects that are recognised by their looks."""
LOOKS = ("Color", "Shape", "Position", "RotationZ")
"""Beginnings of the attributes by which they are recognised."""
SEEN = "Seen"
"""The variable of a sighting is this word with its number."""
MOST_SIGHTINGS = 100


def recognised_situation(effect: Formula, map: Map, ontology: Ontology) -> str | None:
    """What is so of the effect of a cognitive service whose inputs are filled in; None if there is nothing.

    The variables that are left are its outputs: the situation has all objects and values for which the effect holds.
    """
    sightings: dict[str, Variable] = {}
    parts: dict[Formula, None] = {}
    for row in islice(bindings(effect, map, ontology), MOST_SIGHTINGS):
        terms = {name: _sighted(term, sightings, map, ontology) for name, term in row.items()}
        parts.update(dict.fromkeys(conjuncts(substitute(effect, terms))))
    for name, variable in sightings.items():
        parts.update(dict.fromkeys(_looks(name, variable, map, ontology)))
    return str(conjunction(*parts)) if parts else None


def _sighted(term: Term, sightings: dict[str, Variable], map: Map, ontology: Ontology) -> Term:
    """The variable of an object that has no name on it; any other term as it is."""
    object = map.objects.get(term.name) if isinstance(term, Name) else None
    if object is None or not any(ontology.is_subtype(object.type, type_name) for type_name in RECOGNISED if type_name in ontology.types):
        return term
    return sightings.setdefault(object.name, Variable(f"{SEEN}{len(sightings)}", object.type))


def _looks(name: str, variable: Variable, map: Map, ontology: Ontology) -> Iterator[Formula]:
    for path, attribute in ontology.attributes_of(map.objects[name].type).items():
        value = value_of(name, path, map, ontology) if path.startswith(LOOKS) else None
        if value is not None:
            yield Comparison(Attribute(variable, path), "=", constant(value, attribute))
