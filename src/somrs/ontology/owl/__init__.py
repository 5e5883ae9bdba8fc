"""Export to OWL 2 and SHACL, for Protégé, reasoners and validators, and import from OWL 2.

Definitions are written in OWL where it can express them; `words.py` has the vocabulary for the rest. The SHACL shapes repeat the rules for
maps, for validators; the import ignores them. rdflib is imported only to write or read a file.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

from msgspec import Struct

from somrs.errors import Problem, UsageError
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Renaming
from somrs.ontology.types import Ontology

if TYPE_CHECKING:
    from rdflib import Graph


class Format(StrEnum):
    """The file format of a graph."""

    TURTLE = "turtle"
    XML = "xml"
    """RDF/XML."""


class OwlImport(Struct, frozen=True, kw_only=True):
    """The content of a file.

    `ontology` has the definitions in the file, under the names in their IRIs. `renamings` are the definitions with a new label, `removed`
    those that are marked as deprecated. `notes` describe what was not imported, and what to do about it.
    """

    ontology: Ontology
    removed: tuple[DefinitionKey, ...] = ()
    renamings: tuple[Renaming, ...] = ()
    map: Map
    notes: tuple[Problem, ...] = ()


def export(ontology: Ontology, map: Map | None = None, format: Format = Format.TURTLE, *, shapes: bool = True) -> bytes:
    """The ontology, and the map if it is given, as a file. Raises UsageError if rdflib is not installed."""
    _require_rdflib()
    from somrs.ontology.owl.writing import serialised

    return serialised(to_graph(ontology, map, shapes=shapes), format)


def to_graph(ontology: Ontology, map: Map | None = None, *, shapes: bool = True) -> Graph:
    """The ontology, and the map if it is given, as a graph. Raises UsageError if rdflib is not installed."""
    _require_rdflib()
    from somrs.ontology.owl.writing import graph_of

    return graph_of(ontology, map, shapes=shapes)


def read(text: str, file: str, base: Ontology) -> OwlImport:
    """The content of a Turtle or RDF/XML file whose definitions build on those of `base`. Raises ModelError with all problems, and
    UsageError if rdflib is not installed."""
    _require_rdflib()
    from somrs.ontology.owl.reading import read as reading

    return reading(text, file, base)


def _require_rdflib() -> None:
    try:
        import rdflib  # noqa: F401  # only to see whether it is installed
    except ImportError:
        raise UsageError("OWL files need rdflib, which is not installed: pip install 'somrs[api]'") from None
