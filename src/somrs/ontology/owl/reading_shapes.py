"""Reads SHACL shapes from other sources: limits and required attributes become constraints of types. The shapes that SO-MRS writes only
repeat the definitions, and are not read."""

from __future__ import annotations

from msgspec import structs
from rdflib import RDF, SH, BNode, URIRef
from rdflib.collection import Collection
from rdflib.term import Node

from somrs.ontology.naming import Section
from somrs.ontology.owl.kinds import Kinds
from somrs.ontology.owl.ranges import Unclear, value_of
from somrs.ontology.owl.source import Source, sorted_iris
from somrs.ontology.owl.words import SHAPES
from somrs.ontology.types import Constraint, ObjectType, Ontology

_SUPPORTED_PREDICATES = {
    SH.path,
    SH.minInclusive,
    SH.maxInclusive,
    SH["in"],
    SH.minCount,
    SH.maxCount,
    SH.datatype,
    SH.message,
    SH.name,
    SH.description,
}


def read_shapes(source: Source, kinds: Kinds, types: dict[str, ObjectType], base: Ontology) -> None:
    """Add the constraints and required attributes of the shapes to the types."""
    graph = source.graph
    for shape in sorted_iris(graph.subjects(RDF.type, SH.NodeShape)):
        if shape.startswith(str(SHAPES)):
            continue
        targets = [*graph.objects(shape, SH.targetClass), *([shape] if kinds.is_type(shape) else [])]
        for target in targets:
            if kinds.is_type(target):
                _read_shape(shape, source.name(target, Section.TYPES), source, kinds, types, base)
                source.mark_used(shape, SH.targetClass, target)
                source.mark_used(shape, RDF.type, SH.NodeShape)
    _mark_own_shapes(source)


def _read_shape(shape: URIRef, name: str, source: Source, kinds: Kinds, types: dict[str, ObjectType], base: Ontology) -> None:
    type = types.get(name, base.types.get(name))
    if type is None:
        return
    property_rules: list[tuple[str, Node, Constraint | None]] = []
    for node in source.graph.objects(shape, SH.property):
        try:
            path = _path(source.graph.value(node, SH.path), source, kinds)
            property_rules.append((path, node, _constraint(node, path, source)))
        except Unclear as unclear:
            source.note(shape, f"a property shape has {unclear}")
    for path, node, constraint in sorted(property_rules, key=lambda rule: (rule[0], str(rule[2]))):
        if constraint is not None and not any(
            structs.replace(existing_constraint, doc="") == structs.replace(constraint, doc="") for existing_constraint in type.constraints
        ):
            type = structs.replace(type, constraints=(*type.constraints, constraint))
        min_count = source.graph.value(node, SH.minCount)
        if min_count is not None and int(str(min_count)) > 0 and path not in type.required and "." not in path:
            type = structs.replace(type, required=(*type.required, path))
        source.mark_used(shape, SH.property, node)
        source.mark_subtree_used(node)
    types[name] = type


def _path(node: Node | None, source: Source, kinds: Kinds) -> str:
    if node is None:
        raise Unclear("no path")
    steps = [node] if isinstance(node, URIRef) else [*Collection(source.graph, node)]
    unknown = next((step for step in steps if step not in kinds.attributes), None)
    if unknown is not None or not steps:
        raise Unclear(
            f"a path without attributes ({source.display_name(unknown) if unknown is not None else 'empty'}); state it as a formula"
        )
    return ".".join(kinds.attributes[step] for step in steps)


def _constraint(node: Node, path: str, source: Source) -> Constraint | None:
    graph = source.graph
    unsupported_predicate = next((word for word in graph.predicates(node) if word not in _SUPPORTED_PREDICATES and word != RDF.type), None)
    if unsupported_predicate is not None:
        raise Unclear(
            f"{source.short(unsupported_predicate)}, which is not kept; limits are sh:minInclusive, sh:maxInclusive, sh:in and sh:minCount"
        )
    lower_limit, upper_limit = (graph.value(node, word) for word in (SH.minInclusive, SH.maxInclusive))
    value_list = graph.value(node, SH["in"])
    values = tuple(value_of(item) for item in Collection(graph, value_list)) if value_list is not None else ()
    if lower_limit is None and upper_limit is None and not values:
        return None
    doc = str(graph.value(node, SH.message) or graph.value(node, SH.description) or "")
    minimum, maximum = (float(str(limit)) if limit is not None else None for limit in (lower_limit, upper_limit))
    return Constraint(attribute=path, minimum=minimum, maximum=maximum, values=values, doc=doc)


def _mark_own_shapes(source: Source) -> None:
    """Mark the shapes of SO-MRS as used, and also the fragments of them that OWL editors leave, which lose lists outside OWL."""
    graph = source.graph
    for shape in sorted_iris(graph.subjects(RDF.type, SH.NodeShape)):
        if shape.startswith(str(SHAPES)):
            source.mark_subtree_used(shape)
    inner = set(graph.objects())
    for node in set(graph.subjects()):
        if isinstance(node, BNode) and node not in inner and any(str(word).startswith(str(SH)) for word in graph.predicates(node)):
            source.mark_subtree_used(node)
