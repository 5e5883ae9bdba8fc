"""Writes OWL files: makes the graph of an ontology and a map, and serialises it."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

from rdflib import Graph, Literal
from rdflib.plugins.serializers.turtle import TurtleSerializer

from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.owl.definitions import write_definitions
from somrs.ontology.owl.individuals import write_map
from somrs.ontology.owl.ranges import Nodes
from somrs.ontology.owl.shapes import write_shapes
from somrs.ontology.owl.words import bind_prefixes
from somrs.ontology.types import Ontology

if TYPE_CHECKING:
    from somrs.ontology.owl import Format

NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold."""


def graph_of(ontology: Ontology, map: Map | None = None, *, shapes: bool = True) -> Graph:
    """The graph of the definitions, of the shapes if `shapes` is set, and of the map if there is one."""
    graph, nodes = bind_prefixes(Graph(bind_namespaces="none")), Nodes()
    write_definitions(ontology, graph, nodes)
    if shapes:
        write_shapes(ontology, graph, nodes)
    if map is not None:
        write_map(map, ontology, graph, nodes)
    return graph


def serialised(graph: Graph, format: Format) -> bytes:
    """The content of the file. Raises UsageError for a text that XML cannot hold."""
    if format == "turtle":
        buffer = io.BytesIO()
        TurtleSerializer(graph).serialize(buffer, encoding="utf-8")
        return buffer.getvalue()
    for subject, _, object in graph:
        if isinstance(object, Literal) and (wrong := NOT_XML.search(str(object))) is not None:
            raise UsageError(f"a text of {subject} has the character {wrong[0]!r}, which XML cannot hold; remove it, or write Turtle")
    return graph.serialize(format="xml", encoding="utf-8")
