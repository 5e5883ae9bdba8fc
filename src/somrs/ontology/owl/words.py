"""The words of our OWL files: which IRI stands for what, and what the vocabulary is that OWL does not have."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal
from math import isfinite
from urllib.parse import quote, unquote

from rdflib import OWL, RDF, RDFS, SH, XSD, Graph, Literal, Namespace, URIRef

from somrs.ontology.naming import Section
from somrs.ontology.types import Value

ONTOLOGY = URIRef("urn:so-mrs:ontology")
SPACES: dict[Section, Namespace] = {
    Section.ATTRIBUTES: Namespace("urn:so-mrs:attribute:"),
    Section.RELATIONS: Namespace("urn:so-mrs:relation:"),
    Section.FUNCTIONS: Namespace("urn:so-mrs:function:"),
    Section.TYPES: Namespace("urn:so-mrs:type:"),
    Section.SERVICES: Namespace("urn:so-mrs:service:"),
    Section.OBJECTS: Namespace("urn:so-mrs:object:"),
}
"""Each section has names of its own, so that an attribute and a type may be called the same."""

VALUES = Namespace("urn:so-mrs:value:")
"""Classes of the values of complex attributes, and those values."""
SHAPES = Namespace("urn:so-mrs:shape:")
V = Namespace("urn:so-mrs:owl:")
"""What OWL has no words for."""

PREFIXES = {
    **{section.value.rstrip("s"): space for section, space in SPACES.items()},
    "value": VALUES,
    "shape": SHAPES,
    "somrs": V,
    "owl": OWL,
    "rdf": RDF,
    "rdfs": RDFS,
    "xsd": XSD,
    "sh": SH,
}

NOTES = {
    V.rank: "The place of a definition, or of a constraint of a type, among its like",
    V.order: "The order of a type's attributes, by name",
    V.parts: "The order of the types of its parts, by name",
    V.unit: "A unit that pint knows",
    V.tolerance: "How far two values may differ and still be equal, in the unit",
    V.default: "A value that objects of the type have unless they say otherwise: Shape.Height = 0.14, as JSON behind the sign",
    V.driver: "The program that serves devices of the type",
    V.constraint: "A formula in Entish about ?Self that holds for every object of the type",
    V.excludes: "A group: an object is the first argument of one relation of the group at a time",
    V.functional: "Of facts: the first argument stands in the relation to one tuple of others at a time",
    V.symmetric: "Of facts: the arguments may change places",
    V.parameters: "The types of a function's arguments, with a space between two",
    V.reads: "The attribute of its one argument that a function reads",
    V["values"]: "The values of a function, by the names of its arguments, as JSON",
    V.kind: "What a service is for: physical, cognitive or software",
    V.inputs: "Variables and their types: Object: Graspable, Destination: Object",
    V.outputs: "As inputs",
    V.precondition: "Entish: what must hold for the service to be possible",
    V.effect: "Entish: what holds after it",
    V.cost: "Entish: what doing it costs",
    V.handlers: "Procedures for failures and for undoing, as JSON",
}
"""The annotation properties of the vocabulary, and what they are for."""

CLASSES = {
    V.Value: "A value that is made of attributes itself, as a Shape is",
    V.Fact: "A relation that does not hold between two objects, but among one or more than two: an individual for each time that it holds",
    V.Function: "A function of objects with a number as result",
    V.Service: "What devices can do: service types",
}
HAS_PART = V.hasPart
"""Used in cardinalities: sub-objects at any depth."""


def iri(section: Section, name: str) -> URIRef:
    return SPACES[section][quote_name(name)]


def quote_name(name: str) -> str:
    """Names are letters, digits, `_` and `-`, of any script: all of that may stand in an IRI. Names of objects to be may be worse."""
    return name if name.replace("-", "_").isidentifier() else quote(name, safe="")


def local_name(node: URIRef) -> str:
    """The last part of an IRI."""
    text = str(node)
    return unquote(text[max(text.rfind(sign) for sign in "#/:") + 1 :])


def section_of(node: URIRef) -> Section | None:
    """Of which section of ours an IRI is; None when it is somebody else's."""
    return next((section for section, space in SPACES.items() if node.startswith(space)), None)


def argument(number: int) -> URIRef:
    """The property from a fact to one of its arguments, counted from 1."""
    return V[f"argument{number}"]


def literal(value: Value) -> Literal:
    """Numbers are decimals: exact as written, and what Protégé writes, too."""
    match value:
        case bool():
            return Literal(value)
        case int() | float() if isfinite(value):
            return Literal(f"{Decimal(repr(float(value))):f}", datatype=XSD.decimal, normalize=False)
        case int() | float():
            return Literal(str(value), datatype=XSD.double)
        case _:
            return Literal(value)


def bind_prefixes(graph: Graph) -> Graph:
    """The graph with our prefixes."""
    for prefix, space in PREFIXES.items():
        graph.bind(prefix, space, replace=True)
    return graph


def declarations(arity: int) -> Iterator[tuple[URIRef, URIRef, URIRef | Literal]]:
    """The vocabulary's own declarations; `arity`: of the relation with the most arguments."""
    for property, note in NOTES.items():
        yield property, RDF.type, OWL.AnnotationProperty
        yield property, RDFS.comment, Literal(note)
    for name, note in CLASSES.items():
        yield name, RDF.type, OWL.Class
        yield name, RDFS.comment, Literal(note)
    yield HAS_PART, RDF.type, OWL.ObjectProperty
    yield HAS_PART, RDFS.comment, Literal("From an object to its sub-objects, at any depth; for how many of a type there are")
    for number in range(1, arity + 1):
        yield argument(number), RDF.type, OWL.ObjectProperty
        yield argument(number), RDFS.comment, Literal(f"Argument {number} of a fact")
