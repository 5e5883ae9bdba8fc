"""The vocabulary of the OWL files: the IRIs of definitions and objects, and the terms that OWL itself lacks."""

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
"""Each section has its own namespace, because an attribute and a type may have the same name."""

VALUES = Namespace("urn:so-mrs:value:")
"""The classes of the values of complex attributes, and these values."""
SHAPES = Namespace("urn:so-mrs:shape:")
V = Namespace("urn:so-mrs:owl:")
"""Terms that OWL lacks."""

_PREFIXES = {
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
    V.rank: "The position of a definition in its section, or of a constraint in its type",
    V.order: "The order of a type's attributes, by name",
    V.parts: "The order of the types of its parts, by name",
    V.closed: "true: objects of the type, and of types below it, have only parts of the types that have a cardinality here",
    V.unit: "A unit that pint knows",
    V.tolerance: "Two values that differ by at most this much, in the unit, are equal",
    V.default: "A default value for objects of the type: Shape.Height = 0.14, with JSON after the sign",
    V.driver: "The program that serves devices of the type",
    V.constraint: "A formula in Entish about ?Self that holds for every object of the type",
    V.excludes: "A group: an object is the first argument of at most one relation of the group at a time",
    V.functional: "Of facts: each first argument occurs in at most one fact of the relation at a time",
    V.symmetric: "Of facts: the order of the arguments does not matter",
    V.parameters: "The types of a function's arguments, separated by spaces",
    V.reads: "The attribute of its single argument that a function reads",
    V["values"]: "The values of a function, by the names of its arguments, as JSON",
    V.kind: "The kind of a service: physical, cognitive or software",
    V.inputs: "Variables and their types: Object: Graspable, Destination: Object",
    V.outputs: "As inputs",
    V.precondition: "Entish: the formula that must hold before the service",
    V.invariant: "Entish: the formula that must hold as long as the service runs",
    V.effect: "Entish: the formula that holds after the service",
    V.cost: "Entish: the estimated cost of the service",
    V.handlers: "Procedures for failures and compensation, as JSON",
}
"""The annotation properties of the vocabulary, with their descriptions."""

_CLASSES = {
    V.Value: "A value that is a group of attributes, such as Shape",
    V.Fact: "A relation of one object, or of more than two: each fact is an individual",
    V.Function: "A function of objects whose result is a number",
    V.Service: "A service type: what devices can offer",
}
HAS_PART = V.hasPart
"""From an object to its sub-objects at any depth; for cardinalities."""


def iri(section: Section, name: str) -> URIRef:
    return SPACES[section][quote_name(name)]


def quote_name(name: str) -> str:
    """The name for an IRI. Valid names need no quoting: letters of any script, digits, `_` and `-` are allowed in IRIs."""
    return name if name.replace("-", "_").isidentifier() else quote(name, safe="")


def local_name(node: URIRef) -> str:
    """The last part of an IRI."""
    text = str(node)
    return unquote(text[max(text.rfind(sign) for sign in "#/:") + 1 :])


def section_of(node: URIRef) -> Section | None:
    """The section of an IRI of SO-MRS; None for other IRIs."""
    return next((section for section, space in SPACES.items() if node.startswith(space)), None)


def argument(number: int) -> URIRef:
    """The property from a fact to one of its arguments, counted from 1."""
    return V[f"argument{number}"]


def literal(value: Value) -> Literal:
    """The literal for a value. Numbers are decimals, which are exact and which Protégé writes as well."""
    match value:
        case bool():
            return Literal(value)
        case int() | float() if isfinite(value):
            return Literal(Decimal(repr(float(value))))
        case int() | float():
            return Literal(str(value), datatype=XSD.double)
        case _:
            return Literal(value)


def bind_prefixes(graph: Graph) -> Graph:
    """Bind the prefixes of the vocabulary in the graph, and return it."""
    for prefix, space in _PREFIXES.items():
        graph.bind(prefix, space, replace=True)
    return graph


def declarations(arity: int) -> Iterator[tuple[URIRef, URIRef, URIRef | Literal]]:
    """The declarations of the vocabulary; `arity` is the largest number of arguments of a relation."""
    for property, note in NOTES.items():
        yield property, RDF.type, OWL.AnnotationProperty
        yield property, RDFS.comment, Literal(note)
    for name, note in _CLASSES.items():
        yield name, RDF.type, OWL.Class
        yield name, RDFS.comment, Literal(note)
    yield HAS_PART, RDF.type, OWL.ObjectProperty
    yield HAS_PART, RDFS.comment, Literal("From an object to its sub-objects at any depth; for cardinalities")
    for number in range(1, arity + 1):
        yield argument(number), RDF.type, OWL.ObjectProperty
        yield argument(number), RDFS.comment, Literal(f"Argument {number} of a fact")
