"""Checks a formula against an ontology and the objects of a map: names, numbers of arguments, types, kinds of values, units."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from msgspec import Struct

from somrs.entish.formula import (
    And,
    Arithmetic,
    Atom,
    Attribute,
    Call,
    Comparison,
    Exists,
    ForAll,
    Formula,
    Literal,
    Name,
    Not,
    Number,
    Or,
    Relation,
    Term,
    Text,
    Truth,
    Variable,
    variables,
)
from somrs.entish.parse import ParsedFormula, nearest, read
from somrs.errors import FormulaError
from somrs.ontology.homes import absence_text, full_name, homonyms_of, with_full_names
from somrs.ontology.map import Map
from somrs.ontology.types import ROOT, AttributeType, Kind, Ontology
from somrs.ontology.units import convert_unit


class _Sort(StrEnum):
    """What a term denotes. The values are descriptions for error messages."""

    OBJECT = "an object"
    NUMBER = "a number"
    TEXT = "a text"
    TRUTH = "TRUE or FALSE"
    WORD = "a value of a list"
    NAME = "a name"
    """An object or a value of an enumeration; the other side of the comparison decides which."""
    OPEN = "anything"
    """A variable whose meaning is not known yet."""


class _Meaning(Struct, frozen=True):
    """The meaning of a term: the `type` of an object, the `unit` of a number, the `attribute` of an enumeration value."""

    sort: _Sort
    type: str = ROOT
    unit: str | None = None
    attribute: AttributeType | None = None


_VALUES = {"number": _Sort.NUMBER, "text": _Sort.TEXT, "truth": _Sort.TRUTH}
_KINDS = {Kind.NUMBER: _Sort.NUMBER, Kind.TEXT: _Sort.TEXT, Kind.TRUTH: _Sort.TRUTH, Kind.ENUMERATION: _Sort.WORD}
_OPEN = _Meaning(_Sort.OPEN)

_Scope = dict[str, _Meaning]


def check(formula: Formula | str, ontology: Ontology, map: Map | None = None, variables: Mapping[str, str] | None = None) -> Formula:
    """The formula with the full names of its objects, if it fits the ontology. Raises FormulaError for the first mistake.

    `variables` declares types of variables, in addition to those in the formula. With a map, each constant must be one of
    its objects or a value of the attribute that it is compared with.
    """
    reading = read(formula if isinstance(formula, str) else str(formula))
    for mistake in mistakes(reading, ontology, map, variables):
        raise mistake
    return with_full_names(reading.formula, map, ontology) if map is not None else reading.formula


def mistakes(
    reading: ParsedFormula, ontology: Ontology, map: Map | None = None, variables: Mapping[str, str] | None = None
) -> list[FormulaError]:
    """The mistakes in a parsed formula, at most one for each atom. `check` raises the first."""
    checker = _FormulaChecker(reading, ontology, map, variables or {})
    checker.formula(reading.formula, checker.declared())
    return checker.errors


class _FormulaChecker:
    def __init__(self, reading: ParsedFormula, ontology: Ontology, map: Map | None, variables: Mapping[str, str]) -> None:
        self.reading, self.ontology, self.map, self.variables = reading, ontology, map, variables
        self.errors: list[FormulaError] = []

    def declared(self) -> _Scope:
        """The meanings of the variables that are declared in the formula or by the caller."""
        scope: _Scope = {}
        for name, variable in variables(self.reading.formula).items():
            try:
                if variable.type is not None:
                    scope[name] = self._declared(variable)
                if name in self.variables:
                    self._declare_for_caller(variable, scope)
            except FormulaError as error:
                self.errors.append(error)
        return scope

    def _declared(self, variable: Variable) -> _Meaning:
        """The meaning of a variable whose type is written in the formula."""
        meaning = self._meaning_of_type(variable.type or ROOT)
        if meaning is None:
            hint = nearest(variable.type or "", [*self.ontology.types, *_VALUES])
            raise self.reading.type_error(variable, f"there is no type {variable.type}", hint)
        return meaning

    def _declare_for_caller(self, variable: Variable, scope: _Scope) -> None:
        """Add the type that the caller declares for the variable."""
        atom = next(atom for atom, term in self.reading.places if term == variable)
        type_name = self.variables[variable.name]
        meaning = self._meaning_of_type(type_name)
        if meaning is None:
            hint = nearest(type_name, [*self.ontology.types, *_VALUES])
            raise self.reading.error(atom, variable, f"there is no type {type_name}", hint)
        scope[variable.name] = self._merge_meanings(atom, variable, meaning, scope.get(variable.name, _OPEN))

    def _meaning_of_type(self, type_name: str) -> _Meaning | None:
        if type_name in _VALUES:
            return _Meaning(_VALUES[type_name])
        return _Meaning(_Sort.OBJECT, type_name) if type_name == ROOT or type_name in self.ontology.types else None

    def formula(self, formula: Formula, scope: _Scope) -> None:
        """Check the parts. In a conjunction, what one part implies about a variable holds for the other parts."""
        match formula:
            case And(parts):
                simple = [part for part in parts if isinstance(part, Literal)]
                for part in [*sorted(simple, key=_says_little), *(part for part in parts if not isinstance(part, Literal))]:
                    self.formula(part, scope)
            case Or(alternatives):
                for alternative in alternatives:
                    self.formula(alternative, dict(scope))
            case Not(atom):
                self.formula(atom, scope)
            case ForAll(variable, body) | Exists(variable, body):
                self._quantified(variable, body, scope)
            case Relation() | Comparison():
                try:
                    self._atom(formula, scope)
                except FormulaError as error:
                    self.errors.append(error)

    def _quantified(self, variable: Variable, body: Formula, scope: _Scope) -> None:
        """Check the body. What it implies about variables from outside holds outside, too."""
        outside = scope.pop(variable.name, None)
        try:
            if variable.type is not None:
                scope[variable.name] = self._declared(variable)
            self.formula(body, scope)
        except FormulaError as error:
            self.errors.append(error)
        scope.pop(variable.name, None)
        if outside is not None:
            scope[variable.name] = outside

    def _atom(self, atom: Atom, scope: _Scope) -> None:
        match atom:
            case Relation():
                self._relation(atom, scope)
            case Comparison():
                self._comparison(atom, scope)

    # Objects

    def _relation(self, atom: Relation, scope: _Scope) -> None:
        relation = self.ontology.relations.get(atom.relation)
        if relation is None:
            hint = nearest(atom.relation, self.ontology.relations)
            raise self.reading.error(atom, None, f"there is no relation {atom.relation}", hint)
        if len(relation.joins) != len(atom.arguments):
            problem = f"{atom.relation} joins {len(relation.joins)} objects, not {len(atom.arguments)}"
            raise self.reading.error(atom, None, problem, f"it joins {', '.join(relation.joins)}")
        for term, joined in zip(atom.arguments, relation.joins, strict=True):
            self._object(atom, term, joined, scope)

    def _object(self, atom: Atom, term: Term, type_name: str, scope: _Scope) -> str:
        """The most specific known type of a term that must be an object."""
        expected_meaning = _Meaning(_Sort.OBJECT, type_name)
        match term:
            case Variable(name):
                scope[name] = self._merge_meanings(atom, term, scope.get(name, _OPEN), expected_meaning)
                return scope[name].type
            case Name(name):
                if self.map is None:
                    return type_name
                object = self.map.objects.get(full_name(name, self.map))
                if object is None:
                    raise self._unknown_object(atom, term, self.map)
                object_type = object.type
                self._merge_meanings(atom, term, _Meaning(_Sort.OBJECT, object_type), expected_meaning, narrowing=False)
                return object_type
        raise self.reading.error(atom, term, f"{term} is not an object", "write the name of an object, or a variable")

    def _unknown_object(self, atom: Atom, term: Name, map: Map) -> FormulaError:
        if homonyms := homonyms_of(term.name, map):
            return self.reading.error(atom, term, f"{term} is the name of several objects", f"write {' or '.join(homonyms)}")
        hint = nearest(term.name, map.similar_names(term.name))
        return self.reading.error(atom, term, absence_text(term.name, map), hint)

    def _merge_meanings(
        self, atom: Atom, term: Term, actual_meaning: _Meaning, expected_meaning: _Meaning, narrowing: bool = True
    ) -> _Meaning:
        """The meaning of a term that must have both meanings. `narrowing`: the expected type may be a subtype of the actual one."""
        if _Sort.OPEN in (actual_meaning.sort, expected_meaning.sort):
            return expected_meaning if actual_meaning.sort is _Sort.OPEN else actual_meaning
        if actual_meaning.sort is not expected_meaning.sort:
            raise self.reading.error(atom, term, f"{term} is {actual_meaning.sort}, and here {expected_meaning.sort} is meant")
        if actual_meaning.sort is _Sort.OBJECT:
            if self.ontology.is_subtype(actual_meaning.type, expected_meaning.type):
                return actual_meaning
            if narrowing and self.ontology.is_subtype(expected_meaning.type, actual_meaning.type):
                return expected_meaning
            raise self.reading.error(atom, term, f"{_plain(term)} is a {actual_meaning.type}, and here a {expected_meaning.type} is meant")
        self._units(atom, term, actual_meaning.unit, expected_meaning.unit)
        return actual_meaning if actual_meaning.unit is not None else expected_meaning

    # Values

    def _attribute(self, atom: Atom, term: Attribute, scope: _Scope) -> _Meaning:
        owner = self._object(atom, term.owner, ROOT, scope)
        fixed = isinstance(term.owner, Name) and self.map is not None
        attribute: AttributeType | None = None
        attributes: dict[str, AttributeType] = {}
        for type_name in [owner] if fixed else [owner, *self.ontology.subtypes(owner)]:
            attributes.update(self.ontology.attributes_of(type_name))
            attribute = attributes.get(term.path)
            if attribute is not None:
                break
        if attribute is None:
            subject = f"{term.owner}, a {owner}," if fixed else f"a {owner}"
            raise self.reading.error(atom, term, f"{subject} has no attribute {term.path}", nearest(term.path, attributes))
        if attribute.kind is Kind.COMPLEX:
            raise self.reading.error(atom, term, f"{term.path} is a group of attributes", f"name one of {', '.join(attribute.attributes)}")
        return _Meaning(_KINDS[attribute.kind], unit=attribute.unit, attribute=attribute)

    def _call(self, atom: Atom, term: Call, scope: _Scope) -> _Meaning:
        function = self.ontology.functions.get(term.function)
        if function is None:
            hint = nearest(term.function, self.ontology.functions)
            raise self.reading.error(atom, term, f"there is no function {term.function}", hint)
        if len(function.parameters) != len(term.arguments):
            problem = f"{term.function} takes {len(function.parameters)} objects, not {len(term.arguments)}"
            raise self.reading.error(atom, term, problem, f"it takes {', '.join(function.parameters)}")
        for argument, type_name in zip(term.arguments, function.parameters, strict=True):
            self._object(atom, argument, type_name, scope)
        read_from = self.ontology.attributes.get(function.attribute.rpartition(".")[2]) if function.attribute else None
        return _Meaning(_Sort.NUMBER, unit=read_from.unit if read_from else function.unit)

    def _arithmetic(self, atom: Atom, term: Arithmetic, scope: _Scope) -> _Meaning:
        units: list[str] = []
        for side in (term.left, term.right):
            meaning = self._meaning(atom, side, scope)
            if isinstance(side, Variable) and meaning.sort is _Sort.OPEN:
                meaning = scope[side.name] = _Meaning(_Sort.NUMBER)
            if meaning.sort is not _Sort.NUMBER:
                raise self.reading.error(atom, side, f"{_plain(side)} is {meaning.sort}, and {term.operator} is for numbers")
            units += [meaning.unit] if meaning.unit is not None else []
        if term.operator == "*":
            return _Meaning(_Sort.NUMBER, unit=" * ".join(f"({unit})" for unit in units) if len(units) > 1 else next(iter(units), None))
        self._units(atom, term.right, units[0] if units else None, units[-1] if units else None)
        return _Meaning(_Sort.NUMBER, unit=units[0] if units else None)

    def _meaning(self, atom: Atom, term: Term, scope: _Scope) -> _Meaning:
        match term:
            case Variable(name):
                return scope.get(name, _OPEN)
            case Attribute():
                return self._attribute(atom, term, scope)
            case Call():
                return self._call(atom, term, scope)
            case Arithmetic():
                return self._arithmetic(atom, term, scope)
            case Number(_, unit):
                return _Meaning(_Sort.NUMBER, unit=unit)
            case Text():
                return _Meaning(_Sort.TEXT)
            case Truth():
                return _Meaning(_Sort.TRUTH)
            case Name(name):
                return _Meaning(_Sort.NAME)

    # Comparisons

    def _comparison(self, atom: Comparison, scope: _Scope) -> None:
        left_meaning, right_meaning = self._meaning(atom, atom.left, scope), self._meaning(atom, atom.right, scope)
        left_meaning, right_meaning = (
            self._infer_meaning(atom, atom.left, left_meaning, right_meaning, scope),
            self._infer_meaning(atom, atom.right, right_meaning, left_meaning, scope),
        )
        if atom.operator not in ("=", "!="):
            for term, meaning in ((atom.left, left_meaning), (atom.right, right_meaning)):
                if meaning.sort not in (_Sort.NUMBER, _Sort.OPEN):
                    problem = f"{atom.operator} compares numbers, and {_plain(term)} is {meaning.sort}"
                    raise self.reading.error(atom, None, problem, "use = or !=")
        if left_meaning.sort is _Sort.OPEN or right_meaning.sort is _Sort.OPEN:
            return
        if left_meaning.sort is not right_meaning.sort:
            raise self._mismatch(atom, left_meaning, right_meaning)
        if left_meaning.sort is _Sort.OBJECT:
            self._merge_meanings(atom, atom.right, right_meaning, left_meaning)
        self._units(atom, atom.right if isinstance(atom.right, Number) else atom.left, left_meaning.unit, right_meaning.unit)

    def _infer_meaning(self, atom: Comparison, term: Term, meaning: _Meaning, other_meaning: _Meaning, scope: _Scope) -> _Meaning:
        """The meaning of a term, given the meaning of the other side of the comparison."""
        if isinstance(term, Variable) and meaning.sort is _Sort.OPEN and other_meaning.sort not in (_Sort.OPEN, _Sort.NAME):
            scope[term.name] = other_meaning
            return other_meaning
        if not isinstance(term, Name):
            return meaning
        match other_meaning.sort:
            case _Sort.WORD:
                values = other_meaning.attribute.values if other_meaning.attribute else ()
                if values and term.name not in values:
                    problem = f"{term} is no {other_meaning.attribute.name if other_meaning.attribute else 'value'}"
                    raise self.reading.error(atom, term, problem, nearest(term.name, values) or f"one of {', '.join(values)}")
                return other_meaning
            case _Sort.OBJECT:
                return _Meaning(_Sort.OBJECT, self._object(atom, term, other_meaning.type, {}))
            case _Sort.OPEN | _Sort.NAME:
                self._known_name(atom, term)
        return meaning

    def _known_name(self, atom: Comparison, term: Name) -> None:
        words = {word for attribute in self.ontology.attributes.values() for word in attribute.values}
        if term.name in words or self.map is None:
            return
        if full_name(term.name, self.map) not in self.map.objects:
            problem = f"{term} is neither an object on the map nor a value of an attribute"
            raise self.reading.error(atom, term, problem, nearest(term.name, [*self.map.similar_names(term.name), *words]))

    def _mismatch(self, atom: Comparison, left_meaning: _Meaning, right_meaning: _Meaning) -> FormulaError:
        hint = ""
        for term, other_meaning in ((atom.left, right_meaning), (atom.right, left_meaning)):
            if isinstance(term, Name) and other_meaning.sort is _Sort.TEXT:
                hint = f'a text is written in quotes: "{term}"'
            if isinstance(term, Text) and other_meaning.sort is _Sort.WORD:
                hint = f"a value of a list is written without quotes: {term.value}"
        problem = f"{_plain(atom.left)} is {left_meaning.sort}, and {_plain(atom.right)} is {right_meaning.sort}"
        return self.reading.error(atom, atom.right, problem, hint)

    def _units(self, atom: Atom, term: Term, unit: str | None, other_unit: str | None) -> None:
        if unit is not None and other_unit is not None and convert_unit(1.0, unit, other_unit) is None:
            raise self.reading.error(atom, term, f"{unit} and {other_unit} do not measure the same thing")


def _says_little(part: Formula) -> bool:
    """Whether the part is an equation of two variables, which gives information only when the meaning of one is known."""
    return isinstance(part, Comparison) and isinstance(part.left, Variable) and isinstance(part.right, Variable)


def _plain(term: Term) -> str:
    """The term without the type of its variable."""
    return f"?{term.name}" if isinstance(term, Variable) else str(term)
