"""Formulas as people write them: checked while they are typed, and completed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TypeVar

import msgspec

from somrs.api.choices import Placings, Sayable, Things, placings, sayable, things
from somrs.api.context import Context
from somrs.client.operations import operation
from somrs.client.refusals import NotFound
from somrs.entish.parse import nearest, read
from somrs.errors import FormulaError, UsageError
from somrs.ontology.check import mistakes
from somrs.ontology.completion import Completions, complete
from somrs.ontology.objects import Map
from somrs.ontology.types import ROOT, ObjectType, Ontology

_PLACE = re.compile(r'[^\W\d][\w-]*(?:\.[^\W\d][\w-]*)*|\?[^\W\d][\w-]*|"(?:[^"\\\n]|\\.)*"|[<>!]=|[\d.]+|\S')
_PARTS = re.compile(r'"(?:[^"\\\n]|\\.)*"|#[^\n]*|\?[^\W\d][\w-]*|[^\W\d][\w-]*|[()]')


class CheckFormula(msgspec.Struct, frozen=True, kw_only=True):
    """`variables`: types of variables, beside those that the text says. `types` count as if they were in the ontology already: what
    somebody is writing."""

    text: str
    variables: dict[str, str] = {}
    types: tuple[ObjectType, ...] = ()


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
        return checked(body.text, self._ontology(body), self._context.map, body.variables)

    @operation("POST", "/formulas/complete")
    async def complete(self, body: CompleteFormula) -> Completions:
        """What can come at a place in a formula, the likeliest first; the rest of the formula may be wrong, or not there yet."""
        return complete(body.text, body.cursor, self._ontology(body), self._context.map, body.variables)

    def _ontology(self, body: CheckFormula) -> Ontology:
        return self._context.ontology.extended(body.types) if body.types else self._context.ontology

    @operation("GET", "/formulas/things")
    async def things(self, typed: str = "", type: str = ROOT, relation: str | None = None, place: int = 0, limit: int = 40) -> Things:
        """Objects to choose from: of a type, or those that fit a place of a relation, counted from 0.

        With `typed`, those that have it in their name, their label or their type's name.
        """
        if relation is not None:
            known = _known(relation, self._context.ontology.relations, "relation")
            if not 0 <= place < len(known.joins):
                raise UsageError(f"{relation} joins {len(known.joins)} objects; there is no place {place}, they are counted from 0")
            type = known.joins[place]
        return things(self._context.ontology, self._context.map, typed=typed, type_name=type, relation=relation, place=place, limit=limit)

    @operation("GET", "/formulas/things/{name}")
    async def sayable(self, name: str) -> Sayable:
        """What can be said of an object: the relations that it can be in, and the attributes that it can have."""
        return sayable(_known(name, self._context.map.objects, "object"), self._context.ontology, self._context.map)

    @operation("GET", "/formulas/things/{name}/at/{target}")
    async def placings(self, name: str, target: str) -> Placings:
        """What it means to have an object brought to another."""
        objects = self._context.map.objects
        return placings(_known(name, objects, "object"), _known(target, objects, "object"), self._context.ontology)


Known = TypeVar("Known")


def _known(name: str, all: Mapping[str, Known], what: str) -> Known:
    found = all.get(name)
    if found is None:
        raise NotFound(f"there is no {what} {name}" + (f"; {hint}" if (hint := nearest(name, all)) else ""))
    return found


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
