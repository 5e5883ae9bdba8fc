"""Checks whether a map conforms to its ontology. `consistency.py` checks the ontology itself.

Every rule concerns one object and the facts about it, so an update is checked by checking the objects that it touches.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

from somrs.entish import Name
from somrs.entish.formula import And, Comparison, Formula, Not, Or, Term, substitute
from somrs.entish.parse import nearest, parse
from somrs.ontology.complex_values import complex_problem, limit_problem
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, Object, ObjectRemoved, objects_of
from somrs.ontology.qualified_names import home_of
from somrs.ontology.truth import formula_holds
from somrs.ontology.type_rules import SELF_VARIABLE, TypeRules, attribute_paths, is_about_itself
from somrs.ontology.types import ABSTRACT, PART_OF, AttributeType, Constraint, Kind, Ontology, Value
from somrs.ontology.values import compare, measure
from somrs.ontology.work_budget import MOST_WORK, WorkBudget

WORK_PER_OBJECT = 1000
"""The work that the rules may take for each object that is checked, in steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """A broken rule. `subject` is an object, a fact, or a definition of the `section`; `path` is the wrong attribute or key in it."""

    subject: str
    rule: str
    message: str
    path: str = ""
    section: str = "objects"

    def __str__(self) -> str:
        return f"{self.subject}: {self.message} [{self.rule}]"


def violations(map: Map, ontology: Ontology) -> list[Violation]:
    """All violations on the map."""
    checker = _Checker(map, ontology, None)
    return [*checker.rootless(), *checker.all_violations()]


def root_violations(map: Map, ontology: Ontology) -> list[Violation]:
    """Whether the map lacks a root, as a list of violations."""
    return [*_Checker(map, ontology, None).rootless()]


def violations_of(map: Map, ontology: Ontology, objects: Iterable[str], map_before: Map | None = None) -> list[Violation]:
    """The violations of these objects, the facts about them, and the objects that they are part of.

    `touched_objects` finds the objects of an update. With `map_before`, a map that conformed, what cannot have been broken since is not
    checked again: the values of unchanged objects, the facts about them, and the numbers of parts of objects that have the same parts.
    """
    return [*_Checker(map, ontology, set(objects), map_before).all_violations()]


def touched_objects(map_before: Map, changes: Iterable[Change]) -> set[str]:
    """The objects whose rules the changes may break: those that they name, and the neighbours of removed objects."""
    names: set[str] = set()
    for change in changes:
        names.update(objects_of(change))
        if isinstance(change, ObjectRemoved):
            names.update(name for fact in map_before.facts_about(change.name) for name in fact.arguments)
    return names


def _enclosing_wholes(name: str, map: Map) -> Iterator[str]:
    """What the object is part of, at any depth. An object that breaks the rules may be part of several."""
    visited_names: set[str] = set()
    waiting = [name]
    while waiting:
        for whole in _wholes(waiting.pop(0), map):
            if whole not in visited_names:
                visited_names.add(whole)
                waiting.append(whole)
                yield whole


def _wholes(part: str, map: Map) -> Iterator[str]:
    return (arguments[1] for arguments in map.facts_with(PART_OF, 0, part) if len(arguments) == 2)


class _Checker:
    """One check of the map, or of the `touched` objects and the objects that they are part of."""

    def __init__(self, map: Map, ontology: Ontology, touched: set[str] | None, map_before: Map | None = None) -> None:
        self.map, self.ontology, self.map_before = map, ontology, map_before
        self.named = touched
        self.touched = touched
        self.schemas: dict[str, TypeRules] = {}
        self._budget = WorkBudget(MOST_WORK + WORK_PER_OBJECT * len(touched if touched is not None else map.objects))
        self._rule_results: dict[tuple[object, ...], bool] = {}
        """Cached results of rules about an object's own values, by type, rule and values."""
        self._composed: set[str] | None = None
        """The objects whose parts may be others than before; None: all."""
        if touched is not None:
            # A whole is checked when one of its parts changes, because its rules count the parts and its formulas refer to them.
            self.touched = {whole for name in touched for whole in (name, *self._enclosing_wholes(name))}
            if map_before is not None:
                moved = [name for name in touched if self._is_retyped(name) or {*self._wholes(name)} != {*_wholes(name, map_before)}]
                self._composed = {whole for name in moved for whole in (name, *self._enclosing_wholes(name))}
                self._composed.update(whole for name in moved for whole in _enclosing_wholes(name, map_before))

    def _is_retyped(self, name: str) -> bool:
        """Whether the object was added, removed, or has another type."""
        if self.map_before is None:
            return True
        old, new = self.map_before.objects.get(name), self.map.objects.get(name)
        return (old.type if old is not None else None) != (new.type if new is not None else None)

    def _enclosing_wholes(self, name: str) -> Iterator[str]:
        return _enclosing_wholes(name, self.map)

    def _wholes(self, part: str) -> Iterator[str]:
        return _wholes(part, self.map)

    def _direct_parts(self, whole: str) -> Iterator[str]:
        return (arguments[0] for arguments in self.map.facts_with(PART_OF, 1, whole) if len(arguments) == 2)

    def _nested_parts(self, whole: str) -> Iterator[str]:
        """The parts at any depth: a floor of a room is also a floor of the storey."""
        visited_names: set[str] = set()
        waiting = [whole]
        while waiting:
            for part in self._direct_parts(waiting.pop()):
                if part not in visited_names:
                    visited_names.add(part)
                    waiting.append(part)
                    yield part

    def all_violations(self) -> Iterator[Violation]:
        for name, object in self.map.objects.items() if self.touched is None else self._touched_objects():
            if object.type not in self.ontology.types:
                message = _unknown("type", object.type, self.ontology.types)
                yield Violation(subject=name, rule="unknown-type", message=message, path="type")
                continue
            schema = self._schema(object.type)
            is_unchanged = self.map_before is not None and self.map_before.objects.get(name) is object
            wrong = [*self._values(object, schema)] if not is_unchanged else []
            yield from wrong
            yield from self._parts(object, schema)
            yield from self._place(object, schema)
            constraints = schema.constraints if not is_unchanged else schema.external_constraints
            yield from self._constraints(object, constraints, schema, {violation.path for violation in wrong})
        for fact in dict.fromkeys(self._facts_to_check()):
            yield from self._fact(fact)
        by_first: dict[str, list[Fact]] = {}
        for fact in self.map.facts() if self.named is None else (fact for name in sorted(self.named) for fact in self.map.facts_from(name)):
            if fact.arguments:
                by_first.setdefault(fact.arguments[0], []).append(fact)
        for facts_from in by_first.values():
            yield from self._exclusive(facts_from)

    def _facts_to_check(self) -> Iterator[Fact]:
        if self.named is None:
            yield from self.map.facts()
            return
        for name in sorted(self.named):
            # A new fact is among those from its first object, which is named, too.
            yield from self.map.facts_about(name) if self._is_retyped(name) else self.map.facts_from(name)

    def _touched_objects(self) -> Iterator[tuple[str, Object]]:
        assert self.touched is not None
        return ((name, self.map.objects[name]) for name in sorted(self.touched) if name in self.map.objects)

    def _schema(self, type_name: str) -> TypeRules:
        if type_name not in self.schemas:
            self.schemas[type_name] = TypeRules(self.ontology, type_name)
        return self.schemas[type_name]

    def _values(self, object: Object, schema: TypeRules) -> Iterator[Violation]:
        for path, value in object.values.items():
            attribute = schema.attributes.get(path)
            message = value_problem(attribute, value) if attribute is not None else self._not_of_type(object, path, schema)
            if message:
                rule = "value" if attribute is not None else "unknown-attribute"
                yield Violation(subject=object.name, rule=rule, message=message, path=path)
        for name in schema.required:
            if name not in schema.defaulted and not any(path == name or path.startswith(f"{name}.") for path in object.values):
                message = f"a {object.type} must have {name}; write {name}: and its value"
                yield Violation(subject=object.name, rule="required", message=message)

    def _not_of_type(self, object: Object, path: str, schema: TypeRules) -> str:
        attributes = self.ontology.attributes
        if path.split(".")[0] not in attributes:
            return _unknown("attribute", path, {*schema.attributes, *attributes})
        return f"a {object.type} has no attribute {path}; it has {', '.join(sorted({p.split('.')[0] for p in schema.attributes}))}"

    def _parts(self, object: Object, schema: TypeRules) -> Iterator[Violation]:
        if self._composed is not None and object.name not in self._composed:
            return
        for part in schema.parts:
            enough = part.minimum if part.maximum is None else part.maximum + 1
            count = self._part_count(object.name, part.type, enough) if enough else 0
            if count < part.minimum or (part.maximum is not None and count > part.maximum):
                count = self._part_count(object.name, part.type)
                limits = f"at least {part.minimum}" if part.maximum is None else f"{part.minimum} to {part.maximum}"
                if part.minimum == part.maximum:
                    limits = f"exactly {part.minimum}"
                message = f"a {object.type} has {limits} of type {part.type} among its parts; this one has {count}"
                yield Violation(subject=object.name, rule="parts", message=message, path="parts")

    def _part_count(self, whole: str, type_name: str, enough: int | None = None) -> int:
        """The number of parts of the type, at any depth; it is counted up to `enough`."""
        types = {*self.ontology.subtypes(type_name)}
        candidates = [self.map.of_type(name) for name in types]
        most = sum(map(len, candidates))
        count = 0
        for number, part in enumerate(self._nested_parts(whole)):
            if number > most:
                break
            if part in self.map.objects and self.map.objects[part].type in types:
                count += 1
                if count == enough:
                    return count
        else:
            return count
        # A whole with more parts than there are objects of the type: they are climbed from instead.
        nested = (name for names in candidates for name in names if whole in self._enclosing_wholes(name))
        return sum(1 for _ in islice(nested, enough))

    def rootless(self) -> Iterator[Violation]:
        unknown = any(type_name not in self.ontology.types for type_name in self.map.types())  # an object of these may be the root
        if not unknown and not self._roots:
            missing_root = "no AbstractObject (a building, a site, a room) that is part of nothing" if self.map.objects else "no object"
            yield Violation(subject="map", rule="root", message=f"the map has {missing_root}; one must hold all others")

    @cached_property
    def _roots(self) -> list[str]:
        abstract = (name for name in self.map.types() if name in self.ontology.types and self.ontology.is_subtype(name, ABSTRACT))
        wholes = {name for type_name in abstract for name in self.map.wholes_of_type(type_name)}
        return self.map.in_order({name for name in wholes if not home_of(name)})

    def _place(self, object: Object, schema: TypeRules) -> Iterator[Violation]:
        """Violations of the rule for places: an object is the root, is a part, has a position, or a relation such as isOn places it."""
        wholes = [*self._enclosing_wholes(object.name)]
        if object.name in wholes and object.name == min(wholes):  # report a cycle once
            message = f"is a part of itself: {' isPartOf '.join([object.name, *wholes])}"
            yield Violation(subject=object.name, rule="cycle", message=message)
        if self.ontology.is_subtype(object.type, ABSTRACT):
            # The roots of neighbours' maps stay roots.
            if not wholes and not home_of(object.name) and (first := self._roots[0]) != object.name:
                message = f"{first} is the map's root already; make {object.name} a part of it, or of one of its parts"
                yield Violation(subject=object.name, rule="root", message=message)
            return
        for fact in self.map.facts_from(object.name):
            relation = self.ontology.relations.get(fact.relation)
            if fact.relation == PART_OF or (relation is not None and relation.excludes is not None):
                return
        if "PositionX" not in schema.required and not {"PositionX", "PositionY"} <= object.values.keys():
            message = "is nowhere: it is part of nothing, has no position, and no fact such as isOn says where it is"
            yield Violation(subject=object.name, rule="place", message=message)

    def _constraints(
        self, object: Object, constraints: Iterable[tuple[str, Constraint]], schema: TypeRules, wrong: set[str]
    ) -> Iterator[Violation]:
        """Broken constraints. Those on attributes in `wrong` are skipped; formulas are skipped if any value is wrong."""
        for owner, constraint in constraints:
            if constraint.formula is not None:
                if not wrong and not self._constraint_holds(object, constraint.formula):
                    message = f"{constraint.doc or f'every {owner} obeys {constraint.formula}'}; this one does not"
                    yield Violation(subject=object.name, rule="constraint", message=message)
            elif constraint.attribute is not None and constraint.attribute not in wrong:
                value = object.values.get(constraint.attribute, schema.defaults.get(constraint.attribute))
                message = limit_problem(constraint, value) if value is not None else self._complex_problem(object, constraint, schema)
                if message:
                    yield Violation(subject=object.name, rule="constraint", message=f"for a {owner}, {message}", path=constraint.attribute)

    def _complex_problem(self, object: Object, constraint: Constraint, schema: TypeRules) -> str:
        attribute = schema.attributes.get(constraint.attribute or "")
        if attribute is None or attribute.kind is not Kind.COMPLEX:
            return ""
        return complex_problem(constraint, {**schema.defaults, **object.values}, self.ontology)

    def _constraint_holds(self, object: Object, text: str) -> bool:
        if not is_about_itself(text):
            return self._holds_on_map(object, text)
        # Most objects of a type have equal values of the attributes in a rule, so results are cached.
        key = object.type, text, *((value := object.values.get(path), type(value)) for path in attribute_paths(text))
        if key not in self._rule_results:
            self._rule_results[key] = self._is_true(parse(text), {SELF_VARIABLE: Name(object.name)})
        return self._rule_results[key]

    def _is_true(self, formula: Formula, bound: Mapping[str, Term]) -> bool:
        """Whether a formula over an object's own values holds: the same as `formula_holds`, without a search."""
        match formula:
            case And(parts):
                return all(self._is_true(part, bound) for part in parts)
            case Or(parts):
                return any(self._is_true(part, bound) for part in parts)
            case Not(atom):
                return not self._is_true(atom, bound)
            case Comparison(left_term, operator, right_term):
                left_value, right_value = (measure(term, self.map, self.ontology, bound) for term in (left_term, right_term))
                return left_value is not None and right_value is not None and compare(left_value, operator, right_value)
        raise TypeError(f"{formula} refers to other objects")

    def _holds_on_map(self, object: Object, text: str) -> bool:
        return formula_holds(substitute(parse(text), {SELF_VARIABLE: Name(object.name)}), self.map, self.ontology, self._budget)

    def _fact(self, fact: Fact) -> Iterator[Violation]:
        if (violation := malformed(fact, self.ontology)) is not None:
            yield violation
            return
        relation = self.ontology.relations[fact.relation]
        for name, expected_type in zip(fact.arguments, relation.joins, strict=True):
            object = self.map.objects.get(name)
            if object is None:
                yield Violation(subject=str(fact), rule="unknown-object", message=_unknown("object", name, self.map.similar_names(name)))
            elif object.type in self.ontology.types and not self.ontology.is_subtype(object.type, expected_type):
                message = f"{fact.relation} needs a {expected_type} where {name} stands, which is a {object.type}"
                yield Violation(subject=str(fact), rule="relation-types", message=message)
        if fact.relation == PART_OF:
            yield from self._undeclared_part(fact)

    def _undeclared_part(self, fact: Fact) -> Iterator[Violation]:
        """Violation for a part of a type that the type of its whole does not declare, if that one is closed."""
        part, whole = (self.map.objects.get(name) for name in fact.arguments)
        if part is None or whole is None or part.type not in self.ontology.types or not self.ontology.is_closed(whole.type):
            return
        declared = [declaration.type for declaration in self.ontology.parts_of(whole.type)]
        if not any(self.ontology.is_subtype(part.type, type_name) for type_name in declared):
            known_parts = f"has only parts of the types {', '.join(declared)}" if declared else "has no parts: its attributes describe it"
            message = f"a {whole.type} {known_parts}; declare {part.type} among the parts of {whole.type}, or put {part.name} elsewhere"
            yield Violation(subject=str(fact), rule="parts", message=message)

    def _exclusive(self, facts: Iterable[Fact]) -> Iterator[Violation]:
        """Violations of functional relations and of groups of relations that exclude each other, by the facts with one first argument."""
        first: dict[str, Fact] = {}
        for fact in facts:
            relation = self.ontology.relations.get(fact.relation)
            if relation is None:
                continue
            for group in ((relation.name,) if relation.functional else ()) + ((f"group {relation.excludes}",) if relation.excludes else ()):
                earlier_fact = first.setdefault(group, fact)
                if earlier_fact is not fact and (group == relation.name or earlier_fact.relation != fact.relation):
                    rule = "functional" if group == relation.name else "exclusive"
                    message = f"cannot hold together with {earlier_fact}; keep one of the two"
                    yield Violation(subject=str(fact), rule=rule, message=message)


def value_problem(attribute: AttributeType, value: Value) -> str:
    """Why the value does not fit the attribute; empty when it fits."""
    match attribute.kind:
        case Kind.COMPLEX:
            return f"{attribute.name} is made of {', '.join(attribute.attributes)}; write them below it, not a value"
        case Kind.NUMBER:
            if isinstance(value, bool) or not isinstance(value, int | float):
                unit = f" in {attribute.unit}" if attribute.unit else ""
                return f"{attribute.name} is a number{unit}, not {value!r}"
            if not math.isfinite(value):
                return f"{attribute.name} must be a finite number"
        case Kind.TEXT:
            if not isinstance(value, str):
                return f"{attribute.name} is a text, not {value!r}; write it in quotes"
        case Kind.TRUTH:
            if not isinstance(value, bool):
                return f"{attribute.name} is true or false, not {value!r}"
        case Kind.ENUMERATION:
            if value not in attribute.values or not isinstance(value, str):
                hint = nearest(str(value), attribute.values)
                return f"{attribute.name} is one of {', '.join(attribute.values)}, not {value!r}{f'; {hint}' if hint else ''}"
    return limit_problem(Constraint(attribute=attribute.name, minimum=attribute.minimum, maximum=attribute.maximum), value)


def _unknown(kind: str, name: str, known_names: Iterable[str]) -> str:
    hint = nearest(name, known_names)
    return f"no {kind} is called {name}" + (f"; {hint}" if hint else f"; define it, or use one of the {kind}s there are")


def malformed(fact: Fact, ontology: Ontology) -> Violation | None:
    """Why the fact is none of the ontology, whatever the map: it has an unknown relation, or relates another number of objects."""
    relation = ontology.relations.get(fact.relation)
    if relation is None:
        message = _unknown("relation", fact.relation, ontology.relations)
        return Violation(subject=str(fact), rule="unknown-relation", message=message)
    if len(relation.joins) != len(fact.arguments):
        message = f"{fact.relation} joins {len(relation.joins)} objects ({', '.join(relation.joins)}), not {len(fact.arguments)}"
        return Violation(subject=str(fact), rule="relation-types", message=message)
    return None
