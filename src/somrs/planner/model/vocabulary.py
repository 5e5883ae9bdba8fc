"""The vocabulary of planning problems: what facts are, and which relations and attributes become facts.

A fact is a predicate and its arguments. For a relation, the predicate is its name. For an attribute, the predicate is a dot and the path,
and the arguments are the object and the value (`.Open`, Door1, TRUE). Only relations and attributes that a service on offer can change
become facts; static conditions are evaluated on the map during grounding (`grounding.py`).
"""

from __future__ import annotations

from collections.abc import Iterable

from somrs.entish import Arithmetic, Attribute, Call, Comparison, Formula, Name, Not, Relation, Term, Variable
from somrs.entish.formula import Constant, Literal, conjuncts, terms
from somrs.ontology.types import Kind, Ontology
from somrs.ontology.values import attribute_at
from somrs.planner.model.reading import Reading

Argument = str | Constant
"""The name of an object, or a value."""

Fact = tuple[str, tuple[Argument, ...]]

Pattern = tuple[str, tuple[Argument | Term, ...]]
"""A fact whose arguments may be terms."""

GOAL: Fact = ("", ())
"""The fact that the goal is reached, which the goal's operators add."""

EXISTS_SUFFIX = " *"
"""The fact `isOn *` of an object: it is on any object. Only for relations in which an object has one partner at a time."""

KNOWN = "is known"
"""The predicate of an object that a step can use. It holds for all objects but those that are unknown in the reading of the problem."""


class Inexpressible(Exception):
    """A formula that the planner cannot express as operators, and the reason."""

    def __init__(self, formula: object, reason: str) -> None:
        self.formula, self.reason = formula, reason
        super().__init__(f"{formula}: {reason}")


class Vocabulary:
    """The relations and attributes that the services on offer can change, and which facts replace each other.

    With `counting`, the numbers that services can change are counters instead of facts with a value each.
    """

    def __init__(self, ontology: Ontology, effects: Iterable[Formula], counting: bool = False, reading: Reading | None = None) -> None:
        self.ontology, self.reading = ontology, reading
        self.calculates = False
        """Whether effects calculate numbers, so that there may be too many values to enumerate."""
        self.relations: set[str] = set()
        self.paths: set[str] = set()
        groups: dict[str, list[str]] = {}
        for relation in ontology.relations.values():
            if relation.excludes is not None:
                groups.setdefault(relation.excludes, []).append(relation.name)
        self._groups = groups
        self._excluded: dict[str, tuple[str, ...]] = {}
        self._exclusive: dict[str, bool] = {}
        self._symmetric: dict[str, bool] = {}
        for effect in effects:
            for part in conjuncts(effect):
                match part:
                    case Relation(name) | Not(Relation(name)):
                        self.relations.update([name, *self.excluded_by(name)])
                    case Comparison(left_term, _, right_term):
                        target = left_term if isinstance(left_term, Attribute) else right_term
                        if isinstance(target, Attribute):
                            self.paths.add(target.path)
                            self.calculates |= any(isinstance(side, Arithmetic) for side in (left_term, right_term))
        self.counters: set[str] = {path for path in self.paths if counting and self._is_number(path)}
        self.paths -= self.counters

    def _is_number(self, path: str) -> bool:
        attribute = attribute_at(path, self.ontology)
        return attribute is not None and attribute.kind is Kind.NUMBER

    def excluded_by(self, relation: str) -> tuple[str, ...]:
        """The other relations that an object leaves when it enters this one."""
        if (excluded := self._excluded.get(relation)) is None:
            relation_type = self.ontology.relations.get(relation)
            group = self._groups.get(relation_type.excludes, []) if relation_type and relation_type.excludes else []
            excluded = self._excluded[relation] = tuple(name for name in group if name != relation)
        return excluded

    def variable_of(self, fact: Fact) -> tuple[str, Argument] | None:
        """The state variable of the fact, which facts that replace each other share; None for a fact that replaces no other."""
        predicate, arguments = fact
        if predicate.startswith("."):
            return predicate, arguments[0]
        return (self.place(predicate), arguments[0]) if self.is_exclusive(predicate) else None

    def place(self, relation: str) -> str:
        return self.ontology.relations[relation].excludes or relation

    def is_exclusive(self, relation: str) -> bool:
        """Whether an object has at most one partner in all: in this relation or in one of those that it excludes."""
        if (exclusive := self._exclusive.get(relation)) is None:
            relation_types = [self.ontology.relations.get(name) for name in (relation, *self.excluded_by(relation))]
            exclusive = self._exclusive[relation] = all(r is not None and r.functional and not r.symmetric for r in relation_types)
        return exclusive

    def is_symmetric(self, relation: str) -> bool:
        if (symmetric := self._symmetric.get(relation)) is None:
            relation_type = self.ontology.relations.get(relation)
            symmetric = relation_type is not None and relation_type.symmetric and len(relation_type.joins) == 2
            self._symmetric[relation] = symmetric
        return symmetric

    def changing(self, term: Term) -> Attribute | None:
        """The attribute that the term reads, if its values are changing facts; else None. Raises Inexpressible."""
        return self._read(term, self.paths)

    def counter(self, term: Term) -> Attribute | None:
        """The attribute that the term reads, if it is a counter; else None. Raises Inexpressible."""
        return self._read(term, self.counters)

    def is_static(self, literal: Literal) -> bool:
        """Whether no service on offer can change what the literal says."""
        atom = literal.atom if isinstance(literal, Not) else literal
        if isinstance(atom, Relation):
            return atom.relation not in self.relations
        try:
            return all(self.changing(term) is None and self.counter(term) is None for term in terms(atom))
        except Inexpressible:
            return False

    def _read(self, term: Term, paths: set[str]) -> Attribute | None:
        match term:
            case Attribute(_, path) if path in paths:
                return term
            case Call(name, arguments):
                function = self.ontology.functions.get(name)
                if function and function.attribute in paths and len(arguments) == 1 and isinstance(arguments[0], Name | Variable):
                    return Attribute(arguments[0], function.attribute)
                if name == "distance" and paths & {"PositionX", "PositionY", "PositionZ"}:
                    raise Inexpressible(term, "services on offer move what it measures")
        return None


def providers_of(service: str) -> str:
    """The pseudo-type of `?Provider`: the devices that offer the service."""
    return f"provider of {service}"


def strip_type(term: Name | Variable) -> str | Variable:
    return term.name if isinstance(term, Name) else Variable(term.name)
