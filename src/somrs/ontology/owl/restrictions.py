"""Reads the restrictions of a class: optional and required attributes, limits of values, and parts."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct
from rdflib import OWL, RDF, BNode, URIRef
from rdflib.collection import Collection
from rdflib.term import Node

from somrs.ontology.naming import Section
from somrs.ontology.owl.ranges import Range, Unclear, read_range
from somrs.ontology.owl.source import Source
from somrs.ontology.owl.words import HAS_PART, VALUES, iri, local_name
from somrs.ontology.types import PART_OF, Part


class OptionalAttribute(Struct, frozen=True):
    attribute: str


class RequiredAttribute(Struct, frozen=True):
    attribute: str


class AttributeLimits(Struct, frozen=True):
    """The limits of the values at an attribute path."""

    path: str
    limits: Range


class ArgumentType(Struct, frozen=True):
    """The type of an argument of a fact; arguments are counted from 1."""

    number: int
    type: str


Restriction = OptionalAttribute | RequiredAttribute | AttributeLimits | Part | ArgumentType

_MAX_CARDINALITIES = (OWL.maxCardinality, OWL.maxQualifiedCardinality)
_MIN_CARDINALITIES = (OWL.minCardinality, OWL.minQualifiedCardinality, OWL.cardinality, OWL.qualifiedCardinality)


def read_restriction(node: Node, source: Source, attributes: dict[Node, str]) -> Restriction:
    """The meaning of a restriction. `attributes` are the properties that are attributes. Raises Unclear for unsupported restrictions."""
    graph = source.graph
    property_node = graph.value(node, OWL.onProperty)
    if property_node is None or (node, RDF.type, OWL.Restriction) not in graph:
        raise Unclear("a class expression; a type has one parent, cardinalities and `only` for its attributes, and formulas")
    if property_node == HAS_PART or _is_inverse_part(property_node, source):
        return _part(node, source)
    if isinstance(property_node, URIRef) and (number := _argument_number(property_node)) is not None:
        return ArgumentType(number, source.name(_class(graph.value(node, OWL.allValuesFrom)), Section.TYPES))
    if property_node not in attributes:
        raise Unclear(
            f"a rule for {source.display_name(property_node)}, which is not an attribute; state it as a formula with somrs:constraint"
        )
    if (range_node := graph.value(node, OWL.allValuesFrom)) is not None:
        return _read_limits(attributes[property_node], range_node, source, attributes)
    if (node, OWL.someValuesFrom, None) in graph:
        return RequiredAttribute(attributes[property_node])
    for facet in _MIN_CARDINALITIES:
        if (min_count := graph.value(node, facet)) is not None and int(str(min_count)) == 1:
            return RequiredAttribute(attributes[property_node])
    for facet in _MAX_CARDINALITIES:
        if (max_count := graph.value(node, facet)) is not None and int(str(max_count)) == 1:
            return OptionalAttribute(attributes[property_node])
    raise Unclear(
        f"a rule for {attributes[property_node]}; an attribute has one value: state `max 1` (may have), `exactly 1` (must have) or `only`"
    )


def _read_limits(path: str, values: Node, source: Source, attributes: dict[Node, str]) -> AttributeLimits:
    if isinstance(values, BNode) and (values, RDF.type, OWL.Restriction) in source.graph:
        inner = read_restriction(values, source, attributes)
        if not isinstance(inner, AttributeLimits):
            raise Unclear(f"a rule for the parts of {path}; only limits of them are kept")
        return AttributeLimits(f"{path}.{inner.path}", inner.limits)
    if (names := _value_classes(values, source)) is not None:
        return AttributeLimits(path, Range(values=names))
    limits = read_range(values, source.graph)
    if limits.minimum is None and limits.maximum is None and not limits.values:
        raise Unclear(f"the composition of {path}; the attribute's own range defines it")
    return AttributeLimits(path, limits)


def _value_classes(node: Node, source: Source) -> tuple[str, ...] | None:
    """The complex attributes whose classes of values the node lists; None for another node."""
    union = source.graph.value(node, OWL.unionOf) if isinstance(node, BNode) else None
    classes = [*Collection(source.graph, union)] if union is not None else [node]
    if not all(isinstance(class_node, URIRef) and class_node.startswith(str(VALUES)) for class_node in classes):
        return None
    return tuple(local_name(class_node) for class_node in classes if isinstance(class_node, URIRef))


def _is_inverse_part(property_node: Node, source: Source) -> bool:
    return isinstance(property_node, BNode) and source.graph.value(property_node, OWL.inverseOf) == iri(Section.RELATIONS, PART_OF)


def _part(node: Node, source: Source) -> Part:
    graph = source.graph
    of_class = graph.value(node, OWL.onClass) or graph.value(node, OWL.someValuesFrom)
    type_name = source.name(_class(of_class), Section.TYPES)
    exact_count, min_count, max_count = (
        graph.value(node, facet) for facet in (OWL.qualifiedCardinality, OWL.minQualifiedCardinality, OWL.maxQualifiedCardinality)
    )
    if exact_count is not None:
        return Part(type=type_name, minimum=int(str(exact_count)), maximum=int(str(exact_count)))
    if (node, OWL.someValuesFrom, None) in graph:
        return Part(type=type_name, minimum=1)
    if min_count is None and max_count is None:
        raise Unclear("a rule for parts; parts are counted: `min 1 Wall`, `max 4 Wall`, `exactly 1 Floor`")
    return Part(type=type_name, minimum=int(str(min_count or 0)), maximum=int(str(max_count)) if max_count is not None else None)


def _class(node: Node | None) -> URIRef:
    if not isinstance(node, URIRef):
        raise Unclear("a class expression where a class should be named")
    return node


def _argument_number(property_node: URIRef) -> int | None:
    _, prefix, number = property_node.partition("urn:so-mrs:owl:argument")
    return int(number) if prefix and number.isdigit() else None


def merge_parts(parts: Iterator[Part]) -> list[Part]:
    """The parts with the limits for the same type combined: `min 1 Wall` and `max 4 Wall` become one part."""
    part_by_type: dict[str, Part] = {}
    for part in parts:
        earlier_part = part_by_type.get(part.type)
        if earlier_part is None:
            part_by_type[part.type] = part
            continue
        limits = [limit for limit in (earlier_part.maximum, part.maximum) if limit is not None]
        part_by_type[part.type] = Part(
            type=part.type, minimum=max(earlier_part.minimum, part.minimum), maximum=min(limits) if limits else None
        )
    return list(part_by_type.values())
