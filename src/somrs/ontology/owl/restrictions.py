"""What a class says of its instances by cardinalities and ranges: attributes that they may or must have, limits, parts."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct
from rdflib import OWL, RDF, BNode, URIRef
from rdflib.term import Node

from somrs.ontology.naming import Section
from somrs.ontology.owl.ranges import Range, Unclear, read_range
from somrs.ontology.owl.source import Source
from somrs.ontology.owl.words import HAS_PART, iri
from somrs.ontology.types import PART_OF, Part


class MayHave(Struct, frozen=True):
    attribute: str


class MustHave(Struct, frozen=True):
    attribute: str


class Only(Struct, frozen=True):
    """The values at an attribute path are within limits."""

    path: str
    limits: Range


class Argument(Struct, frozen=True):
    """Of a fact: which argument is of which type."""

    number: int
    type: str


Saying = MayHave | MustHave | Only | Part | Argument

AT_MOST = (OWL.maxCardinality, OWL.maxQualifiedCardinality)
AT_LEAST = (OWL.minCardinality, OWL.minQualifiedCardinality, OWL.cardinality, OWL.qualifiedCardinality)


def read_restriction(node: Node, source: Source, attributes: dict[Node, str]) -> Saying:
    """What a restriction means to us; `attributes` are the properties that are attributes. Raises Unclear."""
    graph = source.graph
    on = graph.value(node, OWL.onProperty)
    if on is None or (node, RDF.type, OWL.Restriction) not in graph:
        raise Unclear("a class expression; a type has one parent, cardinalities and `only` for its attributes, and formulas")
    if on == HAS_PART or _is_inverse_part(on, source):
        return _part(node, source)
    if isinstance(on, URIRef) and (number := _argument_number(on)) is not None:
        return Argument(number, source.name(_class(graph.value(node, OWL.allValuesFrom)), Section.TYPES))
    if on not in attributes:
        raise Unclear(f"a rule for {source.said(on)}, which is no attribute; say it as a formula with somrs:constraint")
    if (only := graph.value(node, OWL.allValuesFrom)) is not None:
        return _only(attributes[on], only, source, attributes)
    if (node, OWL.someValuesFrom, None) in graph:
        return MustHave(attributes[on])
    for facet in AT_LEAST:
        if (least := graph.value(node, facet)) is not None and int(str(least)) == 1:
            return MustHave(attributes[on])
    for facet in AT_MOST:
        if (most := graph.value(node, facet)) is not None and int(str(most)) == 1:
            return MayHave(attributes[on])
    raise Unclear(f"a rule for {attributes[on]}; an attribute has one value: say `max 1` (may have), `exactly 1` (must have) or `only`")


def _only(path: str, values: Node, source: Source, attributes: dict[Node, str]) -> Only:
    if isinstance(values, BNode) and (values, RDF.type, OWL.Restriction) in source.graph:
        inner = read_restriction(values, source, attributes)
        if not isinstance(inner, Only):
            raise Unclear(f"a rule for the parts of {path}; only limits of them are kept")
        return Only(f"{path}.{inner.path}", inner.limits)
    limits = read_range(values, source.graph)
    if limits.minimum is None and limits.maximum is None and not limits.values:
        raise Unclear(f"what {path} is made of; the attribute's own range says that")
    return Only(path, limits)


def _is_inverse_part(on: Node, source: Source) -> bool:
    return isinstance(on, BNode) and source.graph.value(on, OWL.inverseOf) == iri(Section.RELATIONS, PART_OF)


def _part(node: Node, source: Source) -> Part:
    graph = source.graph
    of_class = graph.value(node, OWL.onClass) or graph.value(node, OWL.someValuesFrom)
    type_name = source.name(_class(of_class), Section.TYPES)
    exactly, least, most = (
        graph.value(node, facet) for facet in (OWL.qualifiedCardinality, OWL.minQualifiedCardinality, OWL.maxQualifiedCardinality)
    )
    if exactly is not None:
        return Part(type=type_name, minimum=int(str(exactly)), maximum=int(str(exactly)))
    if (node, OWL.someValuesFrom, None) in graph:
        return Part(type=type_name, minimum=1)
    if least is None and most is None:
        raise Unclear("a rule for parts; parts are counted: `min 1 Wall`, `max 4 Wall`, `exactly 1 Floor`")
    return Part(type=type_name, minimum=int(str(least or 0)), maximum=int(str(most)) if most is not None else None)


def _class(node: Node | None) -> URIRef:
    if not isinstance(node, URIRef):
        raise Unclear("a class expression where a class should be named")
    return node


def _argument_number(on: URIRef) -> int | None:
    _, found, number = on.partition("urn:so-mrs:owl:argument")
    return int(number) if found and number.isdigit() else None


def merged(parts: Iterator[Part]) -> list[Part]:
    """`min 1 Wall` and `max 4 Wall` are one."""
    found: dict[str, Part] = {}
    for part in parts:
        known = found.get(part.type)
        if known is None:
            found[part.type] = part
            continue
        limits = [limit for limit in (known.maximum, part.maximum) if limit is not None]
        found[part.type] = Part(type=part.type, minimum=max(known.minimum, part.minimum), maximum=min(limits) if limits else None)
    return list(found.values())
