"""A parsed OWL file: its graph, the statements that were imported, and the line of each node."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.sax import SAXParseException

from rdflib import OWL, RDF, RDFS, SH, SKOS, BNode, Graph, Literal, URIRef
from rdflib.plugins.parsers.notation3 import BadSyntax
from rdflib.term import IdentifiedNode, Node

from somrs.entish.parse import KEYWORDS
from somrs.errors import ModelError, Problem
from somrs.ontology.files.loading import NAME
from somrs.ontology.naming import SINGULAR, DefinitionKey, Renaming, Section, find_definition
from somrs.ontology.owl.words import ONTOLOGY, V, local_name, section_of
from somrs.ontology.types import Ontology

ADVICE = {
    OWL.imports: "other files are not read; merge them into this one (in Protégé: Refactor, Merge ontologies)",
    OWL.disjointWith: "it is not kept; types have one parent each, so types on different branches are disjoint anyway",
    OWL.disjointUnionOf: "it is not kept; types have one parent each, so types on different branches are disjoint anyway",
    OWL.equivalentClass: "it is not kept; state it as `SubClass Of`, or as a formula with somrs:constraint",
    OWL.propertyDisjointWith: "it is not kept; relations that exclude each other name the same group with somrs:excludes",
    OWL.inverseOf: "it is not kept; name the relation in one direction only",
    RDFS.subPropertyOf: "it is not kept; attributes and relations stand by themselves",
    OWL.equivalentProperty: "it is not kept; use one of the two",
    RDFS.seeAlso: "it is not kept; put it into the comment",
    SKOS.prefLabel: "it is not kept; names are rdfs:label without a language",
    OWL.sameAs: "it is not kept; an object has one name",
    OWL.differentFrom: "it is not needed: different names are different objects",
}
"""By property: advice for statements that SO-MRS has no equivalent for."""

KINDS = {
    OWL.TransitiveProperty: "relations are not transitive; effects of services say what follows",
    OWL.InverseFunctionalProperty: "a relation is functional from its first argument only",
    OWL.AsymmetricProperty: "it is not kept",
    OWL.ReflexiveProperty: "it is not kept",
    OWL.IrreflexiveProperty: "it is not kept",
    OWL.AllDisjointClasses: "it is not kept; types have one parent each, so types on different branches are disjoint anyway",
    OWL.AllDifferent: "it is not needed: different names are different objects",
}
"""By class: advice for declarations that SO-MRS has no equivalent for."""

_UNSUPPORTED_NOTE = "SO-MRS has no equivalent for it, and it is not kept"


class Source:
    """The graph of a file. It records which statements were used; `note_unused` makes notes of the others."""

    def __init__(self, text: str, file: str, base: Ontology) -> None:
        self.text, self.file, self._base = text, file, base
        self.problems: list[Problem] = []
        self.notes: list[Problem] = []
        self.renamings: list[Renaming] = []
        self.removed: list[DefinitionKey] = []
        self.graph = self._parsed()
        self._used_statements: set[tuple[Node, Node, Node]] = set()
        self._names: dict[IdentifiedNode, str] = {}

    # Text

    def _parsed(self) -> Graph:
        graph = Graph(bind_namespaces="none")
        is_xml = self.text.lstrip("\ufeff \t\r\n").startswith("<?xml") or "<rdf:RDF" in self.text
        if is_xml and "<!DOCTYPE" in self.text:
            raise self._broken(None, "has a document type declaration, which is not read; save the file as Turtle")
        try:
            graph.parse(data=self.text, format="xml" if is_xml else "turtle")
        except BadSyntax as error:
            raise self._broken(
                error.lines + 1, f"this is not Turtle: {error._why}"
            ) from None  # there is no public attribute with the reason
        except SAXParseException as error:
            raise self._broken(error.getLineNumber(), f"this is not XML: {error.getMessage()}") from None
        except Exception as error:  # noqa: BLE001  # rdflib's parsers raise all kinds of exceptions
            raise self._broken(None, f"this is neither Turtle nor RDF/XML: {error}") from None
        return graph

    def _broken(self, line: int | None, message: str) -> ModelError:
        return ModelError([Problem(file=self.file, line=line, subject="file", rule="syntax", message=message)])

    def line(self, node: Node) -> int | None:
        """The line where a node is first the subject of a statement, or else where it first occurs; None for nodes without an IRI."""
        if not isinstance(node, URIRef):
            return None
        name = re.escape(str(node)[len(str(node)) - len(local_name(node)) :] or str(node))
        whole = rf"(?:[^<>\"'\n]*[#/:])?{name}"
        for pattern in (rf"^\s*(?:<{whole}>|[\w.-]*:{name})\s", rf"rdf:about=([\"']){whole}\1", rf"(?<![\w-]){name}(?![\w-])"):
            if (match := re.search(pattern, self.text, re.MULTILINE)) is not None:
                start = match.start() + len(match[0]) - len(match[0].lstrip())
                return self.text.count("\n", 0, start) + 1
        return None

    def problem(self, node: Node, rule: str, message: str, name: str = "") -> None:
        """Record a problem. A file with problems is not imported."""
        self.problems.append(
            Problem(file=self.file, line=self.line(node), subject=name or self.display_name(node), rule=rule, message=message)
        )

    def note(self, node: Node, message: str) -> None:
        """Record something that is not imported."""
        self.notes.append(Problem(file=self.file, line=self.line(node), subject=self.display_name(node), rule="not-kept", message=message))

    def display_name(self, node: Node) -> str:
        """The name of a node in messages."""
        if isinstance(node, BNode):
            return "something without a name"
        return local_name(node) if isinstance(node, URIRef) else str(node)

    # Statements

    def take_objects(self, subject: Node, predicate: Node) -> list[Node]:
        """The objects of the statements, in no particular order. The statements are marked as used."""
        objects = list(self.graph.objects(subject, predicate))
        self._used_statements.update((subject, predicate, object) for object in objects)
        return objects

    def text_of(self, subject: Node, predicate: Node) -> str | None:
        """The text; None if there is none; of several, the first in alphabetical order."""
        texts = sorted(str(object) for object in self.take_objects(subject, predicate) if isinstance(object, Literal))
        if len(texts) > 1:
            self.note(subject, f"{self.display_name(predicate)} occurs {len(texts)} times; the first is used")
        return texts[0] if texts else None

    def number_of(self, subject: Node, predicate: Node) -> float | None:
        text = self.text_of(subject, predicate)
        try:
            return float(text) if text is not None else None
        except ValueError:
            self.problem(subject, "value", f"{self.display_name(predicate)} is a number, not {text!r}")
            return None

    def rank(self, subject: Node) -> tuple[float, str]:
        """The sort key that restores the original order of definitions; new ones come last, by name."""
        number = self.number_of(subject, V.rank)
        return (number if number is not None else float("inf"), self.display_name(subject))

    def mark_subtree_used(self, node: Node) -> None:
        """Mark all statements about a node, and about the blank nodes below it, as used."""
        waiting, visited_nodes = [node], set[Node]()
        while waiting:
            current = waiting.pop()
            visited_nodes.add(current)
            for predicate, object in self.graph.predicate_objects(current):
                self._used_statements.add((current, predicate, object))
                if isinstance(object, BNode) and object not in visited_nodes:
                    waiting.append(object)

    def mark_used(self, subject: Node, predicate: Node, object: Node) -> None:
        self._used_statements.add((subject, predicate, object))

    def _is_new(self, statement: tuple[Node, Node, Node]) -> bool:
        return statement not in self._used_statements

    # Names

    def name(self, node: Node, section: Section) -> str:
        """The name of a node: the one in its IRI, if it is an IRI of SO-MRS for a known definition; otherwise its label or the end of its
        IRI."""
        assert isinstance(node, URIRef), "only nodes with an IRI have a name"
        if node not in self._names:
            self._names[node] = self._named(node, section)
        return self._names[node]

    def _named(self, node: URIRef, section: Section) -> str:
        plain = self._labels(node)
        name = local_name(node)
        if section_of(node) is section and (not plain or name in plain):
            return name
        if section is Section.OBJECTS and section_of(node) is section:
            self.note(node, f"the label {plain[0]!r} does not rename an object; give it another name on the map itself")
            return name
        if section_of(node) is section and find_definition(self._base, DefinitionKey(section=section, name=name)) is not None:
            if _is_name(plain[0]):
                self.renamings.append(Renaming(section=section, name=name, to=plain[0]))
            else:
                self.note(node, f"the label {plain[0]!r} is no name (letters, digits, _ and -), so that it keeps its own")
            return name
        chosen_label = next((label for label in [*plain, name] if _is_name(label)), None)
        if chosen_label is None:
            message = f"is no name for a {SINGULAR[section]}; give it a label of a letter and then letters, digits, _ or -"
            self.problem(node, "name", message)
        return chosen_label or name

    def _labels(self, node: Node) -> list[str]:
        """The labels of the node without a language tag, sorted."""
        labels = [label for label in self.graph.objects(node, RDFS.label) if isinstance(label, Literal) and not label.language]
        for label in labels:
            self.mark_used(node, RDFS.label, label)
        return sorted(map(str, labels))

    # Unused statements

    def note_unused(self) -> None:
        """Make a note of each statement that was not used."""
        inner = {object for _, _, object in self.graph if isinstance(object, BNode)}
        rest = sorted(
            (
                statement
                for statement in self.graph
                if self._is_new(statement) and not (isinstance(statement[0], BNode) and statement[0] in inner)
            ),
            key=lambda statement: tuple(map(str, statement)),
        )
        for subject, predicate, object in rest:
            self.note(subject, self._unknown(subject, predicate, object))

    def _unknown(self, subject: Node, predicate: Node, object: Node) -> str:
        if predicate == RDF.type:
            return f"it is declared as {self.short(object)}: {KINDS.get(object, _UNSUPPORTED_NOTE)}"  # type: ignore[call-overload]  # any node
        if subject == ONTOLOGY and predicate not in ADVICE:
            return f"{self.short(predicate)} of the ontology: {_UNSUPPORTED_NOTE}"
        advice = ADVICE.get(predicate, _UNSUPPORTED_NOTE)  # type: ignore[call-overload]  # any node
        object_text = f" {self.short(object)}" if not isinstance(object, BNode) else ""
        return f"{self.short(predicate)}{object_text}: {advice}"

    def short(self, node: Node) -> str:
        """The name of a node, with the prefix of its vocabulary if it is a common one."""
        text = self.display_name(node)
        for prefix, space in (("owl", OWL), ("rdfs", RDFS), ("rdf", RDF), ("sh", SH), ("somrs", V)):
            if isinstance(node, URIRef) and node.startswith(str(space)):
                return f"{prefix}:{text}"
        return text if len(text) < 60 else f"{text[:57]}..."


def _is_name(text: str) -> bool:
    return NAME.fullmatch(text) is not None and text not in KEYWORDS


def sorted_iris(nodes: Iterator[Node]) -> list[URIRef]:
    """The nodes with an IRI, each once, sorted."""
    return sorted({node for node in nodes if isinstance(node, URIRef)})
