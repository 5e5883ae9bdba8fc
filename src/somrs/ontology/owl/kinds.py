"""Classifies the nodes of an OWL file: types, attributes, relations, functions, service types and objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rdflib import OWL, RDF, RDFS, SH, BNode, URIRef
from rdflib.term import Node

from somrs.ontology.naming import Section
from somrs.ontology.owl.source import Source, sorted_iris
from somrs.ontology.owl.words import SHAPES, VALUES, V, section_of

MENTION_PREDICATES = {RDF.type, RDFS.label}
"""The predicates of a node that is only mentioned, not defined."""


class Kinds:
    """The nodes of each kind, with their names. Definitions of `base` that the file only mentions are included."""

    def __init__(self, source: Source) -> None:
        self._source = source
        graph = source.graph
        classes = [
            node
            for node in sorted_iris(s for kind in (OWL.Class, RDFS.Class) for s in graph.subjects(RDF.type, kind))
            if not _is_vocabulary(node)
        ]
        self.services = self._named_subclasses(classes, V.Service, Section.SERVICES)
        self.facts = self._named_subclasses(classes, V.Fact, Section.RELATIONS)
        self.values = [node for node in classes if V.Value in self._superclasses(node)]
        type_nodes = [node for node in classes if node not in self.services and node not in self.facts and node not in self.values]
        self.types = {node: source.name(node, Section.TYPES) for node in type_nodes if not node.startswith(str(VALUES))}
        properties = sorted_iris(graph.subjects(RDF.type, OWL.ObjectProperty))
        complex = [node for node in properties if self._is_complex(node)]
        simple = sorted_iris(graph.subjects(RDF.type, OWL.DatatypeProperty))
        named = [*simple, *complex, *self._mentioned(Section.ATTRIBUTES)]
        self.attributes: dict[Node, str] = {node: source.name(node, Section.ATTRIBUTES) for node in dict.fromkeys(named)}
        relation_nodes = [node for node in properties if node not in self.attributes and not _is_vocabulary(node)]
        self.relations = {node: source.name(node, Section.RELATIONS) for node in [*relation_nodes, *self.facts]}
        self.functions = {node: source.name(node, Section.FUNCTIONS) for node in sorted_iris(graph.subjects(RDF.type, V.Function))}
        self._objects: dict[URIRef, str] | None = None

    @property
    def objects(self) -> dict[URIRef, str]:
        """The individuals that are objects of a map."""
        if self._objects is None:
            graph, source = self._source.graph, self._source
            typed = [node for node, kind in graph.subject_objects(RDF.type) if kind == OWL.NamedIndividual or self.is_type(kind)]
            definition_nodes = {*self.types, *self.services, *self.facts, *self.values, *self.attributes, *self.relations, *self.functions}
            object_nodes = [
                node
                for node in sorted_iris(iter(typed))
                if node not in definition_nodes and not _is_vocabulary(node) and not self._is_value(node)
            ]
            self._objects = {node: source.name(node, Section.OBJECTS) for node in object_nodes}
        return self._objects

    def is_type(self, node: Node) -> bool:
        return node in self.types or (isinstance(node, URIRef) and section_of(node) is Section.TYPES)

    def is_mentioned_only(self, node: URIRef, definitions: Mapping[str, Any], name: str) -> bool:
        """Whether the node is a known definition that the file only refers to, without statements about it."""
        graph = self._source.graph
        if section_of(node) is None or name not in definitions or any(word not in MENTION_PREDICATES for word in graph.predicates(node)):
            return False
        for kind in graph.objects(node, RDF.type):
            self._source.mark_used(node, RDF.type, kind)
        return True

    def _is_value(self, node: URIRef) -> bool:
        return node.startswith(str(VALUES)) or any(kind in self.values for kind in self._source.graph.objects(node, RDF.type))

    def _is_complex(self, node: URIRef) -> bool:
        if section_of(node) is Section.ATTRIBUTES:
            return True
        return any(
            range_node in self.values or str(range_node).startswith(str(VALUES))
            for range_node in self._source.graph.objects(node, RDFS.range)
        )

    def _mentioned(self, section: Section) -> list[URIRef]:
        """The nodes with an IRI of the section that the file uses, declared or not."""
        graph = self._source.graph
        words = {*graph.predicates(), *graph.objects()}
        return sorted(word for word in words if isinstance(word, URIRef) and section_of(word) is section)

    def _named_subclasses(self, classes: list[URIRef], top: URIRef, section: Section) -> dict[Node, str]:
        nodes = [node for node in classes if section_of(node) is section or top in self._superclasses(node)]
        return {node: self._source.name(node, section) for node in nodes}

    def _superclasses(self, node: URIRef) -> set[Node]:
        superclasses: set[Node] = set()
        waiting: list[Node] = [node]
        while waiting:
            for superclass in self._source.graph.objects(waiting.pop(), RDFS.subClassOf):
                if superclass not in superclasses and not isinstance(superclass, BNode):
                    superclasses.add(superclass)
                    waiting.append(superclass)
        return superclasses


def _is_vocabulary(node: Node) -> bool:
    """Whether the node belongs to the vocabulary of SO-MRS, OWL, RDF or SHACL, or is a shape."""
    return isinstance(node, URIRef) and str(node).startswith((str(V), str(OWL), str(RDFS), str(RDF), str(SHAPES), str(SH)))
