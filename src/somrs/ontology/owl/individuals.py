"""Writes a map as OWL 2 individuals: objects with their values, and the facts between them."""

from __future__ import annotations

from rdflib import OWL, RDF, RDFS, Graph, Literal, URIRef

from somrs.ontology.map import Map
from somrs.ontology.naming import Section
from somrs.ontology.objects import Object
from somrs.ontology.owl.definitions import is_binary
from somrs.ontology.owl.ranges import Nodes
from somrs.ontology.owl.words import SPACES, VALUES, argument, iri, literal, quote_name
from somrs.ontology.types import Ontology


def write_map(map: Map, ontology: Ontology, graph: Graph, nodes: Nodes) -> None:
    """Add the map to the graph."""
    for object in map.objects.values():
        _object(object, graph)
    for fact in map.facts():
        arguments = [iri(Section.OBJECTS, name) for name in fact.arguments]
        relation = ontology.relations.get(fact.relation)
        word = iri(Section.RELATIONS, fact.relation)
        if len(arguments) == 2 and (relation is None or is_binary(relation)):
            graph.add((arguments[0], word, arguments[1]))
            continue
        node = nodes.new()
        graph.add((node, RDF.type, word))
        for number, argument_iri in enumerate(arguments, 1):
            graph.add((node, argument(number), argument_iri))


def _object(object: Object, graph: Graph) -> None:
    subject = iri(Section.OBJECTS, object.name)
    graph.add((subject, RDF.type, OWL.NamedIndividual))
    graph.add((subject, RDF.type, iri(Section.TYPES, object.type)))
    graph.add((subject, RDFS.label, Literal(object.name)))
    for path, value in object.values.items():
        *outer, attribute_name = path.split(".")
        graph.add((_owner(object.name, subject, outer, graph), iri(Section.ATTRIBUTES, attribute_name), literal(value)))


def _owner(name: str, subject: URIRef, outer: list[str], graph: Graph) -> URIRef:
    """The individual that has the last attribute of a path: the object, or the value of a complex attribute. Such a value has an IRI, so
    that editors can show it."""
    for depth, step in enumerate(outer, 1):
        value = VALUES[".".join([quote_name(name), *outer[:depth]])]
        graph.add((subject, SPACES[Section.ATTRIBUTES][quote_name(step)], value))
        graph.add((value, RDF.type, OWL.NamedIndividual))
        graph.add((value, RDF.type, VALUES[quote_name(step)]))
        subject = value
    return subject
