"""Converts between OWL data ranges and the kinds and limits of attribute values."""

from __future__ import annotations

from typing import Any

from msgspec import Struct
from rdflib import OWL, RDF, RDFS, XSD, BNode, Graph, Literal, URIRef
from rdflib.collection import Collection
from rdflib.term import IdentifiedNode, Node

from somrs.ontology.owl.words import literal
from somrs.ontology.types import AttributeType, Kind, Value

DATATYPES = {Kind.NUMBER: XSD.decimal, Kind.TEXT: XSD.string, Kind.TRUTH: XSD.boolean, Kind.ENUMERATION: XSD.string}

_NUMBERS = {
    XSD[name]
    for name in (
        "decimal", "double", "float", "integer", "int", "long", "short", "byte", "nonNegativeInteger", "positiveInteger",
        "nonPositiveInteger", "negativeInteger", "unsignedInt", "unsignedLong", "unsignedShort", "unsignedByte",
    )
} | {OWL.real, OWL.rational}  # fmt: skip
_TEXTS = {XSD.string, XSD.normalizedString, XSD.token, RDFS.Literal, RDF.PlainLiteral, RDF.langString}


class Range(Struct, frozen=True, kw_only=True):
    """Values of a kind (None: any), within limits or from a list."""

    kind: Kind | None = None
    minimum: float | None = None
    maximum: float | None = None
    values: tuple[Value, ...] = ()


class Unclear(Exception):
    """An unsupported data range or restriction; the message describes it."""


# Writing


class Nodes:
    """Numbered blank nodes, so that the same ontology always gives the same file."""

    def __init__(self) -> None:
        self._count = 0

    def new(self) -> BNode:
        self._count += 1
        return BNode(f"n{self._count:06d}")


def range_of(attribute: AttributeType, graph: Graph, nodes: Nodes) -> IdentifiedNode:
    """The node of the data range of a simple attribute."""
    return range_node(
        Range(kind=attribute.kind, minimum=attribute.minimum, maximum=attribute.maximum, values=attribute.values), graph, nodes
    )


def range_node(value_range: Range, graph: Graph, nodes: Nodes) -> IdentifiedNode:
    """The node of a data range; its parts are added to the graph."""
    parts: list[IdentifiedNode] = []
    if value_range.minimum is not None or value_range.maximum is not None:
        facets = ((XSD.minInclusive, value_range.minimum), (XSD.maxInclusive, value_range.maximum))
        parts.append(_restricted([(facet, value) for facet, value in facets if value is not None], graph, nodes))
    if value_range.values:
        parts.append(_enumeration(value_range.values, graph, nodes))
    if not parts:
        return DATATYPES[value_range.kind or Kind.TEXT]
    if len(parts) == 1:
        return parts[0]
    whole = nodes.new()
    graph.add((whole, RDF.type, RDFS.Datatype))
    graph.add((whole, OWL.intersectionOf, list_of(parts, graph, nodes)))
    return whole


def _restricted(facets: list[tuple[URIRef, float]], graph: Graph, nodes: Nodes) -> BNode:
    whole = nodes.new()
    facet_nodes: list[Node] = []
    for facet, value in facets:
        facet_node = nodes.new()
        graph.add((facet_node, facet, literal(value)))
        facet_nodes.append(facet_node)
    graph.add((whole, RDF.type, RDFS.Datatype))
    graph.add((whole, OWL.onDatatype, XSD.decimal))
    graph.add((whole, OWL.withRestrictions, list_of(facet_nodes, graph, nodes)))
    return whole


def _enumeration(values: tuple[Value, ...], graph: Graph, nodes: Nodes) -> BNode:
    whole = nodes.new()
    graph.add((whole, RDF.type, RDFS.Datatype))
    graph.add((whole, OWL.oneOf, list_of([literal(value) for value in values], graph, nodes)))
    return whole


def list_of(items: Any, graph: Graph, nodes: Nodes) -> IdentifiedNode:
    """An RDF list."""
    cells = [nodes.new() for _ in items]
    for number, item in enumerate(items):
        graph.add((cells[number], RDF.first, item))
        graph.add((cells[number], RDF.rest, cells[number + 1] if number + 1 < len(cells) else RDF.nil))
    return cells[0] if cells else RDF.nil


# Reading


def read_range(node: Node, graph: Graph) -> Range:
    """The kind and limits of a data range. Raises Unclear for an unsupported one."""
    if isinstance(node, URIRef):
        return Range(kind=_kind(node))
    if (base := graph.value(node, OWL.onDatatype)) is not None:
        return _facets(base, node, graph)
    if (item_list := graph.value(node, OWL.oneOf)) is not None:
        values = tuple(value_of(item) for item in Collection(graph, item_list))
        return Range(kind=_kind_of(values), values=values)
    if (parts := graph.value(node, OWL.intersectionOf)) is not None:
        part_ranges = [read_range(part, graph) for part in Collection(graph, parts)]
        merged: dict[str, Any] = {}
        for part_range in part_ranges:
            merged |= {name: value for name in part_range.__struct_fields__ if (value := getattr(part_range, name)) not in (None, ())}
        return Range(**merged)
    raise Unclear("a data range that is neither a datatype, nor one within limits, nor a list of values")


def _facets(base: Node, node: Node, graph: Graph) -> Range:
    limits: dict[str, float] = {}
    for facet in Collection(graph, graph.value(node, OWL.withRestrictions) or RDF.nil):
        for name, value in graph.predicate_objects(facet):
            key = {XSD.minInclusive: "minimum", XSD.maxInclusive: "maximum"}.get(name)  # type: ignore[call-overload]  # a predicate is an IRI
            if key is None:
                raise Unclear(f"a limit of another sort ({name}); limits are xsd:minInclusive and xsd:maxInclusive")
            limits[key] = float(str(value))
    return Range(kind=_kind(base), minimum=limits.get("minimum"), maximum=limits.get("maximum"))


def _kind(datatype: Node) -> Kind:
    if datatype in _NUMBERS:
        return Kind.NUMBER
    if datatype == XSD.boolean:
        return Kind.TRUTH
    if datatype in _TEXTS:
        return Kind.TEXT
    raise Unclear(f"the datatype {datatype}; there are numbers (xsd:decimal), texts (xsd:string), truths (xsd:boolean) and lists of values")


def _kind_of(values: tuple[Value, ...]) -> Kind | None:
    if all(isinstance(value, str) for value in values):
        return Kind.ENUMERATION
    return None


def value_of(node: Node) -> Value:
    """The value of a literal. Raises Unclear for a node that is not a literal."""
    if not isinstance(node, Literal):
        raise Unclear(f"{node}, where a value is expected")
    if node.datatype in _NUMBERS:
        return float(str(node))
    if node.datatype == XSD.boolean:
        return str(node) in ("true", "1")
    return str(node)
