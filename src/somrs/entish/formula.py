"""Formulas as frozen values, and their printed form. `parse.py` parses them; `ontology.truth` evaluates them.

Paper, "Services": Entish is first-order logic without quantifiers, with AND, OR, names of relations, names of functions
and variables. SO-MRS extends it with `NOT` and with the quantifiers `FORALL` and `EXISTS`.

Formulas are in negation normal form: NOT stands only before atoms. The parser moves every other NOT inwards.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType

from msgspec import Struct, field


class Name(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """A constant: an object of the map, or a value of an enumeration."""

    name: str

    def __str__(self) -> str:
        return _format_node(self, set())


class Variable(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """A variable: `?Shelf`, or with a type `?Shelf: Shelf`. It has the same type at every occurrence in a formula."""

    name: str
    type: str | None = None

    def __str__(self) -> str:
        return _format_node(self, set())


class Number(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """A number, with or without a unit (`12.5`, `500 g`). Without a unit, the attribute's own unit applies."""

    value: float
    unit: str | None = None

    def __str__(self) -> str:
        return _format_node(self, set())


class Text(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """A quoted text."""

    value: str

    def __str__(self) -> str:
        return _format_node(self, set())


class Truth(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """`TRUE` or `FALSE`, the values of a truth attribute."""

    value: bool

    def __str__(self) -> str:
        return _format_node(self, set())


class Attribute(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """An attribute of an object: `Jar002.PositionX`, or part of a complex attribute: `Jar002.Shape.Height` (path `Shape.Height`)."""

    owner: Name | Variable = field(name="of")
    path: str

    def __str__(self) -> str:
        return _format_node(self, set())


class Call(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """A function applied to terms: `distance(?Object, ?Place)`."""

    function: str
    arguments: tuple[Term, ...]

    def __str__(self) -> str:
        return _format_node(self, set())


class Arithmetic(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """A sum, difference or product of two numbers: `?Provider.Charge - 2 * distance(?From, ?To)`. Arithmetic has no parentheses, so
    neither a factor nor a subtrahend is a sum."""

    left: Term
    operator: str
    right: Term

    def __str__(self) -> str:
        return _format_node(self, set())


Term = Name | Variable | Number | Text | Truth | Attribute | Call | Arithmetic


class Relation(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """An atom: a relation between objects. Two arguments print infix, any other number prefix."""

    relation: str
    arguments: tuple[Name | Variable, ...]

    def __str__(self) -> str:
        return _format_node(self, set())


class Comparison(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """An atom: two terms compared by `=`, `!=`, `<`, `<=`, `>` or `>=`."""

    left: Term
    operator: str
    right: Term

    def __str__(self) -> str:
        return _format_node(self, set())


class Not(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """`NOT` before an atom. A variable of the atom that has no value from elsewhere stands for any object: nothing is so."""

    atom: Relation | Comparison

    def __str__(self) -> str:
        return _format_node(self, set())


class And(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """A conjunction of two or more parts. No part is an And; use `conjunction` to build it."""

    parts: tuple[Formula, ...]

    def __str__(self) -> str:
        return _format_node(self, set())


class Or(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """A disjunction of two or more parts. No part is an Or; use `disjunction` to build it."""

    parts: tuple[Formula, ...]

    def __str__(self) -> str:
        return _format_node(self, set())


class ForAll(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """`FORALL ?Jar: Jar (body)`: the body holds for every object of the variable's type; true if there is none. The variable means this
    object in the body only, even if a variable outside has the same name."""

    variable: Variable
    body: Formula

    def __str__(self) -> str:
        return _format_node(self, set())


class Exists(Struct, frozen=True, cache_hash=True, tag_field="is", tag=True):
    """`EXISTS ?Jar: Jar (body)`: the body holds for at least one object of the variable's type."""

    variable: Variable
    body: Formula

    def __str__(self) -> str:
        return _format_node(self, set())


Quantified = ForAll | Exists
Formula = Relation | Comparison | Not | And | Or | ForAll | Exists
Atom = Relation | Comparison
Literal = Relation | Comparison | Not
Condition = Relation | Comparison | Not | ForAll | Exists
"""A part of a formula that has neither AND nor OR at its top."""
Constant = Name | Number | Text | Truth
Substitution = Mapping[str, Term]


def _format_node(node: Formula | Term, declared: set[str]) -> str:
    """The text of a node. `declared` holds the variables whose type is already written; the function adds those that it writes."""
    match node:
        case Name(name):
            return name
        case Variable(name, None):
            return f"?{name}"
        case Variable(name, type_name):
            if name in declared:
                return f"?{name}"
            declared.add(name)
            return f"?{name}: {type_name}"
        case Number(value, unit):
            plain = repr(float(value)).removesuffix(".0")
            return f"{plain} {unit}" if unit else plain
        case Text(text):
            return json.dumps(text, ensure_ascii=False)
        case Truth(value):
            return "TRUE" if value else "FALSE"
        case Attribute(owner, path):
            return f"{_format_node(owner, declared)}.{path}"
        case Call(name, arguments):
            return f"{name}({', '.join(_format_node(argument, declared) for argument in arguments)})"
        case Arithmetic(left_term, operator, right_term):
            return f"{_format_node(left_term, declared)} {operator} {_format_node(right_term, declared)}"
        case Relation(name, (first, second)):
            return f"{_format_node(first, declared)} {name} {_format_node(second, declared)}"
        case Relation(name, arguments):
            return f"{name}({', '.join(_format_node(argument, declared) for argument in arguments)})"
        case Comparison(left_term, operator, right_term):
            return f"{_format_node(left_term, declared)} {operator} {_format_node(right_term, declared)}"
        case Not(atom):
            return f"NOT {_format_node(atom, declared)}"
        case And(parts):
            texts = (_format_node(part, declared) for part in parts)
            return " AND ".join(f"({text})" if isinstance(part, Or) else text for part, text in zip(parts, texts, strict=True))
        case Or(parts):
            return " OR ".join(_format_node(part, declared) for part in parts)
        case ForAll(variable, body) | Exists(variable, body):
            return f"{'FORALL' if isinstance(node, ForAll) else 'EXISTS'} {_format_scope(variable, body, declared)}"
    raise TypeError(f"not a formula or term: {node!r}")


def _format_scope(variable: Variable, body: Formula, declared: set[str]) -> str:
    """A quantifier's variable with its type, and its body. What is declared about a variable of this name outside stays as it is."""
    outside = declared & {variable.name}
    declared.discard(variable.name)
    text = f"{_format_node(variable, declared)} ({_format_node(body, declared)})"
    declared.discard(variable.name)
    declared |= outside
    return text


def conjunction(*parts: Formula) -> Formula:
    """The parts joined by AND, flattened and without duplicates. At least one part is required."""
    flat = dict.fromkeys(p for part in parts for p in (part.parts if isinstance(part, And) else (part,)))
    return next(iter(flat)) if len(flat) == 1 else And(tuple(flat))


def disjunction(*parts: Formula) -> Formula:
    """The parts joined by OR, flattened and without duplicates. At least one part is required."""
    flat = dict.fromkeys(p for part in parts for p in (part.parts if isinstance(part, Or) else (part,)))
    return next(iter(flat)) if len(flat) == 1 else Or(tuple(flat))


def conjuncts(formula: Formula) -> tuple[Formula, ...]:
    """The parts of a conjunction; for any other formula, the formula itself."""
    return formula.parts if isinstance(formula, And) else (formula,)


def literals(formula: Formula) -> Iterator[Literal]:
    """The atoms, each with its NOT, in written order, those within quantifiers included."""
    match formula:
        case And(parts) | Or(parts):
            for part in parts:
                yield from literals(part)
        case ForAll(_, body) | Exists(_, body):
            yield from literals(body)
        case _:
            yield formula


def alternatives(formula: Formula) -> Iterator[tuple[Condition, ...]]:
    """The conjunctions of the disjunctive normal form, each with its parts in written order. A quantifier with its body is one part."""
    match formula:
        case Or(parts):
            for part in parts:
                yield from alternatives(part)
        case And(parts):
            for choice in itertools.product(*(tuple(alternatives(part)) for part in parts)):
                yield tuple(dict.fromkeys(itertools.chain.from_iterable(choice)))
        case _:
            yield (formula,)


def count_alternatives(formula: Formula) -> int:
    """The number of conjunctions that `alternatives` would yield, computed without building them."""
    match formula:
        case Or(parts):
            return sum(map(count_alternatives, parts))
        case And(parts):
            return math.prod(map(count_alternatives, parts))
        case _:
            return 1


def terms(formula: Formula | Term) -> Iterator[Term]:
    """Every term in the formula, in written order, outer terms before inner terms. The variables of quantifiers are included."""
    match formula:
        case And(parts) | Or(parts):
            for part in parts:
                yield from terms(part)
        case ForAll(variable, body) | Exists(variable, body):
            yield variable
            yield from terms(body)
        case Not(atom):
            yield from terms(atom)
        case Relation(_, arguments):
            yield from arguments
        case Comparison(left_term, _, right_term):
            yield from terms(left_term)
            yield from terms(right_term)
        case Arithmetic(left_term, _, right_term):
            yield formula
            yield from terms(left_term)
            yield from terms(right_term)
        case Call(_, inner):
            yield formula
            for argument in inner:
                yield from terms(argument)
        case Attribute(owner, _):
            yield formula
            yield owner
        case _:
            yield formula


@lru_cache(maxsize=4096)
def variables(formula: Formula | Term) -> Mapping[str, Variable]:
    """The variables that no quantifier binds, by name, in the order of their first occurrence."""
    match formula:
        case And(parts) | Or(parts):
            return MappingProxyType({name: variable for part in parts for name, variable in variables(part).items()})
        case ForAll(bound_variable, body) | Exists(bound_variable, body):
            return MappingProxyType({name: variable for name, variable in variables(body).items() if name != bound_variable.name})
        case _:
            return MappingProxyType({term.name: term for term in terms(formula) if isinstance(term, Variable)})


@lru_cache(maxsize=4096)
def names(formula: Formula | Term) -> tuple[str, ...]:
    """The names of the constants, without duplicates, in the order of their first occurrence."""
    return tuple(dict.fromkeys(term.name for term in terms(formula) if isinstance(term, Name)))


def substitute_term(term: Term, bindings: Substitution) -> Term:
    """The term with its bound variables replaced."""
    match term:
        case Variable(name):
            return bindings.get(name, term)
        case Attribute(owner, path):
            replaced = substitute_term(owner, bindings)
            assert isinstance(replaced, Name | Variable), f"{owner} is bound to {replaced}, which has no attributes"
            return Attribute(replaced, path)
        case Call(function, arguments):
            return Call(function, tuple(substitute_term(argument, bindings) for argument in arguments))
        case Arithmetic(left_term, operator, right_term):
            return Arithmetic(substitute_term(left_term, bindings), operator, substitute_term(right_term, bindings))
        case _:
            return term


def substitute(formula: Formula, bindings: Substitution) -> Formula:
    """The formula with its bound variables replaced; unbound variables stay."""
    match formula:
        case And(parts):
            return conjunction(*(substitute(part, bindings) for part in parts))
        case Or(parts):
            return disjunction(*(substitute(part, bindings) for part in parts))
        case Not(atom):
            inner = substitute(atom, bindings)
            assert isinstance(inner, Relation | Comparison)
            return Not(inner)
        case Relation(relation, arguments):
            replaced = tuple(substitute_term(argument, bindings) for argument in arguments)
            assert all(isinstance(argument, Name | Variable) for argument in replaced), formula
            return Relation(relation, replaced)  # type: ignore[arg-type]  # the assertion above checks this
        case Comparison(left_term, operator, right_term):
            return Comparison(substitute_term(left_term, bindings), operator, substitute_term(right_term, bindings))
        case ForAll(variable, body):
            return ForAll(*_substitute_in_scope(variable, body, bindings))
        case Exists(variable, body):
            return Exists(*_substitute_in_scope(variable, body, bindings))


def _substitute_in_scope(variable: Variable, body: Formula, bindings: Substitution) -> tuple[Variable, Formula]:
    """The scope of a quantifier with the variables from outside replaced. The quantifier's variable is renamed if a term that comes in
    has a variable of its name."""
    outer = {name: term for name, term in bindings.items() if name != variable.name and name in variables(body)}
    incoming = {name for term in outer.values() for name in variables(term)}
    if variable.name in incoming:
        taken = {*incoming, *variables(body)}
        fresh = Variable(next(name for n in itertools.count(2) if (name := f"{variable.name}{n}") not in taken), variable.type)
        return fresh, substitute(substitute(body, {variable.name: fresh}), outer)
    return variable, substitute(body, outer)


def with_types(formula: Formula, types: Mapping[str, str]) -> Formula:
    """The formula with types added to its variables. Names of other variables are ignored."""
    return substitute(formula, {name: Variable(name, type_name) for name, type_name in types.items()})
