"""Reads definitions and objects from an OWL file: an export of SO-MRS, an edited one, or one from another source."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import msgspec
from rdflib import OWL, RDF, RDFS, SH, URIRef
from rdflib.term import Node

from somrs.errors import ModelError
from somrs.ontology.naming import Section, key_of
from somrs.ontology.owl import OwlImport
from somrs.ontology.owl.kinds import Kinds
from somrs.ontology.owl.ordering import in_order
from somrs.ontology.owl.ranges import Range, Unclear, read_range
from somrs.ontology.owl.reading_map import read_map
from somrs.ontology.owl.reading_shapes import read_shapes
from somrs.ontology.owl.reading_types import ConstraintReader, read_type
from somrs.ontology.owl.restrictions import (
    ArgumentType,
    AttributeLimits,
    OptionalAttribute,
    RequiredAttribute,
    Restriction,
    read_restriction,
)
from somrs.ontology.owl.source import Source, sorted_iris
from somrs.ontology.owl.words import HAS_PART, NOTES, V, local_name
from somrs.ontology.services import Handler, Parameter, ServiceKind, ServiceType
from somrs.ontology.types import ROOT, AttributeType, Constraint, Definition, FunctionType, Kind, ObjectType, Ontology, RelationType

D = TypeVar("D", bound=Definition)
T = TypeVar("T")


def read(text: str, file: str, base: Ontology) -> OwlImport:
    """The content of the file. Raises ModelError with all problems."""
    source = Source(text, file, base)
    reading = _Reading(source, base)
    definitions = reading.definitions()
    ontology = Ontology(definitions)
    map = read_map(source, reading.kinds, base.extended(definitions))
    source.note_unused()
    if source.problems:
        raise ModelError(sorted(dict.fromkeys(source.problems), key=lambda problem: problem.line or 0))
    notes = sorted(dict.fromkeys(source.notes), key=lambda note: (note.line or 0, note.subject))
    renamings = tuple(dict.fromkeys(source.renamings))
    return OwlImport(ontology=ontology, removed=tuple(source.removed), renamings=renamings, map=map, notes=tuple(notes))


class _Reading:
    def __init__(self, source: Source, base: Ontology) -> None:
        self._source, self._base = source, base
        self.kinds = Kinds(source)

    def definitions(self) -> list[Definition]:
        """The definitions, in their original order."""
        self._vocabulary()
        kinds = self.kinds
        definitions: list[Definition] = [
            *self._read_each(kinds.attributes, self._attribute),
            *self._read_each(kinds.relations, self._relation),
            *self._read_each(kinds.functions, self._function),
        ]
        types = {type.name: type for type in self._read_each(kinds.types, self._type)}
        read_shapes(self._source, kinds, types, self._base.extended(definitions))
        return [*definitions, *types.values(), *self._read_each(kinds.services, self._service)]

    def _vocabulary(self) -> None:
        """Mark the vocabulary and the header of the file as used."""
        source = self._source
        for node in [*NOTES, V.Value, V.Fact, V.Function, V.Service, HAS_PART]:
            source.mark_subtree_used(node)
        for subject in sorted_iris(source.graph.subjects()):
            if str(subject).startswith((str(V), str(SH))):
                source.mark_subtree_used(subject)
        for property in sorted_iris(source.graph.subjects(RDF.type, OWL.AnnotationProperty)):
            source.mark_used(property, RDF.type, OWL.AnnotationProperty)
        for ontology in set(source.graph.subjects(RDF.type, OWL.Ontology)):
            source.mark_used(ontology, RDF.type, OWL.Ontology)
            source.take_objects(ontology, OWL.versionInfo)
            source.take_objects(ontology, RDFS.comment)

    def _read_each(self, nodes: Iterable[Node], read: Callable[[URIRef], D | None]) -> list[D]:
        definitions = {node: definition for node in sorted_iris(iter(nodes)) if (definition := read(node)) is not None}
        definitions = {node: definition for node, definition in definitions.items() if not self._is_removed(node, definition)}
        names: dict[str, URIRef] = {}
        for node, definition in definitions.items():
            if definition.name in names:
                other_node = names[definition.name]
                self._source.problem(
                    node, "duplicate", f"has the same name as <{other_node}>; give one of the two another name", definition.name
                )
            names[definition.name] = node
        return [definitions[node] for node in sorted(definitions, key=self._source.rank)]

    def _is_removed(self, node: URIRef, definition: Definition) -> bool:
        if not any(str(mark) in ("true", "1") for mark in self._source.take_objects(node, OWL.deprecated)):
            return False
        self._source.removed.append(key_of(definition))
        return True

    def _doc(self, node: Node) -> str:
        return self._source.text_of(node, RDFS.comment) or ""

    # Attributes

    def _attribute(self, node: URIRef) -> AttributeType | None:
        source, name = self._source, self.kinds.attributes[node]
        if self.kinds.is_mentioned_only(node, self._base.attributes, name):
            return None
        for kind in (OWL.DatatypeProperty, OWL.ObjectProperty, OWL.FunctionalProperty):
            source.mark_used(node, RDF.type, kind)
        doc, unit, tolerance = self._doc(node), source.text_of(node, V.unit), source.number_of(node, V.tolerance)
        ranges = source.take_objects(node, RDFS.range)
        value = next((range_node for range_node in ranges if range_node in self.kinds.values), None)
        if value is not None:
            assert isinstance(value, URIRef), "a class of values has an IRI"
            attributes, constraints = self._values_class(value)
            return AttributeType(name=name, kind=Kind.COMPLEX, attributes=attributes, constraints=constraints, doc=doc)
        limits = self._range(node, ranges)
        return AttributeType(
            name=name,
            kind=limits.kind or Kind.TEXT,
            unit=unit,
            tolerance=tolerance or 0.0,
            minimum=limits.minimum,
            maximum=limits.maximum,
            values=in_order(map(str, limits.values), source.text_of(node, V.order)),
            doc=doc,
        )

    def _range(self, node: URIRef, ranges: list[Node]) -> Range:
        if not ranges:
            self._source.note(node, "it has no range, and is treated as a text; give it one: xsd:decimal, xsd:string, xsd:boolean")
            return Range(kind=Kind.TEXT)
        if len(ranges) > 1:
            self._source.problem(node, "range", f"has {len(ranges)} ranges; an attribute has one")
        try:
            value_range = read_range(ranges[0], self._source.graph)
        except Unclear as unclear:
            self._source.note(node, f"its range is {unclear}; it is treated as a text")
            return Range(kind=Kind.TEXT)
        self._source.mark_subtree_used(ranges[0])
        if value_range.kind is None:
            self._source.note(node, "its range lists values that are not texts; it is treated as an enumeration of names")
        return msgspec.structs.replace(value_range, kind=value_range.kind or Kind.ENUMERATION)

    def _values_class(self, value: URIRef) -> tuple[tuple[str, ...], tuple[Constraint, ...]]:
        """The attributes in a complex attribute, and their constraints, from the class of its values."""
        source = self._source
        source.mark_used(value, RDF.type, OWL.Class)
        source.take_objects(value, RDFS.label)
        source.take_objects(value, RDFS.comment)
        attributes: list[str] = []
        limits: list[AttributeLimits] = []
        for superclass, restriction in self._restrictions(value, V.Value):
            if isinstance(restriction, OptionalAttribute | RequiredAttribute):
                attributes.append(restriction.attribute)
            elif isinstance(restriction, AttributeLimits):
                limits.append(restriction)
            else:
                continue
            self._mark_restriction_used(value, superclass)
        return in_order(attributes, source.text_of(value, V.order)), ConstraintReader(value, source, self.kinds).read(limits)

    def _restrictions(self, node: URIRef, kind: URIRef) -> Iterator[tuple[Node, Restriction]]:
        """The restrictions of a node, each with the superclass that states it. The superclass `kind` states none."""
        source = self._source
        for superclass in source.graph.objects(node, RDFS.subClassOf):
            if superclass == kind:
                source.mark_used(node, RDFS.subClassOf, superclass)
                continue
            try:
                yield superclass, read_restriction(superclass, source, self.kinds.attributes)
            except Unclear as unclear:
                source.note(node, f"says {unclear}")

    def _mark_restriction_used(self, node: URIRef, superclass: Node) -> None:
        self._source.mark_used(node, RDFS.subClassOf, superclass)
        self._source.mark_subtree_used(superclass)

    # Relations

    def _relation(self, node: URIRef) -> RelationType | None:
        source, name = self._source, self.kinds.relations[node]
        if self.kinds.is_mentioned_only(node, self._base.relations, name):
            return None
        functional, symmetric = ((node, RDF.type, kind) in source.graph for kind in (OWL.FunctionalProperty, OWL.SymmetricProperty))
        for kind in (OWL.ObjectProperty, OWL.FunctionalProperty, OWL.SymmetricProperty, OWL.Class):
            source.mark_used(node, RDF.type, kind)
        if node in self.kinds.facts:
            joins = self._arguments(node)
            functional, symmetric = (source.text_of(node, word) == "true" for word in (V.functional, V.symmetric))
        else:
            joins = (self._joined(node, RDFS.domain), self._joined(node, RDFS.range))
        excludes = source.text_of(node, V.excludes)
        return RelationType(name=name, joins=joins, symmetric=symmetric, functional=functional, excludes=excludes, doc=self._doc(node))

    def _joined(self, node: URIRef, side: URIRef) -> str:
        source = self._source
        classes = source.take_objects(node, side)
        named = [class_node for class_node in classes if isinstance(class_node, URIRef) and class_node != OWL.Thing]
        if len(named) == 1 and len(classes) == 1:
            return source.name(named[0], Section.TYPES)
        reason = "it has none" if not classes else "it is not a single named class"
        source.note(node, f"{local_name(side)} must be one class, and {reason}; {ROOT} is used")
        for class_node in classes:
            if not isinstance(class_node, URIRef):
                source.mark_subtree_used(class_node)  # a named class has statements of its own
        return ROOT

    def _arguments(self, node: URIRef) -> tuple[str, ...]:
        source = self._source
        types_by_number: dict[int, str] = {}
        for superclass, restriction in self._restrictions(node, V.Fact):
            if isinstance(restriction, ArgumentType):
                types_by_number[restriction.number] = restriction.type
                self._mark_restriction_used(node, superclass)
        if not types_by_number or sorted(types_by_number) != list(range(1, len(types_by_number) + 1)):
            source.problem(node, "relation", "has no arguments, or misses one; state `argument1 only TYPE`, and so on")
        return tuple(types_by_number[number] for number in sorted(types_by_number))

    # Functions and services

    def _function(self, node: URIRef) -> FunctionType | None:
        source = self._source
        name = self.kinds.functions[node]
        for kind in (OWL.NamedIndividual, V.Function):
            source.mark_used(node, RDF.type, kind)
        table = source.text_of(node, V["values"])
        return FunctionType(
            name=name,
            parameters=tuple((source.text_of(node, V.parameters) or "").split()),
            attribute=source.text_of(node, V.reads),
            values=self._json(node, table, dict[str, float]) if table else {},
            unit=source.text_of(node, V.unit),
            doc=self._doc(node),
        )

    def _json(self, node: URIRef, text: str, type: type[T]) -> T:
        try:
            return msgspec.json.decode(text, type=type)
        except msgspec.MsgspecError as error:
            self._source.problem(node, "value", f"{text[:60]!r} cannot be read: {error}; export the ontology to see how it is written")
            return type()

    def _service(self, node: URIRef) -> ServiceType | None:
        source, name = self._source, self.kinds.services[node]
        if self.kinds.is_mentioned_only(node, self._base.services, name):
            return None
        source.mark_used(node, RDF.type, OWL.Class)
        superclasses = [class_node for class_node in source.take_objects(node, RDFS.subClassOf) if isinstance(class_node, URIRef)]
        parents = sorted(source.name(class_node, Section.SERVICES) for class_node in superclasses if class_node != V.Service)
        if len(parents) > 1:
            source.problem(node, "parent", f"has the parents {' and '.join(parents)}; a service type has one parent", name)
        handlers, kind = source.text_of(node, V.handlers), source.text_of(node, V.kind) or ServiceKind.PHYSICAL.value
        if kind not in [*ServiceKind]:
            source.problem(node, "value", f"the kind is physical, cognitive or software, not {kind!r}")
            kind = ServiceKind.PHYSICAL.value
        effect = source.text_of(node, V.effect)
        if effect is None:
            source.problem(node, "effect", "has no effect; state with somrs:effect what holds after it", name)
        return ServiceType(
            name=name,
            effect=effect or "",
            precondition=source.text_of(node, V.precondition),
            invariant=source.text_of(node, V.invariant),
            inputs=self._parameters(node, source.text_of(node, V.inputs)),
            outputs=self._parameters(node, source.text_of(node, V.outputs)),
            kind=ServiceKind(kind),
            parent=parents[0] if parents else None,
            handlers=tuple(self._json(node, handlers, list[Handler])) if handlers else (),
            cost=source.text_of(node, V.cost),
            doc=self._doc(node),
        )

    def _parameters(self, node: URIRef, text: str | None) -> tuple[Parameter, ...]:
        parameters: list[Parameter] = []
        for part in (text or "").split(",") if text else ():
            name, sign, type = (token.strip() for token in part.partition(":"))
            if not (name and sign and type):
                self._source.problem(node, "value", f"{part.strip()!r} is no variable with its type, such as Object: Graspable")
                continue
            parameters.append(Parameter(name=name.removeprefix("?"), type=type))
        return tuple(parameters)

    # Types

    def _type(self, node: URIRef) -> ObjectType | None:
        if self.kinds.is_mentioned_only(node, self._base.types, self.kinds.types[node]):
            return None
        return read_type(node, self._source, self.kinds, self._doc(node))
