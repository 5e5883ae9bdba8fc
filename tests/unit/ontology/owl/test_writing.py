"""What is written of an ontology and its map as OWL 2 and SHACL, statement by statement: other programs read it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import pytest

from somrs.errors import UsageError
from somrs.ontology.files.loaded import LoadedModel
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.owl import Format, OwlImport, export, read, to_graph
from somrs.ontology.types import Ontology

pytest.importorskip("rdflib", reason="rdflib is not installed")

from rdflib import SH, BNode, Graph
from rdflib.term import Node

FOLDER = Path(__file__).parent


@lru_cache(maxsize=1)
def yard() -> LoadedModel:
    return load([FOLDER / "yard.yaml"], base=Ontology())


def turtle(text: str) -> Graph:
    return Graph(bind_namespaces="none").parse(data=text, format="turtle")


def statements(graph: Graph) -> set[tuple[str, str, str]]:
    """All of a graph, with what is said of a node without a name in place of that node."""
    text_by_node: dict[Node, str] = {}

    def node_text(node: Node) -> str:
        if not isinstance(node, BNode):
            return node.n3()
        if node not in text_by_node:
            inner = sorted(f"{word.n3()} {node_text(object)}" for word, object in graph.predicate_objects(node))
            text_by_node[node] = f"[{' ; '.join(inner)}]"
        return text_by_node[node]

    return {(node_text(subject), node_text(word), node_text(object)) for subject, word, object in graph}


def test_every_statement_of_an_ontology_and_its_map() -> None:
    written = to_graph(yard().ontology, yard().map)
    expected = turtle((FOLDER / "yard.ttl").read_text("utf-8"))
    assert statements(written) == statements(expected)
    assert dict(written.namespaces()) == dict(expected.namespaces())


def test_a_map_and_shapes_may_be_left_out() -> None:
    whole, plain = to_graph(yard().ontology), to_graph(yard().ontology, shapes=False)
    of_shapes = [statement for statement in whole if str(statement[1]).startswith(str(SH))]
    assert len(of_shapes) > 100
    assert not [node for statement in plain for node in statement if str(node).startswith((str(SH), "urn:so-mrs:shape:"))]
    assert not [node for node in whole.subjects() if str(node).startswith("urn:so-mrs:object:")]


def test_what_is_written_is_read_back() -> None:
    owl_import = read(export(yard().ontology, yard().map, shapes=False).decode(), "yard", Ontology())
    assert owl_import == OwlImport(ontology=owl_import.ontology, map=owl_import.map)
    assert [*owl_import.ontology] == [*yard().ontology]
    assert owl_import.map == yard().map


def test_a_text_that_xml_cannot_hold_is_written_as_turtle_only() -> None:
    map = Map([Object(name="A", type="Pot", values={"Label": "a\x01b"})])
    with pytest.raises(UsageError) as caught:
        export(Ontology(), map, Format.XML)
    message = "a text of urn:so-mrs:object:A has the character '\\x01', which XML cannot hold; remove it, or write Turtle"
    assert str(caught.value) == message
    assert read(export(Ontology(), map).decode(), "file", Ontology()).map == map


def test_maps_say_also_what_no_ontology_has() -> None:
    facts = [Fact("likes", ("A b", "C")), Fact("likes", ("C",)), Fact("isNew", ("A b", "C"))]
    map = Map([Object(name="A b", type="Pot", values={"Weight": float("inf"), "Shape.Depth": 1e-07})], facts)
    written = to_graph(yard().ontology, map, shapes=False)
    expected = turtle(
        """
        @prefix : <urn:so-mrs:object:> .
        @prefix attribute: <urn:so-mrs:attribute:> .
        @prefix relation: <urn:so-mrs:relation:> .
        @prefix somrs: <urn:so-mrs:owl:> .
        @prefix owl: <http://www.w3.org/2002/07/owl#> .
        @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
        :A%20b a owl:NamedIndividual , <urn:so-mrs:type:Pot> ; rdfs:label "A b" ; relation:likes :C ; attribute:Weight 1e9999 ;
          attribute:Shape <urn:so-mrs:value:A%20b.Shape> .
        <urn:so-mrs:value:A%20b.Shape> a owl:NamedIndividual , <urn:so-mrs:value:Shape> ; attribute:Depth 0.0000001 .
        [] a relation:likes ; somrs:argument1 :C .
        [] a relation:isNew ; somrs:argument1 :A%20b ; somrs:argument2 :C .
    """.replace("1e9999", '"inf"^^<http://www.w3.org/2001/XMLSchema#double>')
    )
    assert statements(written) - statements(to_graph(yard().ontology, shapes=False)) == statements(expected)
