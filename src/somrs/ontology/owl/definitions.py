"""Writes definitions as OWL 2: types become classes, attributes and relations properties, required attributes cardinalities."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TypeVar

import msgspec
from rdflib import OWL, RDF, RDFS, XSD, Graph, Literal, URIRef
from rdflib.term import IdentifiedNode, Node

from somrs.ontology.naming import Section
from somrs.ontology.owl.ordering import ordered
from somrs.ontology.owl.ranges import Nodes, Range, list_of, range_node, range_of
from somrs.ontology.owl.words import HAS_PART, ONTOLOGY, VALUES, V, argument, declarations, iri, literal, quote_name
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Constraint, FunctionType, Kind, ObjectType, Ontology, Part, RelationType

D = TypeVar("D")


def write_definitions(ontology: Ontology, graph: Graph, nodes: Nodes) -> None:
    """Add the whole ontology to the graph."""
    _Writer(ontology, graph, nodes).write()


def is_binary(relation: RelationType) -> bool:
    """Whether the relation is a property in OWL; any other relation is a class of facts."""
    return len(relation.joins) == 2


class _Writer:
    def __init__(self, ontology: Ontology, graph: Graph, nodes: Nodes) -> None:
        self._ontology, self._graph, self._nodes = ontology, graph, nodes

    def write(self) -> None:
        self._add(ONTOLOGY, RDF.type, OWL.Ontology)
        for triple in declarations(max((len(relation.joins) for relation in self._ontology.relations.values()), default=0)):
            self._graph.add(triple)
        ontology = self._ontology
        self._write_each(ontology.attributes, self._attribute)
        self._write_each(ontology.relations, self._relation)
        self._write_each(ontology.functions, self._function)
        self._write_each(ontology.types, self._type)
        self._write_each(ontology.services, self._service)

    def _write_each(self, definitions: Mapping[str, D], write: Callable[[D, Literal], None]) -> None:
        for rank, definition in enumerate(definitions.values()):
            write(definition, Literal(rank))

    def _add(self, subject: IdentifiedNode, predicate: URIRef, *objects: Node | None) -> None:
        for object in objects:
            if object is not None:
                self._graph.add((subject, predicate, object))

    def _note(self, subject: IdentifiedNode, **notes: str | float | None) -> None:
        """Add annotations of the vocabulary, except for empty values."""
        for name, value in notes.items():
            if value or (value == 0 and name in ("minimum", "maximum")):
                self._add(subject, V[name], literal(value))

    def _named(self, section: Section, name: str, rank: Literal, doc: str, *kinds: URIRef) -> URIRef:
        subject = iri(section, name)
        self._add(subject, RDF.type, *kinds)
        self._add(subject, RDFS.label, Literal(name))
        self._add(subject, V.rank, rank)
        self._add(subject, RDFS.comment, Literal(doc) if doc else None)
        return subject

    # Attributes

    def _attribute(self, attribute: AttributeType, rank: Literal) -> None:
        kind = OWL.ObjectProperty if attribute.kind is Kind.COMPLEX else OWL.DatatypeProperty
        subject = self._named(Section.ATTRIBUTES, attribute.name, rank, attribute.doc, kind, OWL.FunctionalProperty)
        self._note(subject, unit=attribute.unit, tolerance=attribute.tolerance)
        if attribute.kind is not Kind.COMPLEX:
            self._add(subject, RDFS.range, range_of(attribute, self._graph, self._nodes))
            self._note(subject, order=ordered(attribute.values))
            return
        value = VALUES[quote_name(attribute.name)]
        self._add(subject, RDFS.range, value)
        self._add(value, RDF.type, OWL.Class)
        self._add(value, RDFS.subClassOf, V.Value)
        self._add(value, RDFS.label, Literal(f"{attribute.name} value"))
        self._allow_attributes(value, attribute.attributes)
        self._note(value, order=ordered(attribute.attributes))
        for number, constraint in enumerate(attribute.constraints):
            self._constraint(value, constraint, number)

    def _restriction(self, property_node: Node, *facets: tuple[URIRef, Node]) -> IdentifiedNode:
        node = self._nodes.new()
        self._add(node, RDF.type, OWL.Restriction)
        self._add(node, OWL.onProperty, property_node)
        for facet, value in facets:
            self._add(node, facet, value)
        return node

    def _allow_attributes(self, subject: IdentifiedNode, attributes: Iterable[str]) -> None:
        for name in attributes:
            self._add(subject, RDFS.subClassOf, self._restriction(iri(Section.ATTRIBUTES, name), (OWL.maxCardinality, _count(1))))

    def _require_attributes(self, subject: IdentifiedNode, attributes: Iterable[str]) -> None:
        for name in attributes:
            self._add(subject, RDFS.subClassOf, self._restriction(iri(Section.ATTRIBUTES, name), (OWL.cardinality, _count(1))))

    # Relations

    def _relation(self, relation: RelationType, rank: Literal) -> None:
        if is_binary(relation):
            kinds = [
                OWL.ObjectProperty,
                *([OWL.FunctionalProperty] if relation.functional else []),
                *([OWL.SymmetricProperty] if relation.symmetric else []),
            ]
            subject = self._named(Section.RELATIONS, relation.name, rank, relation.doc, *kinds)
            self._add(subject, RDFS.domain, iri(Section.TYPES, relation.joins[0]))
            self._add(subject, RDFS.range, iri(Section.TYPES, relation.joins[1]))
        else:
            subject = self._named(Section.RELATIONS, relation.name, rank, relation.doc, OWL.Class)
            self._add(subject, RDFS.subClassOf, V.Fact)
            for number, joined in enumerate(relation.joins, 1):
                restriction = self._restriction(argument(number), (OWL.allValuesFrom, iri(Section.TYPES, joined)))
                self._add(subject, RDFS.subClassOf, restriction)
            # OWL has neither property for facts that are individuals.
            self._add(subject, V.functional, Literal(True) if relation.functional else None)
            self._add(subject, V.symmetric, Literal(True) if relation.symmetric else None)
        self._note(subject, excludes=relation.excludes)

    # Functions and services

    def _function(self, function: FunctionType, rank: Literal) -> None:
        subject = self._named(Section.FUNCTIONS, function.name, rank, function.doc, OWL.NamedIndividual, V.Function)
        table = json.dumps(function.values, ensure_ascii=False) if function.values else None
        self._note(subject, parameters=" ".join(function.parameters), reads=function.attribute, unit=function.unit, values=table)

    def _service(self, service: ServiceType, rank: Literal) -> None:
        subject = self._named(Section.SERVICES, service.name, rank, service.doc, OWL.Class)
        self._add(subject, RDFS.subClassOf, iri(Section.SERVICES, service.parent) if service.parent is not None else V.Service)
        handlers = msgspec.json.encode(service.handlers).decode() if service.handlers else None
        self._note(
            subject,
            kind=service.kind.value,
            inputs=_parameters(service.inputs),
            outputs=_parameters(service.outputs),
            precondition=service.precondition,
            invariant=service.invariant,
            effect=service.effect,
            cost=service.cost,
            handlers=handlers,
        )

    # Types

    def _type(self, type: ObjectType, rank: Literal) -> None:
        subject = self._named(Section.TYPES, type.name, rank, type.doc, OWL.Class)
        self._add(subject, RDFS.subClassOf, iri(Section.TYPES, type.parent) if type.parent is not None else None)
        self._allow_attributes(subject, type.attributes)
        self._require_attributes(subject, type.required)
        self._note(subject, order=ordered([*dict.fromkeys((*type.attributes, *type.required))]), driver=type.driver)
        self._note(subject, parts=ordered([part.type for part in type.parts]), closed="true" if type.closed else None)
        for part in type.parts:
            for facet, number in _counts(part):
                on_class = (OWL.onClass, iri(Section.TYPES, part.type))
                self._add(subject, RDFS.subClassOf, self._restriction(HAS_PART, (facet, _count(number)), on_class))
        for path, value in type.defaults.items():
            self._note(subject, default=f"{path} = {json.dumps(value, ensure_ascii=False)}")
        for number, constraint in enumerate(type.constraints):
            self._constraint(subject, constraint, number)

    def _constraint(self, subject: URIRef, constraint: Constraint, rank: int) -> None:
        """Add a constraint to the class. Its position and documentation are annotations of the statement."""
        predicate: URIRef = V.constraint
        target: Node = literal(constraint.formula or "")
        if constraint.attribute is not None:
            predicate, target = (
                RDFS.subClassOf,
                self._value_restriction(constraint.attribute, self._limits(constraint, constraint.attribute)),
            )
        self._add(subject, predicate, target)
        axiom = self._nodes.new()
        self._add(axiom, RDF.type, OWL.Axiom)
        self._add(axiom, OWL.annotatedSource, subject)
        self._add(axiom, OWL.annotatedProperty, predicate)
        self._add(axiom, OWL.annotatedTarget, target)
        self._add(axiom, V.rank, Literal(rank))
        self._note(axiom, order=ordered(constraint.values))
        self._add(axiom, RDFS.comment, Literal(constraint.doc) if constraint.doc else None)

    def _limits(self, constraint: Constraint, path: str) -> IdentifiedNode:
        """The values that the constraint allows: a data range or, of a complex attribute, the classes of its values."""
        attribute = self._ontology.attributes.get(path.rpartition(".")[2])
        if attribute is None or attribute.kind is not Kind.COMPLEX:
            limits = Range(minimum=constraint.minimum, maximum=constraint.maximum, values=constraint.values)
            return range_node(limits, self._graph, self._nodes)
        classes = [VALUES[quote_name(str(name))] for name in constraint.values]
        if len(classes) == 1:
            return classes[0]
        union = self._nodes.new()
        self._add(union, RDF.type, OWL.Class)
        self._add(union, OWL.unionOf, list_of(classes, self._graph, self._nodes))
        return union

    def _value_restriction(self, path: str, values: IdentifiedNode) -> IdentifiedNode:
        """The nested restriction for a path: `Shape only (Height only ...)` for `Shape.Height`."""
        for name in reversed(path.split(".")):
            values = self._restriction(iri(Section.ATTRIBUTES, name), (OWL.allValuesFrom, values))
        return values


def _count(number: int) -> Literal:
    return Literal(str(number), datatype=XSD.nonNegativeInteger, normalize=False)


def _counts(part: Part) -> Iterator[tuple[URIRef, int]]:
    if part.minimum == part.maximum:
        yield OWL.qualifiedCardinality, part.minimum
        return
    if part.minimum or part.maximum is None:
        yield OWL.minQualifiedCardinality, part.minimum
    if part.maximum is not None:
        yield OWL.maxQualifiedCardinality, part.maximum


def _parameters(parameters: tuple[Parameter, ...]) -> str:
    return ", ".join(f"{parameter.name}: {parameter.type}" for parameter in parameters)
