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


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """`ok`: it is a formula, and fits the ontology and the map. `unfinished`: nothing is wrong so far, but it ends too early."""

    ok: bool
    unfinished: bool = False
    problems: tuple[Mistake, ...] = ()


class FormulaService:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("POST", "/formulas/check")
    async def check(self, body: CheckFormula) -> CheckResult:
        """Is this a formula, and does it fit the ontology and the map as they are now? All mistakes that can be found."""
        return check_text(body.text, self._ontology(body), self._context.map, body.variables)

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
            relation_type = _look_up(relation, self._context.ontology.relations, "relation")
            if not 0 <= place < len(relation_type.joins):
                raise UsageError(f"{relation} joins {len(relation_type.joins)} objects; there is no place {place}, they are counted from 0")
            type = relation_type.joins[place]
        return things(self._context.ontology, self._context.map, typed=typed, type_name=type, relation=relation, place=place, limit=limit)

    @operation("GET", "/formulas/things/{name}")
    async def sayable(self, name: str) -> Sayable:
        """What can be said of an object: the relations that it can be in, and the attributes that it can have."""
        return sayable(_look_up(name, self._context.map.objects, "object"), self._context.ontology, self._context.map)

    @operation("GET", "/formulas/things/{name}/at/{target}")
    async def placings(self, name: str, target: str) -> Placings:
        """What it means to have an object brought to another."""
        objects = self._context.map.objects
        return placings(_look_up(name, objects, "object"), _look_up(target, objects, "object"), self._context.ontology)


Entry = TypeVar("Entry")


def _look_up(name: str, entries: Mapping[str, Entry], noun: str) -> Entry:
    entry = entries.get(name)
    if entry is None:
        raise NotFound(f"there is no {noun} {name}" + (f"; {hint}" if (hint := nearest(name, entries)) else ""))
    return entry


def check_text(text: str, ontology: Ontology, map: Map, variables: dict[str, str]) -> CheckResult:
    try:
        errors = mistakes(read(text), ontology, map, variables)
        unfinished = False
    except FormulaError as error:
        # What the other parts say wrong is said all the same: a formula has mistakes while it is not written to its end, too.
        unfinished = error.position >= len(text.rstrip())
        part_errors = [mistake for part in _parts(text) for mistake in _part_mistakes(part, ontology, map, variables)]
        errors = [*part_errors, error]
        unfinished = unfinished and not part_errors
    distinct_mistakes = {(mistake.position, mistake.problem): mistake for mistake in sorted(errors, key=lambda mistake: mistake.position)}
    problems = tuple(
        Mistake(position=mistake.position, end=_end(text, mistake.position), problem=mistake.problem, hint=mistake.hint)
        for mistake in distinct_mistakes.values()
    )
    return CheckResult(ok=not problems, unfinished=unfinished, problems=problems)


def _part_mistakes(part: str, ontology: Ontology, map: Map, variables: dict[str, str]) -> list[FormulaError]:
    try:
        return mistakes(read(part), ontology, map, variables)
    except FormulaError:
        return []


def _parts(text: str) -> list[str]:
    """What stands between AND, OR, NOT and parentheses that group, each with blanks before it, so that places stay."""
    parts: list[str] = []
    begin, depth, named = 0, 0, False
    for token in _PARTS.finditer(text):
        word = token[0]
        groups = word == "(" and not named and not depth
        if word == "(" and not groups:
            depth += 1
        elif word == ")" and depth:
            depth -= 1
        elif word in ("AND", "OR", "NOT") or word in "()" or groups:
            parts.append(" " * begin + text[begin : token.start()])
            begin, depth = token.end(), 0
        named = word[0].isalpha() and word not in ("AND", "OR", "NOT")
    parts.append(" " * begin + text[begin:])
    return [part for part in parts if part.strip()]


def _end(text: str, position: int) -> int:
    match = _PLACE.match(text, position)
    return match.end() if match is not None else position
