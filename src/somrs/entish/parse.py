"""Parser from text to formulas. Errors show the place with a caret and what is expected there."""

from __future__ import annotations

import difflib
import heapq
import itertools
import json
import math
import re
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from lark import Lark, Token, Transformer, UnexpectedInput, v_args
from lark.exceptions import VisitError
from msgspec import Struct

from somrs.entish.formula import (
    Arithmetic,
    Atom,
    Attribute,
    Call,
    Comparison,
    Formula,
    Name,
    Number,
    Relation,
    Term,
    Text,
    Truth,
    Variable,
)
from somrs.entish.written import (
    Meaning,
    TwoTypes,
    Written,
    WrittenAtom,
    WrittenJunction,
    WrittenNot,
    WrittenQuantifier,
    WrittenType,
)
from somrs.errors import FormulaError

# With `\b`, a name may begin with a keyword (`ORanges`, `OR-gate`), but cannot be a keyword.
_GRAMMAR = r"""
start: formula
?formula: conjunct (_OR conjunct)*      -> disjunction
?conjunct: factor (_AND factor)*        -> conjunction
?factor: atom
       | _NOT factor                    -> negation
       | "(" formula ")"
       | QUANTIFIER VARIABLE [":" NAME] "(" formula ")" -> quantified
?atom: term NAME term                   -> infix
     | NAME "(" [term ("," term)*] ")"  -> prefix
     | sum OPERATOR sum                 -> comparison
?sum: product
    | sum SIGN product                  -> arithmetic
?product: term
        | product TIMES term            -> arithmetic
?term: (NAME | QUALIFIED)               -> name
     | variable
     | (name_of | variable) ("." NAME)+ -> attribute
     | NAME "(" [term ("," term)*] ")"  -> call
     | NUMBER [UNIT]                    -> number
     | STRING                           -> text
     | TRUTH                            -> truth
name_of: NAME | QUALIFIED
variable: VARIABLE [":" NAME]

_AND.3: /AND\b(?!-)/
_OR.3: /OR\b(?!-)/
_NOT.3: /NOT\b(?!-)/
QUANTIFIER.3: /(FORALL|EXISTS)\b(?!-)/
TRUTH.3: /(TRUE|FALSE)\b(?!-)/
SIGN: /[+-]/
TIMES: "*"
OPERATOR: /<=|>=|!=|=|<|>/
VARIABLE: /\?[^\W\d]\w*(-\w+)*/
NAME: /(?!(AND|OR|NOT|FORALL|EXISTS|TRUE|FALSE)\b(?!-))[^\W\d]\w*(-\w+)*/
QUALIFIED.2: /[^\W\d]\w*(-\w+)*:[^\W\d]\w*(-\w+)*/
NUMBER: /[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?/
UNIT.2: /(?!(AND|OR|NOT)\b(?!-))[^\W\d][\w\/*^]*|°[A-Za-z]?|%(\/[^\W\d][\w\/*^]*)?/
STRING: /"([^"\\\n]|\\.)*"/
COMMENT: /#[^\n]*/
%ignore /\s+/
%ignore COMMENT
"""

CONNECTIVES = frozenset(("AND", "OR", "NOT", "FORALL", "EXISTS"))
KEYWORDS = CONNECTIVES | {"TRUE", "FALSE"}
"""The words that cannot be names."""

# Descriptions of the grammar's tokens for error messages.
EXPECTED = {
    "NAME": "a name",
    "VARIABLE": "a variable such as ?Shelf",
    "NUMBER": "a number",
    "UNIT": "a unit",
    "STRING": 'a text in "quotes"',
    "OPERATOR": "a comparison (= != < <= > >=)",
    "SIGN": "+ or -",
    "TIMES": "*",
    "TRUTH": "TRUE or FALSE",
    "_AND": "AND",
    "_OR": "OR",
    "_NOT": "NOT",
    "QUANTIFIER": "FORALL or EXISTS",
    "LPAR": "(",
    "RPAR": ")",
    "COMMA": ",",
    "COLON": ": and a type",
    "DOT": ". and an attribute",
    "$END": "the end of the formula",
}


MAX_DEPTH = 100
"""The maximum depth of nested parentheses and negations, and the maximum number of operations in one expression."""


class ParsedFormula(Struct, frozen=True):
    """A text, its formula, and the offsets of the formula's parts in the text.

    `places` gives the offset of an atom's relation or comparison sign (with None) and of its terms: for an attribute, its name; for a
    call, the function; for arithmetic, the sign. `types` gives the offset of each variable's type.
    """

    text: str
    formula: Formula
    places: dict[tuple[Atom, Term | None], int]
    types: dict[Variable, int]

    def error(self, atom: Atom, term: Term | None, problem: str, hint: str = "") -> FormulaError:
        """An error at a term of the atom, or at the atom itself if `term` is None."""
        return FormulaError(self.text, self.places.get((atom, term), 0), problem, hint)

    def type_error(self, variable: Variable, problem: str, hint: str = "") -> FormulaError:
        """An error at the type of a variable."""
        return FormulaError(self.text, self.types.get(variable, 0), problem, hint)


class _MisplacedToken(Exception):
    """The text matches the grammar but is not a valid formula; becomes a FormulaError at the token."""

    def __init__(self, token: Token, problem: str, hint: str = "") -> None:
        self.token, self.problem, self.hint = token, problem, hint


class _PlacedTerm(Struct, frozen=True):
    """A term with the offsets of itself and of the terms within it, and the types that are written in it."""

    term: Term
    places: tuple[tuple[Term, int], ...]
    types: tuple[WrittenType, ...] = ()


def _place_term(term: Term, token: Token, *inner: _PlacedTerm) -> _PlacedTerm:
    places = ((term, token.start_pos or 0), *(place for placed in inner for place in placed.places))
    return _PlacedTerm(term, places, tuple(written for placed in inner for written in placed.types))


def _place_type(variable: Token, type_name: Token | None) -> WrittenType | None:
    return WrittenType(variable[1:], str(type_name), type_name.start_pos or 0) if type_name is not None else None


@v_args(inline=True)
class _FormulaBuilder(Transformer[Token, Any]):
    """Builds the tree of one text, with the places of its parts and the types of its variables."""

    def start(self, written: Written) -> Written:
        return written

    def disjunction(self, *parts: Written) -> Written:
        return WrittenJunction(False, parts)

    def conjunction(self, *parts: Written) -> Written:
        return WrittenJunction(True, parts)

    def negation(self, part: Written) -> Written:
        return WrittenNot(part)

    def quantified(self, quantifier: Token, variable: Token, type_name: Token | None, body: Written) -> Written:
        return WrittenQuantifier(quantifier == "FORALL", variable[1:], _place_type(variable, type_name), body)

    def infix(self, left_argument: _PlacedTerm, relation: Token, right_argument: _PlacedTerm) -> Written:
        return self._relation(relation, left_argument, right_argument)

    def prefix(self, relation: Token, *arguments: _PlacedTerm | None) -> Written:
        return self._relation(relation, *(argument for argument in arguments if argument is not None))

    def _relation(self, token: Token, *arguments: _PlacedTerm) -> Written:
        relation = Relation(str(token), tuple(_object(argument, token) for argument in arguments))
        return self._atom(relation, token, *arguments)

    def comparison(self, left_operand: _PlacedTerm, operator: Token, right_operand: _PlacedTerm) -> Written:
        comparison = Comparison(left_operand.term, str(operator), right_operand.term)
        return self._atom(comparison, operator, left_operand, right_operand)

    def _atom(self, atom: Atom, token: Token, *arguments: _PlacedTerm) -> Written:
        places = (place for argument in arguments for place in argument.places)
        types = (written for argument in arguments for written in argument.types)
        return WrittenAtom(atom, ((None, token.start_pos or 0), *places), tuple(types))

    def name(self, token: Token) -> _PlacedTerm:
        return _place_term(Name(str(token)), token)

    name_of = name

    def variable(self, token: Token, type_name: Token | None) -> _PlacedTerm:
        variable = Variable(token[1:], str(type_name) if type_name is not None else None)
        written = _place_type(token, type_name)
        return _PlacedTerm(variable, ((variable, token.start_pos or 0),), (written,) if written is not None else ())

    def attribute(self, owner: _PlacedTerm, *path: Token) -> _PlacedTerm:
        assert isinstance(owner.term, Name | Variable)
        return _place_term(Attribute(owner.term, ".".join(path)), path[0], owner)

    def call(self, function: Token, *arguments: _PlacedTerm | None) -> _PlacedTerm:
        placed_arguments = [argument for argument in arguments if argument is not None]
        return _place_term(Call(str(function), tuple(argument.term for argument in placed_arguments)), function, *placed_arguments)

    def arithmetic(self, left_operand: _PlacedTerm, operator: Token, right_operand: _PlacedTerm) -> _PlacedTerm:
        for placed in (left_operand, right_operand):
            if isinstance(placed.term, Name | Text | Truth):
                operand_token = Token(operator.type, operator, start_pos=placed.places[0][1])
                raise _MisplacedToken(operand_token, f"{placed.term} is no number", f"{operator} is for numbers")
        return _place_term(Arithmetic(left_operand.term, str(operator), right_operand.term), operator, left_operand, right_operand)

    def number(self, token: Token, unit: Token | None) -> _PlacedTerm:
        value = float(token)
        if not math.isfinite(value):
            raise _MisplacedToken(token, f"{token} is beyond what a number can be", "the largest is about 1.8e308")
        return _place_term(Number(value, str(unit) if unit is not None else None), token)

    def text(self, token: Token) -> _PlacedTerm:
        try:
            return _place_term(Text(json.loads(str(token))), token)
        except json.JSONDecodeError as error:
            raise _MisplacedToken(token, f"this text cannot be read: {error.msg}", "escapes are those of JSON") from None

    def truth(self, token: Token) -> _PlacedTerm:
        return _place_term(Truth(str(token) == "TRUE"), token)


def _object(placed: _PlacedTerm, relation: Token) -> Name | Variable:
    if isinstance(placed.term, Name | Variable):
        return placed.term
    token = Token(relation.type, relation, start_pos=placed.places[0][1])
    raise _MisplacedToken(token, f"the relation {relation} joins objects, and {placed.term} is not one")


@lru_cache(maxsize=1)
def _grammar() -> Lark:
    return Lark(_GRAMMAR, parser="lalr", maybe_placeholders=True, propagate_positions=False)


def parse(text: str) -> Formula:
    """Parse a formula. Raises FormulaError, which shows the place."""
    return read(text).formula


def parse_beginning(text: str) -> tuple[list[tuple[str, str]], frozenset[str]] | None:
    """Parse the beginning of a formula.

    Returns its tokens as (kind, text), and the kinds of tokens that can follow (keys of `EXPECTED`); None when no formula begins with
    the text. Raises FormulaError for parentheses nested too deeply.
    """
    _limit_depth(text)
    try:
        parser = _grammar().parse_interactive(text)
        # A qualified name is a name.
        tokens = [(token.type if token.type != "QUALIFIED" else "NAME", str(token)) for token in parser.exhaust_lexer()]
        return tokens, frozenset(parser.accepts()) - {"QUALIFIED"}  # type: ignore[no-untyped-call]  # Lark's
    except UnexpectedInput:
        return None


def parse_term(text: str) -> Term:
    """Parse a term. Raises FormulaError, which shows the place."""
    try:
        formula = parse(f"{text} = 0")
    except FormulaError as error:
        raise FormulaError(text, min(error.position, len(text)), "this is no term", error.hint) from None
    if not isinstance(formula, Comparison) or formula.right != Number(0.0):
        hint = "write a number, an attribute such as ?Jar.Weight, or a function such as range(?Provider)"
        raise FormulaError(text, 0, "this is no term", hint)
    return formula.left


@lru_cache(maxsize=4096)
def read(text: str) -> ParsedFormula:
    """Parse a formula, with the places of its parts. Raises FormulaError, which shows the place."""
    _limit_depth(text)
    try:
        written: Written = _FormulaBuilder().transform(_grammar().parse(text))
        meaning = Meaning(written)
    except UnexpectedInput as error:
        raise _unexpected(text, error) from None
    except VisitError as error:
        if isinstance(error.orig_exc, _MisplacedToken):
            raise FormulaError(text, error.orig_exc.token.start_pos or 0, error.orig_exc.problem, error.orig_exc.hint) from None
        raise
    except TwoTypes as error:
        first, second = error.first, error.second
        problem = f"?{second.variable} cannot be both {first.type} and {second.type}"
        raise FormulaError(text, second.place, problem, "give the type once") from None
    return ParsedFormula(text, meaning.formula, meaning.places, meaning.types)


def _limit_depth(text: str) -> None:
    """Refuse deeply nested formulas, so that recursive functions on formulas stay within Python's stack."""
    depth = negations = operations = 0
    levels: list[int] = []
    for match in re.finditer(r'"(?:[^"\\\n]|\\.)*"|#[^\n]*|[()+*,-]|[^\W\d][\w-]*', text):
        token = match.group()
        if token == "(":
            levels.append(1 + negations)
            depth += levels[-1]
        elif token == ")" and levels:
            depth -= levels.pop()
        negations = negations + 1 if token == "NOT" else 0
        operations = operations + (token in "+-*") if token not in ("AND", "OR", ",") else 0
        if negations > MAX_DEPTH:
            raise FormulaError(text, match.start(), f"more than {MAX_DEPTH} NOTs in a row", "two NOTs cancel each other")
        if depth + negations > MAX_DEPTH:
            raise FormulaError(text, match.start(), f"more than {MAX_DEPTH} parentheses within each other", "write it flatter")
        if operations > MAX_DEPTH:
            raise FormulaError(text, match.start(), f"more than {MAX_DEPTH} operations in one expression", "write a shorter sum")


def _unexpected(text: str, error: UnexpectedInput) -> FormulaError:
    """The parser's error as a FormulaError."""
    hint = _expected(error)
    token: object = getattr(error, "token", None)
    if isinstance(token, Token) and token.type == "$END":
        end = len(text.rstrip())
        return FormulaError(text, end, "the formula ends too early" if end else "there is no formula here", hint)
    position = error.pos_in_stream or 0
    unexpected_text = str(token) if isinstance(token, Token) else text[position]
    return FormulaError(text, position, f"{unexpected_text!r} does not fit here", hint)


def _expected(error: UnexpectedInput) -> str:
    """A hint that lists the expected tokens. Lark keeps them in different attributes for unexpected tokens and unexpected characters."""
    tokens = getattr(error, "accepts", None) or getattr(error, "expected", None) or getattr(error, "allowed", None) or ()
    descriptions = [words for token, words in EXPECTED.items() if token in tokens]
    *other_descriptions, last_description = descriptions or [""]
    return (
        f"expected {', '.join(other_descriptions)} or {last_description}"
        if other_descriptions
        else f"expected {last_description}"
        if last_description
        else ""
    )


MAX_COMPARED_NAMES = 100
"""If there are more names, only this many of them are compared: those that share most pairs of adjacent letters with the name."""


def nearest(name: str, known_names: Iterable[str]) -> str:
    """A hint with the known names that are most similar to `name`; empty when none is similar."""
    candidates = {candidate.casefold(): candidate for candidate in known_names}
    if len(candidates) > MAX_COMPARED_NAMES:
        # `get_close_matches` is slow for thousands of names, as on large maps.
        name_pairs = _pairs(name.casefold())
        closest = heapq.nlargest(MAX_COMPARED_NAMES, candidates, key=lambda candidate: len(name_pairs & _pairs(candidate)))
        candidates = {candidate: candidates[candidate] for candidate in closest}
    close = difflib.get_close_matches(name.casefold(), candidates, n=3, cutoff=0.6)
    return f"did you mean {' or '.join(candidates[c] for c in close)}?" if close else ""


def _pairs(word: str) -> set[str]:
    return {first + second for first, second in itertools.pairwise(word)}
