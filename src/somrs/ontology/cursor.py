"""Analyses the cursor position in an incomplete formula. `completion.py` makes the suggestions.

Mistakes elsewhere in the text do not matter: only the atom at the cursor is parsed, up to the cursor.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import Enum, auto

from msgspec import Struct, structs

from somrs.entish.parse import parse_beginning
from somrs.errors import FormulaError
from somrs.ontology.map import Map
from somrs.ontology.types import ROOT, AttributeType, Kind, Ontology
from somrs.ontology.values import attribute_at

_LEXEME = re.compile(
    r'(?P<text>"(?:[^"\\\n]|\\.)*")|(?P<open>")|(?P<comment>#[^\n]*)|(?P<word>\??[^\W\d][\w-]*)|(?P<number>\d[\d.]*)|(?P<sign>[()])'
)
_UNIT = re.compile(r"(?<![\w.?])[+-]?\d[\d.]*(?:[eE][+-]?\d+)?\s*(?P<unit>[^\W\d][\w/*^]*|[°%])$")
_WORD = re.compile(r"(\?[^\W\d]?|[^\W\d])[\w-]*$")
_NEGATED = re.compile(r"(?<![\w?-])NOT\s*\(?$")
_QUANTIFIED = re.compile(r"(?<![\w?-])(FORALL|EXISTS)\s*$")
_REST = re.compile(r"[\w-]*")
_QUANTIFIERS = ("FORALL", "EXISTS")
_KEYWORDS = ("AND", "OR", "NOT", *_QUANTIFIERS)

Tokens = list[tuple[str, str]]


class Spot(Enum):
    """The kind of text that is expected at the cursor."""

    NOWHERE = auto()
    """A comment, or a place where nothing fits."""
    ATOM = auto()
    """The beginning of an atom."""
    RELATION = auto()
    """After an object: a relation."""
    OBJECT = auto()
    """An argument of a relation or function."""
    ATTRIBUTE = auto()
    """After an object and a dot."""
    VALUE = auto()
    """After a comparison operator."""
    TERM = auto()
    """After + - or *."""
    UNIT = auto()
    """After a number."""
    TYPE = auto()
    """After a variable and a colon."""
    VARIABLE = auto()
    """After a question mark, where variables for values are possible too."""
    CONTINUATION = auto()
    """After a complete term or atom."""


class Slot(Struct, frozen=True, kw_only=True):
    """An argument place of a relation or function, and the type expected there; `relation` None: the beginning of an atom."""

    relation: str | None = None
    place: int = 0
    type: str = ROOT


class Cursor(Struct, frozen=True, kw_only=True):
    """The context at the cursor. A completion replaces the text from `start` to `end`; `typed` is the part of it before the cursor.

    `owner` is the type of the object before the cursor, `object` its name if it is on the map, and `path` the part of the attribute path
    before the cursor. `compared` is the path on the other side of the comparison, and `attribute` the attribute at its end. `enclosure`:
    `(` within parentheses, `"` within a text. `comparable`: a comparison operator can come next; `complete`: AND or OR can. `negated`:
    the atom follows NOT. `quantified`: the variable of FORALL or EXISTS is written here, before its parenthesis.
    """

    spot: Spot
    start: int = 0
    end: int = 0
    typed: str = ""
    slot: Slot = Slot()
    owner: str = ROOT
    object: str | None = None
    path: str = ""
    compared: str = ""
    attribute: AttributeType | None = None
    variables: Mapping[str, str | None] = {}
    enclosure: str = ""
    comparable: bool = False
    complete: bool = False
    negated: bool = False
    quantified: bool = False


def locate_cursor(text: str, position: int, ontology: Ontology, map: Map, variables: Mapping[str, str]) -> Cursor:
    """The context at `position` in the text. `variables`: declared types, in addition to those in the text."""
    text_before = text[:position]
    lexemes = [*_LEXEME.finditer(text_before)]
    last_lexeme = lexemes[-1] if lexemes else None
    if last_lexeme is not None and last_lexeme.lastgroup == "comment" and last_lexeme.end() == position:
        return Cursor(spot=Spot.NOWHERE, start=position, end=position)
    opened = next((lexeme for lexeme in lexemes if lexeme.lastgroup == "open" and "\n" not in text_before[lexeme.start() :]), None)
    unit = _UNIT.search(text_before)
    if opened is not None:
        start = opened.start()
    elif unit is not None:
        start = unit.start("unit")
    else:
        word = _WORD.search(text_before)
        start = word.start() if word is not None else position
    rest = _REST.match(text, position)
    end = rest.end() if rest is not None and (start < position or position == 0 or not text_before[-1].isdigit()) else position
    # The word after the cursor is replaced only if the cursor is within it or at its end: `|isOn` keeps `isOn`.
    end = end if start < position else position
    variable_types = {**dict.fromkeys(_named(text, start, end)), **variables, **_declared(text, ontology)}
    placer = _CursorPlacer(ontology, map, {**variable_types, **_inferred(text, variable_types, ontology)})
    begin = _atom(text_before, start)
    cursor = _replace_fields(placer.cursor_after(text_before[begin:start]), negated=_NEGATED.search(text_before[:begin]) is not None)
    if _QUANTIFIED.search(text_before[:begin]):
        cursor = _quantified(cursor)
    typed = text_before[start:]
    if typed.startswith("?") and cursor.spot in (Spot.ATOM, Spot.VALUE, Spot.TERM):
        cursor = _replace_fields(cursor, spot=Spot.VARIABLE)
    if opened is not None:
        cursor = _replace_fields(cursor, enclosure='"') if cursor.spot is Spot.VALUE else _replace_fields(cursor, spot=Spot.NOWHERE)
        end = position
    return _replace_fields(cursor, start=start, end=end, typed=typed, variables=placer.variables)


def _replace_fields(cursor: Cursor, **changes: object) -> Cursor:
    return structs.replace(cursor, **changes)


def _quantified(cursor: Cursor) -> Cursor:
    """The cursor between FORALL or EXISTS and its parenthesis."""
    spot = {Spot.ATOM: Spot.VARIABLE, Spot.RELATION: Spot.CONTINUATION}.get(cursor.spot, cursor.spot)
    return Cursor(spot=spot if spot in (Spot.VARIABLE, Spot.TYPE, Spot.CONTINUATION) else Spot.NOWHERE, quantified=True)


def _atom(text: str, start: int) -> int:
    """The start of the atom that contains `start`: after the last AND, OR, NOT, FORALL, EXISTS or grouping parenthesis."""
    atom_start = 0
    groups: list[bool] = []
    named = quantified = False
    for lexeme in _LEXEME.finditer(text, 0, start):
        if lexeme["word"] in _KEYWORDS:
            atom_start, named, quantified = lexeme.end(), False, lexeme["word"] in _QUANTIFIERS
        elif lexeme["sign"] == "(":
            grouping = quantified or not named
            groups.append(grouping)
            if grouping:
                atom_start = lexeme.end()
            named = quantified = False
        elif lexeme["sign"] == ")":
            if groups and groups.pop():
                atom_start = lexeme.start()
            named = False
        else:
            # A parenthesis after a name encloses arguments.
            named = lexeme["word"] is not None and not lexeme["word"].startswith("?")
    return atom_start


def _named(text: str, start: int, end: int) -> list[str]:
    """The names of the variables in the text, without the one at the cursor."""
    lexemes = [lexeme for lexeme in _LEXEME.finditer(text) if (lexeme["word"] or "").startswith("?") and len(lexeme["word"]) > 1]
    return [lexeme["word"][1:] for lexeme in lexemes if not (lexeme.start() == start and lexeme.end() <= end)]


def _declared(text: str, ontology: Ontology) -> dict[str, str]:
    matches = re.finditer(r"\?([^\W\d][\w-]*)\s*:\s*([^\W\d][\w-]*)", text)
    return {match[1]: match[2] for match in matches if match[2] in ontology.types or match[2] in ("number", "text", "truth")}


def _inferred(text: str, variable_types: Mapping[str, str | None], ontology: Ontology) -> dict[str, str]:
    """The types of untyped variables, inferred from the relations in which they occur."""
    inferred_types: dict[str, str] = {}
    words = [lexeme["word"] or lexeme["sign"] or "" for lexeme in _LEXEME.finditer(text)]
    for index, word in enumerate(words):
        relation = ontology.relations.get(word)
        if relation is None or len(relation.joins) != 2 or not 0 < index < len(words) - 1:
            continue
        for neighbour, joined in ((words[index - 1], relation.joins[0]), (words[index + 1], relation.joins[1])):
            if neighbour.startswith("?") and variable_types.get(neighbour[1:], "being written") is None and joined != ROOT:
                inferred_types.setdefault(neighbour[1:], joined)
    return inferred_types


class _CursorPlacer:
    """Determines the cursor context from the beginning of an atom."""

    def __init__(self, ontology: Ontology, map: Map, variables: Mapping[str, str | None]) -> None:
        self.ontology, self.map, self.variables = ontology, map, variables

    def cursor_after(self, atom: str) -> Cursor:
        """The cursor after the beginning of an atom, without its position in the text."""
        if atom.lstrip().startswith(")"):
            return Cursor(spot=Spot.CONTINUATION, complete=True)
        try:
            read = parse_beginning(atom)
        except FormulaError:
            read = None
        if read is None:
            return Cursor(spot=Spot.NOWHERE)
        tokens, next_kinds = read
        cursor = self._spot(tokens, next_kinds)
        return _replace_fields(cursor, comparable="OPERATOR" in next_kinds, complete="$END" in next_kinds and bool(tokens))

    def _spot(self, tokens: Tokens, next_kinds: frozenset[str]) -> Cursor:
        if not tokens:
            return Cursor(spot=Spot.ATOM)
        last_kind = tokens[-1][0]
        call = self._call(tokens)
        enclosure = "(" if call is not None else ""
        if last_kind == "DOT":
            return _replace_fields(self._attribute(tokens), enclosure=enclosure)
        if last_kind == "COLON":
            return Cursor(spot=Spot.TYPE, slot=call or Slot(), enclosure=enclosure)
        if last_kind in ("LPAR", "COMMA"):
            return Cursor(spot=Spot.OBJECT, slot=call or Slot(), enclosure="(")
        sides = _split(tokens, "OPERATOR")
        path, attribute = self._value_of(sides[0]) if len(sides) == 2 else ("", None)
        if "UNIT" in next_kinds:
            return Cursor(spot=Spot.UNIT, attribute=attribute, compared=path)
        if last_kind in ("OPERATOR", "SIGN", "TIMES"):
            if last_kind != "OPERATOR":
                return Cursor(spot=Spot.TERM, attribute=attribute, compared=path)
            slot = Slot(relation="", type=self._type(sides[0]) or ROOT) if attribute is None else Slot()
            return Cursor(spot=Spot.VALUE, attribute=attribute, compared=path, slot=slot)
        if "NAME" not in next_kinds and "OPERATOR" not in next_kinds:
            return Cursor(spot=Spot.CONTINUATION, attribute=attribute)
        term, rest = _term(tokens)
        if rest and rest[0][0] == "NAME" and (relation := self.ontology.relations.get(rest[0][1])) is not None and len(rest) == 1:
            type_name = relation.joins[1] if len(relation.joins) == 2 else ROOT
            return Cursor(spot=Spot.OBJECT, slot=Slot(relation=relation.name, place=1, type=type_name))
        if rest and rest[0][0] == "NAME":
            return Cursor(spot=Spot.OBJECT if len(rest) == 1 else Spot.CONTINUATION)
        owner = self._type(term)
        if owner is not None and not rest:
            return Cursor(spot=Spot.RELATION, owner=owner)
        _, attribute = self._value_of(term)
        return Cursor(spot=Spot.CONTINUATION, attribute=attribute)

    def _call(self, tokens: Tokens) -> Slot | None:
        """The relation or function whose argument list is open at the end, and the place of the next argument; None without one."""
        open_: list[tuple[str, int]] = []
        for index, (kind, _) in enumerate(tokens):
            if kind == "LPAR":
                open_.append((tokens[index - 1][1] if index else "", 0))
            elif kind == "RPAR" and open_:
                open_.pop()
            elif kind == "COMMA" and open_:
                open_[-1] = (open_[-1][0], open_[-1][1] + 1)
        if not open_:
            return None
        name, place = open_[-1]
        relation, function = self.ontology.relations.get(name), self.ontology.functions.get(name)
        types = relation.joins if relation is not None else function.parameters if function is not None else ()
        type_name = types[place] if place < len(types) else ROOT
        return Slot(relation=name if relation is not None else "", place=place, type=type_name)

    def _attribute(self, tokens: Tokens) -> Cursor:
        """The cursor after a dot: the owner, and the attribute path so far."""
        *term, _ = tokens
        path: list[str] = []
        while term[-2:-1] == [("DOT", ".")]:
            path.insert(0, term[-1][1])
            del term[-2:]
        owner = term[-3:] if term[-2:-1] == [("COLON", ":")] else term[-1:]
        named = owner[0][1] if len(owner) == 1 and owner[0][1] in self.map.objects else None
        return Cursor(spot=Spot.ATTRIBUTE, owner=self._type(owner) or ROOT, object=named, path=".".join(path))

    def _type(self, term: Tokens) -> str | None:
        """The type of the object that a term denotes; None when it does not denote an object."""
        match term:
            case [("NAME", name)]:
                return self.map.objects[name].type if name in self.map.objects else ROOT
            case [("VARIABLE", name)]:
                return self._object_type(self.variables.get(name[1:]) or ROOT)
            case [("VARIABLE", _), ("COLON", _), ("NAME", name)]:
                return self._object_type(name)
        return None

    def _object_type(self, name: str) -> str | None:
        return name if name in self.ontology.types or name == ROOT else None

    def _value_of(self, term: Tokens) -> tuple[str, AttributeType | None]:
        """The path of the attribute that a term reads, and the attribute."""
        term, _ = _term(term)
        if term and term[-1][0] == "NAME" and ("DOT", ".") in term:
            names = [text for kind, text in term[term.index(("DOT", ".")) :] if kind == "NAME"]
            return ".".join(names), attribute_at(names[-1], self.ontology)
        if len(term) > 1 and term[1][0] == "LPAR" and (function := self.ontology.functions.get(term[0][1])) is not None:
            read = attribute_at(function.attribute, self.ontology) if function.attribute is not None else None
            return "", read or AttributeType(name=function.name, kind=Kind.NUMBER, unit=function.unit)
        if len(term) > 0 and term[0][0] == "NUMBER":
            return "", AttributeType(name="number", kind=Kind.NUMBER, unit=term[1][1] if len(term) > 1 and term[1][0] == "UNIT" else None)
        return "", None


def _term(tokens: Tokens) -> tuple[Tokens, Tokens]:
    """The first term of the tokens, and the remaining tokens."""
    end = 1
    if len(tokens) > 1 and tokens[1][0] == "LPAR":
        depth = 0
        for index, (kind, _) in enumerate(tokens):
            depth += {"LPAR": 1, "RPAR": -1}.get(kind, 0)
            if kind == "RPAR" and depth == 0:
                return tokens[: index + 1], tokens[index + 1 :]
        return tokens, []
    if len(tokens) > 2 and tokens[1][0] == "COLON":
        end = 3
    if len(tokens) > 1 and tokens[1][0] == "UNIT":
        end = 2
    while end + 1 < len(tokens) and tokens[end][0] == "DOT":
        end += 2
    return tokens[:end], tokens[end:]


def _split(tokens: Tokens, kind: str) -> list[Tokens]:
    """The tokens before and after the first token of a kind."""
    split_index = next((index for index, token in enumerate(tokens) if token[0] == kind), None)
    return [tokens] if split_index is None else [tokens[:split_index], tokens[split_index + 1 :]]
