"""Reads the individuals of an OWL file as objects with values, and the facts between them."""

from __future__ import annotations

from rdflib import OWL, RDF, BNode, Literal, URIRef
from rdflib.term import Node

from somrs.ontology.map import Map
from somrs.ontology.naming import Section
from somrs.ontology.objects import Fact, Object
from somrs.ontology.owl.kinds import Kinds
from somrs.ontology.owl.ranges import value_of
from somrs.ontology.owl.source import Source
from somrs.ontology.owl.words import argument, local_name, section_of
from somrs.ontology.types import Ontology, Value

MAX_DEPTH = 8
"""The maximum nesting of the values of complex attributes."""


def read_map(source: Source, kinds: Kinds, ontology: Ontology) -> Map:
    """The map in the file. `conformance.py` checks it."""
    reading = _Reading(source, kinds, ontology)
    objects = [reading.object(node, name) for node, name in kinds.objects.items()]
    return Map([map_object for map_object in objects if map_object is not None], reading.facts())


class _Reading:
    def __init__(self, source: Source, kinds: Kinds, ontology: Ontology) -> None:
        self._source, self._kinds, self._ontology = source, kinds, ontology

    def object(self, node: URIRef, name: str) -> Object | None:
        source = self._source
        source.mark_used(node, RDF.type, OWL.NamedIndividual)
        types = [kind for kind in source.take_objects(node, RDF.type) if isinstance(kind, URIRef) and self._kinds.is_type(kind)]
        names = sorted({source.name(kind, Section.TYPES) for kind in types})
        names = [
            type_name
            for type_name in names
            if not any(other_name != type_name and self._ontology.is_subtype(other_name, type_name) for other_name in names)
        ]
        if len(names) != 1:
            if not names and not self._is_spoken_of(node):
                source.note(node, "it is an individual of no known type, and is left out; give it one of the types")
                return None
            problem = f"is of the types {' and '.join(names)}" if names else "is of no type"
            source.problem(node, "type", f"{problem}; an object has one type", name)
            return None
        values: dict[str, Value] = {}
        for path, value in self._values(node, "", 0):
            if values.setdefault(path, value) != value:
                source.problem(node, "value", f"has {path} twice, {values[path]!r} and {value!r}; keep one of them", name)
        return Object(name=name, type=names[0], values=values)

    def _is_spoken_of(self, node: URIRef) -> bool:
        """Whether the node has values or facts, and so must be an object."""
        return any(word in self._kinds.attributes or self._relation(word) is not None for word in self._source.graph.predicates(node))

    def _values(self, node: Node, prefix: str, depth: int) -> list[tuple[str, Value]]:
        source = self._source
        path_values: list[tuple[str, Value]] = []
        for word, object in source.graph.predicate_objects(node):
            name = self._kinds.attributes.get(word)
            if name is None:
                continue
            source.mark_used(node, word, object)
            path = f"{prefix}{name}"
            if isinstance(object, Literal):
                path_values.append((path, value_of(object)))
            elif depth < MAX_DEPTH:
                for kind in source.take_objects(object, RDF.type):
                    source.mark_used(object, RDF.type, kind)
                path_values += self._values(object, f"{path}.", depth + 1)
        return path_values

    def facts(self) -> list[Fact]:
        source, objects = self._source, self._kinds.objects
        facts: list[Fact] = []
        for subject, word, object_node in source.graph:
            relation = self._relation(word)
            if relation is not None and subject in objects and isinstance(object_node, URIRef):
                facts.append(Fact(relation, (objects[subject], objects.get(object_node) or source.name(object_node, Section.OBJECTS))))  # type: ignore[index]  # checked above
                source.mark_used(subject, word, object_node)
        for node, kind in source.graph.subject_objects(RDF.type):
            relation = self._relation(kind)
            if relation is not None and (isinstance(node, BNode) or node in objects):
                facts.append(Fact(relation, self._arguments(node)))
                source.mark_subtree_used(node)
        return facts

    def _relation(self, word: Node) -> str | None:
        if word in self._kinds.relations:
            return self._kinds.relations[word]
        if isinstance(word, URIRef) and section_of(word) is Section.RELATIONS:
            return local_name(word)
        return None

    def _arguments(self, node: Node) -> tuple[str, ...]:
        arguments: list[str] = []
        while (argument_node := self._source.graph.value(node, argument(len(arguments) + 1))) is not None and isinstance(
            argument_node, URIRef
        ):
            arguments.append(self._kinds.objects.get(argument_node) or self._source.name(argument_node, Section.OBJECTS))
        return tuple(arguments)
