"""Formulas as people write them: checked while they are typed, and completed."""

from __future__ import annotations

import re

import msgspec

from somrs.app.desk.context import Context
from somrs.app.desk.operations import operation
from somrs.entish.parse import read
from somrs.errors import FormulaError
from somrs.ontology.check import mistakes
from somrs.ontology.completion import Completions, complete
from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology

_PLACE = re.compile(r'[^\W\d][\w-]*(?:\.[^\W\d][\w-]*)*|\?[^\W\d][\w-]*|"(?:[^"\\\n]|\\.)*"|[<>!]=|[\d.]+|\S')
_PARTS = re.compile(r'"(?:[^"\\\n]|\\.)*"|#[^\n]*|\?[^\W\d][\w-]*|[^\W\d][\w-]*|[()]')


class CheckFormula(msgspec.Struct, frozen=True, kw_only=True):
    """`variables`: types of variables, beside those that the text says."""

    text: str
    variables: dict[str, str] = {}


class CompleteFormula(CheckFormula, frozen=True, kw_only=True):
    """`cursor`: the place in the text, counted from 0."""

    cursor: int


class Mistake(msgspec.Struct, frozen=True, kw_only=True):
    """What is wrong from `position` to `end` of the text, counted from 0; `hint`: what was expected or probably meant."""

    position: int
    end: int
    problem: str
    hint: str = ""


class Checked(msgspec.Struct, frozen=True, kw_only=True):
    """`ok`: it is a formula, and fits the ontology and the map. `unfinished`: nothing is wrong so far, but it ends too early."""

    ok: bool
    unfinished: bool = False
    problems: tuple[Mistake, ...] = ()


class FormulasDesk:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("POST", "/formulas/check")
    async def check(self, body: CheckFormula) -> Checked:
        """Is this a formula, and does it fit the ontology and the map as they are now? All mistakes that can be found."""
        return checked(body.text, self._context.ontology, self._context.map, body.variables)

    @operation("POST", "/formulas/complete")
    async def complete(self, body: CompleteFormula) -> Completions:
        """What can come at a place in a formula, the likeliest first; the rest of the formula may be wrong, or not there yet."""
        return complete(body.text, body.cursor, self._context.ontology, self._context.map, body.variables)


def checked(text: str, ontology: Ontology, map: Map, variables: dict[str, str]) -> Checked:
    try:
        found = mistakes(read(text), ontology, map, variables)
        unfinished = False
    except FormulaError as error:
        # What the other parts say wrong is said all the same: a formula has mistakes while it is not written to its end, too.
        unfinished = error.position >= len(text.rstrip())
        others = [one for part in _parts(text) for one in _of_part(part, ontology, map, variables)]
        found = [*others, error]
        unfinished = unfinished and not others
    said = {(one.position, one.problem): one for one in sorted(found, key=lambda one: one.position)}
    problems = tuple(
        Mistake(position=one.position, end=_end(text, one.position), problem=one.problem, hint=one.hint) for one in said.values()
    )
    return Checked(ok=not problems, unfinished=unfinished, problems=problems)


def _of_part(part: str, ontology: Ontology, map: Map, variables: dict[str, str]) -> list[FormulaError]:
    try:
        return mistakes(read(part), ontology, map, variables)
    except FormulaError:
        return []


def _parts(text: str) -> list[str]:
    """What stands between AND, OR, NOT and parentheses that group, each with blanks before it, so that places stay."""
    found: list[str] = []
    begin, depth, named = 0, 0, False
    for one in _PARTS.finditer(text):
        word = one[0]
        groups = word == "(" and not named and not depth
        if word == "(" and not groups:
            depth += 1
        elif word == ")" and depth:
            depth -= 1
        elif word in ("AND", "OR", "NOT") or word in "()" or groups:
            found.append(" " * begin + text[begin : one.start()])
            begin, depth = one.end(), 0
        named = word[0].isalpha() and word not in ("AND", "OR", "NOT")
    found.append(" " * begin + text[begin:])
    return [part for part in found if part.strip()]


def _end(text: str, position: int) -> int:
    found = _PLACE.match(text, position)
    return found.end() if found is not None else position
