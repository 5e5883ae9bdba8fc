"""Reads one type of an OWL file: its parent, attributes, parts, defaults and constraints."""

from __future__ import annotations

from msgspec import Struct, structs
from rdflib import OWL, RDF, RDFS, BNode, URIRef
from rdflib.collection import Collection
from rdflib.term import Node

from somrs.ontology.naming import Section
from somrs.ontology.owl.kinds import Kinds
from somrs.ontology.owl.ordering import in_order, read_default
from somrs.ontology.owl.ranges import Unclear
from somrs.ontology.owl.restrictions import AttributeLimits, OptionalAttribute, RequiredAttribute, merge_parts, read_restriction
from somrs.ontology.owl.source import Source
from somrs.ontology.owl.words import V
from somrs.ontology.types import ROOT, Constraint, ObjectType, Part, Value


class _RankedConstraint(Struct, frozen=True):
    """A constraint, and its position among those of its type."""

    rank: float
    constraint: Constraint


def read_type(node: URIRef, source: Source, kinds: Kinds, doc: str) -> ObjectType:
    name = kinds.types[node]
    source.mark_used(node, RDF.type, OWL.Class)
    source.mark_used(node, RDF.type, RDFS.Class)
    reading = _Reading(node, source, kinds)
    reading.restrictions()
    hint = source.text_of(node, V.order)
    return ObjectType(
        name=name,
        parent=reading.parent(name),
        attributes=in_order(reading.optional_attributes, hint),
        required=in_order(reading.required_attributes, hint),
        parts=tuple(_parts(reading.parts, source.text_of(node, V.parts))),
        closed=source.text_of(node, V.closed) == "true",
        constraints=ConstraintReader(node, source, kinds).read(reading.limits),
        defaults=reading.defaults(),
        driver=source.text_of(node, V.driver),
        doc=doc,
    )


def _parts(parts: list[Part], hint: str | None) -> list[Part]:
    part_by_type = {part.type: part for part in merge_parts(iter(parts))}
    return [part_by_type[name] for name in in_order(part_by_type, hint)]


class _Reading:
    def __init__(self, node: URIRef, source: Source, kinds: Kinds) -> None:
        self._node, self._source, self._kinds = node, source, kinds
        self.optional_attributes: list[str] = self._by_domain()
        self.required_attributes: list[str] = []
        self.parts: list[Part] = []
        self.limits: list[AttributeLimits] = []

    def restrictions(self) -> None:
        source = self._source
        for superclass in source.graph.objects(self._node, RDFS.subClassOf):
            if isinstance(superclass, URIRef):
                continue
            try:
                restriction = read_restriction(superclass, source, self._kinds.attributes)
            except Unclear as unclear:
                source.note(self._node, f"its superclass is {unclear}")
                source.mark_used(self._node, RDFS.subClassOf, superclass)
                source.mark_subtree_used(superclass)
                continue
            source.mark_used(self._node, RDFS.subClassOf, superclass)
            source.mark_subtree_used(superclass)
            match restriction:
                case OptionalAttribute(attribute):
                    self.optional_attributes.append(attribute)
                case RequiredAttribute(attribute):
                    self.required_attributes.append(attribute)
                case AttributeLimits():
                    self.limits.append(restriction)
                case Part():
                    self.parts.append(restriction)
                case _:
                    source.note(self._node, "it has a rule for an argument, and is not a relation")

    def parent(self, name: str) -> str | None:
        """The name of the nearest superclass; None for the root."""
        source = self._source
        superclasses = [
            class_node
            for class_node in source.take_objects(self._node, RDFS.subClassOf)
            if isinstance(class_node, URIRef) and class_node != OWL.Thing
        ]
        nearest = [
            class_node
            for class_node in superclasses
            if not any(class_node in self._superclasses(other_class) for other_class in superclasses if other_class != class_node)
        ]
        names = sorted({source.name(class_node, Section.TYPES) for class_node in nearest})
        if len(names) > 1:
            source.problem(self._node, "parent", f"has the parents {' and '.join(names)}; a type has one parent: keep one of them", name)
        if not names and name != ROOT:
            source.note(self._node, f"it has no superclass; {ROOT} is used as its parent")
            return ROOT
        return names[0] if names else None

    def _superclasses(self, node: Node) -> set[Node]:
        superclasses: set[Node] = set()
        waiting = [node]
        while waiting:
            for superclass in self._source.graph.objects(waiting.pop(), RDFS.subClassOf):
                if superclass not in superclasses:
                    superclasses.add(superclass)
                    waiting.append(superclass)
        return superclasses

    def _by_domain(self) -> list[str]:
        """The attributes whose domain includes the type."""
        source, names = self._source, []
        for property, name in self._kinds.attributes.items():
            for domain in source.graph.objects(property, RDFS.domain):
                union = source.graph.value(domain, OWL.unionOf)
                if domain == self._node or (union is not None and self._node in Collection(source.graph, union)):
                    names.append(name)
                    source.mark_used(property, RDFS.domain, domain)
                    if isinstance(domain, BNode):
                        source.mark_subtree_used(domain)
        return names

    def defaults(self) -> dict[str, Value]:
        default_values: dict[str, Value] = {}
        for text in sorted(map(str, self._source.take_objects(self._node, V.default))):
            try:
                path, value = read_default(text)
            except ValueError as error:
                self._source.problem(self._node, "value", f"the default {text!r} cannot be read ({error}); write such as Weight = 0.3")
            else:
                default_values[path] = value
        return default_values


class ConstraintReader:
    """Reads the constraints of a class: of a type, or of the values of a complex attribute."""

    def __init__(self, node: URIRef, source: Source, kinds: Kinds) -> None:
        self._node, self._source, self._kinds = node, source, kinds

    def read(self, attribute_limits: list[AttributeLimits]) -> tuple[Constraint, ...]:
        constraints = [self._constraint(restriction) for restriction in attribute_limits]
        for formula in self._source.take_objects(self._node, V.constraint):
            constraints.append(Constraint(formula=str(formula)))
        ranked_constraints = [self._annotated(constraint) for constraint in constraints]
        return tuple(
            ranked_constraint.constraint
            for ranked_constraint in sorted(
                ranked_constraints, key=lambda ranked_constraint: (ranked_constraint.rank, str(ranked_constraint.constraint))
            )
        )

    def _constraint(self, restriction: AttributeLimits) -> Constraint:
        limits = restriction.limits
        return Constraint(attribute=restriction.path, minimum=limits.minimum, maximum=limits.maximum, values=limits.values)

    def _annotated(self, constraint: Constraint) -> _RankedConstraint:
        """The constraint with its position and documentation, which are annotations of its statement."""
        source = self._source
        for axiom in source.graph.subjects(OWL.annotatedSource, self._node):
            if self._is_annotation_of(axiom, constraint):
                doc, rank = source.text_of(axiom, RDFS.comment) or "", source.number_of(axiom, V.rank)
                values = in_order(constraint.values, source.text_of(axiom, V.order))
                source.mark_subtree_used(axiom)
                return _RankedConstraint(float("inf") if rank is None else rank, structs.replace(constraint, values=values, doc=doc))
        return _RankedConstraint(float("inf"), constraint)

    def _is_annotation_of(self, axiom: Node, constraint: Constraint) -> bool:
        """Whether the axiom annotates the constraint. Editors may duplicate the annotated node, so the content is compared."""
        target = self._source.graph.value(axiom, OWL.annotatedTarget)
        if target is None:
            return False
        if constraint.formula is not None:
            return str(target) == constraint.formula
        try:
            restriction = read_restriction(target, self._source, self._kinds.attributes)
        except Unclear:
            return False
        if not isinstance(restriction, AttributeLimits):
            return False
        target_constraint = self._constraint(restriction)
        return (
            set(target_constraint.values) == set(constraint.values)
            and structs.replace(target_constraint, values=constraint.values) == constraint
        )
