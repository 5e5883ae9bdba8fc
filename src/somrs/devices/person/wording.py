"""Formulas as sentences for people who do not read Entish: `Jar002 isOn Table001` is "Jar002 (red jar) is on Table001 (table)"."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from somrs.entish.formula import Attribute, Comparison, Formula, Name, Not, Number, Relation, Term, Text, Truth, Variable, conjuncts, names
from somrs.ontology.objects import Object
from somrs.ontology.types import UNKNOWN
from somrs.service_manager.sdk.map_reader import MapReader

_BOUNDARY = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_OPERATORS = {"=": "is", "!=": "is not", "<": "is less than", "<=": "is at most", ">": "is more than", ">=": "is at least"}


def words(name: str) -> str:
    """The words of a name of the ontology: `TransferObject` is "transfer object"."""
    return _BOUNDARY.sub(" ", name).replace("_", " ").lower()


def title(name: str) -> str:
    """The words of a name as a heading: `TransferObject` is "Transfer object"."""
    text = words(name)
    return text[:1].upper() + text[1:]


async def describe_objects(map: MapReader, object_names: Iterable[str]) -> dict[str, str]:
    """The descriptions of the objects that are on the map."""
    objects = [await map.object(name) for name in object_names]
    return {object.name: describe_object(object) for object in objects if object is not None}


def describe_object(object: Object) -> str:
    """The object's name with what tells it from others: its label, colour and type."""
    color, label = object.values.get("Color"), object.values.get("Label")
    kind = " ".join([*([str(color).lower()] if color is not None else []), words(object.type)])
    return f"{object.name} ({', '.join([*([str(label)] if label is not None and label != object.name else []), kind])})"


def sentence(formula: Formula, descriptions: Mapping[str, str]) -> str:
    """The formula as a sentence; with variables, what there is to find out. Parts for which there are no words stay as they are."""
    parts = [_part(part, descriptions) for part in conjuncts(formula)]
    return ", and ".join(parts)


def _part(part: Formula, descriptions: Mapping[str, str]) -> str:
    negated, atom = (True, part.atom) if isinstance(part, Not) else (False, part)
    match atom:
        case Relation(relation, (first, second)):
            subject, verb, object = _term(first, descriptions), words(relation), _term(second, descriptions)
            if isinstance(first, Variable) and first.type is None:
                subject = "what"
            if negated:
                verb = f"is not {verb[3:]}" if verb.startswith("is ") else f"no longer {verb}"
            return f"{subject} {verb} {object}"
        case Comparison(Attribute(owner, path), "=", Truth(False)) if path == UNKNOWN and not negated:
            return f"where {_term(owner, descriptions)} is"
        case Comparison(Attribute(owner, path), "=", Variable()):
            return f"the {_path(path)} of {_term(owner, descriptions)}"
        case Comparison(Attribute(owner, path), "=", Truth(value)):
            return f"{_term(owner, descriptions)} is {'' if value != negated else 'not '}{_path(path)}"
        case Comparison(Attribute(owner, path), operator, Name() | Variable() | Text() | Number() as right) if (
            not negated and operator in _OPERATORS
        ):
            return f"the {_path(path)} of {_term(owner, descriptions)} {_OPERATORS[operator]} {_term(right, descriptions)}"
    return str(part)


def _path(path: str) -> str:
    return " ".join(words(name) for name in path.split("."))


def _term(term: Term, descriptions: Mapping[str, str]) -> str:
    match term:
        case Name(name):
            return descriptions.get(name, name)
        case Text(value):
            return f"“{value}”"
        case Variable(name, type):
            return f"something ({words(type)})" if type is not None else f"something ({words(name)})"
    return str(term)


async def in_words(map: MapReader, formula: Formula) -> str:
    """The formula as a sentence, with its objects described as on the map."""
    return sentence(formula, await describe_objects(map, names(formula)))
