"""One type of an OWL file: its parent, attributes, parts, defaults and constraints."""

from __future__ import annotations

from msgspec import Struct, structs
from rdflib import OWL, RDF, RDFS, BNode, URIRef
from rdflib.collection import Collection
from rdflib.term import Node

from somrs.ontology.naming import Section
from somrs.ontology.owl.kinds import Kinds
from somrs.ontology.owl.ordering import in_order, read_default
from somrs.ontology.owl.ranges import Unclear
from somrs.ontology.owl.restrictions import MayHave, MustHave, Only, merged, read_restriction
from somrs.ontology.owl.source import Source
from somrs.ontology.owl.words import V
from somrs.ontology.types import ROOT, Constraint, ObjectType, Part, Value


class _Said(Struct, frozen=True):
    """A constraint, and its place among those of its type."""

    rank: float
    constraint: Constraint


def read_type(node: URIRef, source: Source, kinds: Kinds, doc: str) -> ObjectType:
    name = kinds.types[node]
    source.used(node, RDF.type, OWL.Class)
    source.used(node, RDF.type, RDFS.Class)
    reading = _Reading(node, source, kinds)
    reading.restrictions()
    hint = source.text_of(node, V.order)
    return ObjectType(
        name=name,
        parent=reading.parent(name),
        attributes=in_order(reading.may_have, hint),
        required=in_order(reading.must_have, hint),
        parts=tuple(_parts(reading.parts, source.text_of(node, V.parts))),
        constraints=reading.constraints(),
        defaults=reading.defaults(),
        driver=source.text_of(node, V.driver),
        doc=doc,
    )


def _parts(parts: list[Part], hint: str | None) -> list[Part]:
    found = {part.type: part for part in merged(iter(parts))}
    return [found[name] for name in in_order(found, hint)]


class _Reading:
    def __init__(self, node: URIRef, source: Source, kinds: Kinds) -> None:
        self._node, self._source, self._kinds = node, source, kinds
        self.may_have: list[str] = self._by_domain()
        self.must_have: list[str] = []
        self.parts: list[Part] = []
        self._limits: list[Only] = []

    def restrictions(self) -> None:
        source = self._source
        for above in source.graph.objects(self._node, RDFS.subClassOf):
            if isinstance(above, URIRef):
                continue
            try:
                said = read_restriction(above, source, self._kinds.attributes)
            except Unclear as unclear:
                source.note(self._node, f"it is said to be below {unclear}")
                source.used(self._node, RDFS.subClassOf, above)
                source.use(above)
                continue
            source.used(self._node, RDFS.subClassOf, above)
            source.use(above)
            match said:
                case MayHave(attribute):
                    self.may_have.append(attribute)
                case MustHave(attribute):
                    self.must_have.append(attribute)
                case Only():
                    self._limits.append(said)
                case Part():
                    self.parts.append(said)
                case _:
                    source.note(self._node, "it says something of an argument, and is no relation")

    def parent(self, name: str) -> str | None:
        """The nearest class above it."""
        source = self._source
        above = [one for one in source.take(self._node, RDFS.subClassOf) if isinstance(one, URIRef) and one != OWL.Thing]
        nearest = [one for one in above if not any(one in self._far_above(other) for other in above if other != one)]
        names = sorted({source.name(one, Section.TYPES) for one in nearest})
        if len(names) > 1:
            source.problem(self._node, "parent", f"is below {' and '.join(names)}; a type has one parent: keep one of them", name)
        if not names and name != ROOT:
            source.note(self._node, f"it is below no other class; {ROOT} is taken as its parent")
            return ROOT
        return names[0] if names else None

    def _far_above(self, node: Node) -> set[Node]:
        seen: set[Node] = set()
        waiting = [node]
        while waiting:
            for above in self._source.graph.objects(waiting.pop(), RDFS.subClassOf):
                if above not in seen:
                    seen.add(above)
                    waiting.append(above)
        return seen

    def _by_domain(self) -> list[str]:
        """Attributes that say themselves of what they are."""
        source, found = self._source, []
        for property, name in self._kinds.attributes.items():
            for domain in source.graph.objects(property, RDFS.domain):
                union = source.graph.value(domain, OWL.unionOf)
                if domain == self._node or (union is not None and self._node in Collection(source.graph, union)):
                    found.append(name)
                    source.used(property, RDFS.domain, domain)
                    if isinstance(domain, BNode):
                        source.use(domain)
        return found

    def defaults(self) -> dict[str, Value]:
        found: dict[str, Value] = {}
        for one in sorted(map(str, self._source.take(self._node, V.default))):
            try:
                path, value = read_default(one)
            except ValueError as error:
                self._source.problem(self._node, "value", f"the default {one!r} cannot be read ({error}); write such as Weight = 0.3")
            else:
                found[path] = value
        return found

    # Constraints

    def constraints(self) -> tuple[Constraint, ...]:
        found = [self._constraint(only) for only in self._limits]
        for formula in self._source.take(self._node, V.constraint):
            found.append(Constraint(formula=str(formula)))
        said = [self._annotated(constraint) for constraint in found]
        return tuple(one.constraint for one in sorted(said, key=lambda one: (one.rank, str(one.constraint))))

    def _constraint(self, only: Only) -> Constraint:
        limits = only.limits
        return Constraint(attribute=only.path, minimum=limits.minimum, maximum=limits.maximum, values=limits.values)

    def _annotated(self, constraint: Constraint) -> _Said:
        """With its place and its meaning, which are said of the statement."""
        source = self._source
        for axiom in source.graph.subjects(OWL.annotatedSource, self._node):
            if self._is_about(axiom, constraint):
                doc, rank = source.text_of(axiom, RDFS.comment) or "", source.number_of(axiom, V.rank)
                values = in_order(constraint.values, source.text_of(axiom, V.order))
                source.use(axiom)
                return _Said(float("inf") if rank is None else rank, structs.replace(constraint, values=values, doc=doc))
        return _Said(float("inf"), constraint)

    def _is_about(self, axiom: Node, constraint: Constraint) -> bool:
        """Editors may write what is annotated a second time; so what it says counts, not which node it is."""
        target = self._source.graph.value(axiom, OWL.annotatedTarget)
        if target is None:
            return False
        if constraint.formula is not None:
            return str(target) == constraint.formula
        try:
            said = read_restriction(target, self._source, self._kinds.attributes)
        except Unclear:
            return False
        if not isinstance(said, Only):
            return False
        meant = self._constraint(said)
        return set(meant.values) == set(constraint.values) and structs.replace(meant, values=constraint.values) == constraint
