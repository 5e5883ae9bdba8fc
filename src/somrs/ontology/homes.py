"""Objects that have their home on another map, in formulas and changes. Their names are qualified (`qualified_names.py`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from msgspec import structs

from somrs.entish.formula import Formula, names
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.qualified_names import SEPARATOR, home_of, plain_name
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import Ontology


def full_name(name: str, map: Map) -> str:
    """The name on the map of the object that somebody means by a name.

    Without a qualification it is an own object, or else the only one of that name that neighbours have; qualified, it may also be one of
    the map itself. A name that means nothing, or more than one object, stays as it is.
    """
    if name in map.objects:
        return name
    if home_of(name):
        return plain_name(name) if home_of(name) == map.name and plain_name(name) in map.objects else name
    homonyms = homonyms_of(name, map)
    return homonyms[0] if len(homonyms) == 1 else name


def homonyms_of(name: str, map: Map) -> list[str]:
    """The objects of neighbours that have this name at home."""
    return [full for home in map.homes if (full := f"{home}{SEPARATOR}{name}") in map.objects]


def absence_text(name: str, map: Map) -> str:
    """That the map has no object of this name, for people. What a neighbour shows completely does not have it either."""
    home = home_of(name)
    return f"there is no object {plain_name(name)} on the map {home}" if home in map.complete else f"there is no object {name} on the map"


def with_full_names(formula: Formula, map: Map, ontology: Ontology) -> Formula:
    """The formula with the full names of the objects that it means."""
    full_names = {name: full for name in names(formula) if (full := full_name(name, map)) != name}
    return _renamer(full_names, ontology).formula(formula) if full_names else formula


def full_text(text: str, map: Map, ontology: Ontology) -> str:
    """The text of a formula with the full names of the objects that it means; as it was written if it has them already."""
    formula = parse(text)
    full_formula = with_full_names(formula, map, ontology)
    return text if full_formula is formula else str(full_formula)


def text_with_names(text: str, new_name: Callable[[str], str], ontology: Ontology) -> str:
    """The text of a formula with other names of its objects. Raises FormulaError."""
    renamer = _renamer({name: new_name(name) for name in names(parse(text))}, ontology)
    return renamer.text(text) or text


def _renamer(new_names: Mapping[str, str], ontology: Ontology) -> Renamer:
    return Renamer((Renaming(section=Section.OBJECTS, name=name, to=to) for name, to in new_names.items()), ontology)


def renamed_change(change: Change, new_name: Callable[[str], str]) -> Change:
    """The change with other names of its objects."""
    match change:
        case ObjectAdded(object):
            return ObjectAdded(renamed_object(object, new_name))
        case ObjectRemoved(name):
            return ObjectRemoved(new_name(name))
        case ValueSet(name):
            return structs.replace(change, object=new_name(name))
        case FactAdded(fact) | FactRemoved(fact):
            return type(change)(renamed_fact(fact, new_name))


def renamed_object(object: Object, new_name: Callable[[str], str]) -> Object:
    return structs.replace(object, name=new_name(object.name))


def renamed_fact(fact: Fact, new_name: Callable[[str], str]) -> Fact:
    return Fact(fact.relation, tuple(map(new_name, fact.arguments)))
