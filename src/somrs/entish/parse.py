"""From text to formulas. Errors carry a caret and what was expected; the nearest names come from whoever knows names."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from lark import Lark, Token, Transformer, UnexpectedInput, v_args
from lark.exceptions import VisitError

from somrs.entish.formula import (
    Attribute,
    Call,
    Comparison,
    Formula,
    Name,
    Not,
    Number,
    Relation,
    Term,
    Text,
    Truth,
    Variable,
    conjunction,
    disjunction,
    substitute,
    terms,
)
from somrs.errors import FormulaError

# `\b` keeps a keyword from being the beginning of a name (`ORanges`), the priority keeps it from being a whole one.
GRAMMAR = r"""
start: formula
?formula: conjunct (_OR conjunct)*      -> disjunction
?conjunct: factor (_AND factor)*        -> conjunction
?factor: atom
       | _NOT atom                      -> negation
       | "(" formula ")"
?atom: term NAME term                   -> infix
     | NAME "(" [term ("," term)*] ")"  -> prefix
     | term OPERATOR term               -> comparison
?term: NAME                             -> name
     | variable
     | (name_of | variable) ("." NAME)+ -> attribute
     | NAME "(" [term ("," term)*] ")"  -> call
     | NUMBER [UNIT]                    -> number
     | STRING                           -> text
     | TRUTH                            -> truth
name_of: NAME
variable: VARIABLE [":" NAME]

_AND.3: /AND\b(?!-)/
_OR.3: /OR\b(?!-)/
_NOT.3: /NOT\b(?!-)/
TRUTH.3: /(TRUE|FALSE)\b(?!-)/
OPERATOR: /<=|>=|!=|=|<|>/
VARIABLE: /\?[^\W\d]\w*(-\w+)*/
NAME: /[^\W\d]\w*(-\w+)*/
NUMBER: /[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?/
UNIT.2: /(?!(AND|OR|NOT)\b)[^\W\d][\w\/*^°]*|%/
STRING: /"([^"\\\n]|\\.)*"/
COMMENT: /#[^\n]*/
%ignore /\s+/
%ignore COMMENT
"""

# What a person calls the tokens of the grammar.
EXPECTED = {
    "NAME": "a name",
    "VARIABLE": "a variable such as ?Shelf",
    "NUMBER": "a number",
    "UNIT": "a unit",
    "STRING": 'a text in "quotes"',
    "OPERATOR": "a comparison (= != < <= > >=)",
    "TRUTH": "TRUE or FALSE",
    "_AND": "AND",
    "_OR": "OR",
    "_NOT": "NOT",
    "LPAR": "(",
    "RPAR": ")",
    "COMMA": ",",
    "COLON": ": and a type",
    "DOT": ". and an attribute",
    "$END": "the end of the formula",
}


@v_args(inline=True)
class _Build(Transformer[Token, Any]):
    def start(self, formula: Formula) -> Formula:
        return formula

    def disjunction(self, *parts: Formula) -> Formula:
        return disjunction(*parts)

    def conjunction(self, *parts: Formula) -> Formula:
        return conjunction(*parts)

    def negation(self, atom: Relation | Comparison) -> Formula:
        return Not(atom)

    def infix(self, left: Term, relation: Token, right: Term) -> Relation:
        return Relation(str(relation), (_object(left, relation), _object(right, relation)))

    def prefix(self, relation: Token, *arguments: Term | None) -> Relation:
        return Relation(str(relation), tuple(_object(term, relation) for term in arguments if term is not None))

    def comparison(self, left: Term, operator: Token, right: Term) -> Comparison:
        return Comparison(left, str(operator), right)

    def name(self, token: Token) -> Name:
        return Name(str(token))

    name_of = name

    def variable(self, token: Token, type_name: Token | None) -> Variable:
        return Variable(str(token)[1:], str(type_name) if type_name is not None else None)

    def attribute(self, of: Name | Variable, *path: Token) -> Attribute:
        return Attribute(of, ".".join(path))

    def call(self, function: Token, *arguments: Term | None) -> Call:
        return Call(str(function), tuple(term for term in arguments if term is not None))

    def number(self, token: Token, unit: Token | None) -> Number:
        return Number(float(token), str(unit) if unit is not None else None)

    def text(self, token: Token) -> Text:
        try:
            return Text(json.loads(str(token)))
        except json.JSONDecodeError as error:
            raise _Misplaced(token, f"this text has an escape that is not one: {error.msg}") from None

    def truth(self, token: Token) -> Truth:
        return Truth(str(token) == "TRUE")


class _Misplaced(Exception):
    """Grammatical, but no formula; becomes a FormulaError at the token."""

    def __init__(self, token: Token, problem: str) -> None:
        self.token, self.problem = token, problem


def _object(term: Term, relation: Token) -> Name | Variable:
    if isinstance(term, Name | Variable):
        return term
    raise _Misplaced(relation, f"the relation {relation} joins objects, and {term} is not one")


@lru_cache(maxsize=1)
def _grammar() -> Lark:
    return Lark(GRAMMAR, parser="lalr", maybe_placeholders=True, propagate_positions=False)


@lru_cache(maxsize=4096)
def parse(text: str) -> Formula:
    """The formula that `text` says. Raises FormulaError, which shows the place."""
    try:
        tree = _grammar().parse(text)
        formula: Formula = _Build().transform(tree)
    except UnexpectedInput as error:
        raise _unexpected(text, error) from None
    except VisitError as error:
        if isinstance(error.orig_exc, _Misplaced):
            raise FormulaError(text, error.orig_exc.token.start_pos or 0, error.orig_exc.problem) from None
        raise
    return _spread_types(text, formula)


def _unexpected(text: str, error: UnexpectedInput) -> FormulaError:
    found: object = getattr(error, "token", None)
    at_end = isinstance(found, Token) and found.type == "$END"
    position = len(text) if at_end else (error.pos_in_stream if error.pos_in_stream is not None else 0)
    problem = "the formula ends too early" if at_end else f"{str(found or text[position : position + 1])!r} does not fit here"
    wanted = getattr(error, "accepts", None) or getattr(error, "expected", None) or getattr(error, "allowed", None) or ()
    said = [EXPECTED[token] for token in EXPECTED if token in wanted]
    return FormulaError(
        text,
        position,
        problem,
        f"expected {', '.join(said[:-1])} or {said[-1]}" if len(said) > 1 else "".join(f"expected {s}" for s in said),
    )


def _spread_types(text: str, formula: Formula) -> Formula:
    """Give every occurrence of a typed variable its type; two types for one variable are an error."""
    types: dict[str, str] = {}
    for term in terms(formula):
        if isinstance(term, Variable) and term.type is not None and types.setdefault(term.name, term.type) != term.type:
            where = max(text.find(f": {term.type}"), 0)
            raise FormulaError(text, where, f"?{term.name} cannot be both {types[term.name]} and {term.type}", "give the type once")
    return substitute(formula, {name: Variable(name, type_name) for name, type_name in types.items()}) if types else formula


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint that names the known names closest to `name`; empty when none is close."""
    candidates = {candidate.casefold(): candidate for candidate in known}
    close = difflib.get_close_matches(name.casefold(), candidates, n=3, cutoff=0.6)
    return f"did you mean {' or '.join(candidates[c] for c in close)}?" if close else ""
