"""OWL 2 and SHACL: an ontology and a map for Protégé, reasoners and validators, and back.

Everything is said in OWL, as far as it has words; `words.py` has those that it lacks. The SHACL shapes say the rules for maps once more,
for validators. What is read back is what OWL says. rdflib is asked for only when a file is to be written or read.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

from msgspec import Struct

from somrs.errors import Problem, UsageError
from somrs.ontology.naming import DefinitionKey, Renaming
from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology

if TYPE_CHECKING:
    from rdflib import Graph


class Format(StrEnum):
    """How a graph is written down."""

    TURTLE = "turtle"
    XML = "xml"
    """RDF/XML."""


class OwlImport(Struct, frozen=True, kw_only=True):
    """What a file says. `ontology` are the definitions that are in it, under the names that their IRIs give them; `renamings` says which
    of them got another name, `removed` which are marked as deprecated. `notes`: what else is in the file, which is not taken over, and
    what to do about it."""

    ontology: Ontology
    removed: tuple[DefinitionKey, ...] = ()
    renamings: tuple[Renaming, ...] = ()
    map: Map
    notes: tuple[Problem, ...] = ()


def export(ontology: Ontology, map: Map | None = None, format: Format = Format.TURTLE, *, shapes: bool = True) -> bytes:
    """The ontology, and the map if it is given, as a file. Raises UsageError where rdflib is not installed."""
    _require_rdflib()
    from somrs.ontology.owl.writing import serialised

    return serialised(to_graph(ontology, map, shapes=shapes), format)


def to_graph(ontology: Ontology, map: Map | None = None, *, shapes: bool = True) -> Graph:
    """The same as a graph."""
    _require_rdflib()
    from somrs.ontology.owl.writing import graph_of

    return graph_of(ontology, map, shapes=shapes)


def read(text: str, file: str, base: Ontology) -> OwlImport:
    """What a Turtle or RDF/XML file says, of definitions that build on those of `base`. Raises ModelError with all that is wrong, and
    UsageError where rdflib is not installed."""
    _require_rdflib()
    from somrs.ontology.owl.reading import read as reading

    return reading(text, file, base)


def _require_rdflib() -> None:
    try:
        import rdflib  # noqa: F401  # whether it is there
    except ImportError:
        raise UsageError("OWL files need rdflib, which the core does without: pip install 'somrs[api]'") from None
