"""Writes the rules for maps as SHACL shapes, so that other validators can check a map.

The shapes are derived from the definitions. Rules that SHACL cannot express are left to `conformance.py`: formulas, the single root of a
map, and the place of each object.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rdflib import OWL, RDF, SH, Graph, Literal, URIRef
from rdflib.term import IdentifiedNode, Node

from somrs.ontology.naming import Section
from somrs.ontology.owl.definitions import is_binary
from somrs.ontology.owl.ranges import DATATYPES, Nodes, list_of
from somrs.ontology.owl.words import SHAPES, VALUES, V, argument, iri, literal, quote_name
from somrs.ontology.types import PART_OF, ROOT, AttributeType, Constraint, Kind, ObjectType, Ontology, Part, RelationType


def write_shapes(ontology: Ontology, graph: Graph, nodes: Nodes) -> None:
    """Add the shapes to the graph."""
    _Shapes(ontology, graph, nodes).write()


class _Shapes:
    def __init__(self, ontology: Ontology, graph: Graph, nodes: Nodes) -> None:
        self._ontology, self._graph, self._nodes = ontology, graph, nodes
        self._owner_classes: dict[str, list[IdentifiedNode]] = {}
        """The classes whose instances may have an attribute."""

    def write(self) -> None:
        for type in self._ontology.types.values():
            for name in (*type.attributes, *type.required):
                self._owner_classes.setdefault(name, []).append(iri(Section.TYPES, type.name))
        for attribute in self._ontology.attributes.values():
            for name in attribute.attributes:
                self._owner_classes.setdefault(name, []).append(VALUES[quote_name(attribute.name)])
        for attribute in self._ontology.attributes.values():
            self._attribute(attribute)
        for type in self._ontology.types.values():
            self._type(type)
        for relation in self._ontology.relations.values():
            self._relation(relation)
        self._groups()
        self._map()

    def _add(self, subject: IdentifiedNode, **statements: Node | None) -> None:
        for name, object in statements.items():
            if object is not None:
                self._graph.add((subject, SH[name], object))

    def _shape(self, name: str, message: str = "", **target: Node) -> URIRef:
        shape = SHAPES[quote_name(name) if "." not in name else name]
        self._graph.add((shape, RDF.type, SH.NodeShape))
        self._add(shape, **target, message=Literal(message) if message else None)
        return shape

    def _property(self, shape: IdentifiedNode, path: Node, **limits: Node | None) -> None:
        node = self._nodes.new()
        self._add(node, path=path, **limits)
        self._add(shape, property=node)

    def _list(self, items: Sequence[Node]) -> IdentifiedNode:
        return list_of(items, self._graph, self._nodes)

    def _of_class(self, classes: Iterable[Node]) -> list[Node]:
        class_nodes: list[Node] = []
        for name in classes:
            node = self._nodes.new()
            self._add(node, **{"class": name})
            class_nodes.append(node)
        return class_nodes

    # Attributes

    def _attribute(self, attribute: AttributeType) -> None:
        word = iri(Section.ATTRIBUTES, attribute.name)
        shape = self._shape(f"attribute.{quote_name(attribute.name)}", targetSubjectsOf=word)
        max_count = Literal(1)
        if attribute.kind is Kind.COMPLEX:
            self._property(shape, word, maxCount=max_count, **{"class": VALUES[quote_name(attribute.name)]})
        else:
            limits = self._limits(attribute.minimum, attribute.maximum, attribute.values)
            self._property(shape, word, maxCount=max_count, datatype=DATATYPES[attribute.kind], **limits)
        owner_classes = self._owner_classes.get(attribute.name, [])
        if owner_classes:
            self._add(shape, **{"or": self._list(self._of_class(owner_classes))})
        else:
            self._property(shape, word, maxCount=Literal(0))

    def _limits(self, minimum: float | None, maximum: float | None, values: Sequence[float | str | bool]) -> dict[str, Node]:
        facets: dict[str, Node] = {}
        if minimum is not None:
            facets["minInclusive"] = literal(minimum)
        if maximum is not None:
            facets["maxInclusive"] = literal(maximum)
        if values:
            facets["in"] = self._list([literal(value) for value in values])
        return facets

    # Types

    def _type(self, type: ObjectType) -> None:
        word = iri(Section.TYPES, type.name)
        shape = self._shape(f"type.{quote_name(type.name)}", targetClass=word)
        for name in type.required:
            self._required(shape, type.name, name)
        for part in type.parts:
            self._part(shape, part)
        for constraint in type.constraints:
            if constraint.attribute is not None:
                self._constraint(shape, constraint)

    def _required(self, shape: URIRef, type_name: str, name: str) -> None:
        """Add a required attribute. Objects whose type has a default for it are exempt."""
        path = iri(Section.ATTRIBUTES, name)
        if any(self._defaults(ancestor, name) for ancestor in self._ontology.ancestors(type_name)):
            return
        exempt = [iri(Section.TYPES, subtype) for subtype in self._ontology.subtypes(type_name) if self._defaults(subtype, name)]
        if not exempt:
            self._property(shape, path, minCount=Literal(1))
            return
        attribute_shape = self._nodes.new()
        self._property(attribute_shape, path, minCount=Literal(1))
        alternatives = self._list([attribute_shape, *self._of_class(exempt)])
        self._graph.add((shape, SH["or"], alternatives))

    def _defaults(self, type_name: str, name: str) -> bool:
        return any(path.split(".")[0] == name for path in self._ontology.types[type_name].defaults)

    def _part(self, shape: URIRef, part: Part) -> None:
        part_path, inverse = self._nodes.new(), self._nodes.new()
        self._add(inverse, inversePath=iri(Section.RELATIONS, PART_OF))
        self._add(part_path, oneOrMorePath=inverse)
        (of_class,) = self._of_class([iri(Section.TYPES, part.type)])
        max_count = Literal(part.maximum) if part.maximum is not None else None
        self._property(shape, part_path, qualifiedValueShape=of_class, qualifiedMinCount=Literal(part.minimum), qualifiedMaxCount=max_count)

    def _constraint(self, shape: URIRef, constraint: Constraint) -> None:
        assert constraint.attribute is not None, "only constraints on attributes have shapes"
        steps = [iri(Section.ATTRIBUTES, step) for step in constraint.attribute.split(".")]
        path = steps[0] if len(steps) == 1 else self._list(steps)
        message = Literal(constraint.doc) if constraint.doc else None
        attribute = self._ontology.attributes.get(constraint.attribute.rpartition(".")[2])
        if attribute is not None and attribute.kind is Kind.COMPLEX:
            return  # the values are individuals of the attribute's own class; SO-MRS checks what they conform to
        self._property(shape, path, message=message, **self._limits(constraint.minimum, constraint.maximum, constraint.values))

    # Relations

    def _relation(self, relation: RelationType) -> None:
        word = iri(Section.RELATIONS, relation.name)
        name = f"relation.{quote_name(relation.name)}"
        joined = [iri(Section.TYPES, type_name) for type_name in relation.joins]
        if not is_binary(relation):
            self._facts(relation, name, word, joined)
            return
        self._add(self._shape(f"{name}.from", targetSubjectsOf=word), **{"class": joined[0]})
        self._add(self._shape(f"{name}.to", targetObjectsOf=word), **{"class": joined[1]})
        if relation.functional:
            self._property(SHAPES[f"{name}.from"], word, maxCount=Literal(1))
        arity_shape = self._shape(f"{name}.many", f"{relation.name} joins 2 objects", targetClass=word)
        self._property(arity_shape, argument(1), maxCount=Literal(0))

    def _facts(self, relation: RelationType, name: str, word: URIRef, joined: Sequence[URIRef]) -> None:
        shape = self._shape(name, targetClass=word)
        for number, type_name in enumerate(joined, 1):
            self._property(shape, argument(number), minCount=Literal(1), maxCount=Literal(1), **{"class": type_name})
        self._add(shape, closed=Literal(True), ignoredProperties=self._list([RDF.type]))
        if relation.functional:
            twice = f"?one a <{word}> ; <{argument(1)}> $this . ?other a <{word}> ; <{argument(1)}> $this . FILTER (?one != ?other)"
            functional_shape = self._shape(f"{name}.once", f"{relation.name} holds at most once for an object", targetObjectsOf=argument(1))
            self._sparql(functional_shape, twice)

    def _sparql(self, shape: URIRef, pattern: str) -> None:
        node = self._nodes.new()
        self._add(node, select=Literal(f"SELECT DISTINCT $this WHERE {{ {pattern} }}"))
        self._add(shape, sparql=node)

    def _groups(self) -> None:
        """Add shapes for the groups of relations that exclude each other."""
        groups: dict[str, list[RelationType]] = {}
        for relation in self._ontology.relations.values():
            if relation.excludes:
                groups.setdefault(relation.excludes, []).append(relation)
        for group, relations in groups.items():
            pairs = [
                f"{{ {_fact_pattern(first_relation, 1)} {_fact_pattern(second_relation, 2)} }}"
                for index, first_relation in enumerate(relations)
                for second_relation in relations[index + 1 :]
            ]
            if not pairs:
                continue
            message = f"Of {', '.join(relation.name for relation in relations)}, one holds at a time"
            shape = self._shape(f"group.{quote_name(group)}", message)
            for relation in relations:
                if is_binary(relation):
                    self._add(shape, targetSubjectsOf=iri(Section.RELATIONS, relation.name))
                else:
                    self._add(shape, targetObjectsOf=argument(1))
            self._sparql(shape, " UNION ".join(pairs))

    def _map(self) -> None:
        if PART_OF in self._ontology.relations:
            part_of = iri(Section.RELATIONS, PART_OF)
            shape = self._shape("cycle", "Nothing is a part of itself", targetSubjectsOf=part_of)
            self._sparql(shape, f"$this <{part_of}>+ $this")
        object_shape = self._shape("object", "Every object has a known type", targetClass=OWL.NamedIndividual)
        self._add(object_shape, **{"or": self._list(self._of_class([iri(Section.TYPES, ROOT), V.Value, V.Function]))})


def _fact_pattern(relation: RelationType, number: int) -> str:
    """The SPARQL pattern for a fact of the relation with `$this` as its first argument."""
    word = iri(Section.RELATIONS, relation.name)
    if is_binary(relation):
        return f"$this <{word}> ?to{number} ."
    return f"?fact{number} a <{word}> ; <{argument(1)}> $this ."
