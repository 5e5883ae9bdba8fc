"""Checks and completions of formulas while people type them."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import TypeVar

import msgspec

from somrs.access.rights import Right
from somrs.api.choices import Placings, Sayable, Things, placings, sayable, things
from somrs.api.context import Context
from somrs.client.operations import operation
from somrs.client.refusals import NotFound
from somrs.entish.formula import Not
from somrs.entish.parse import CONNECTIVES, nearest, read
from somrs.errors import FormulaError, SomrsError, UsageError
from somrs.ontology.achievability import Achievability
from somrs.ontology.check import mistakes
from somrs.ontology.completion import Completions, complete
from somrs.ontology.map import Map
from somrs.ontology.types import ROOT, ObjectType, Ontology
from somrs.protocol.messages.directory import Offer

_PLACE = re.compile(r'[^\W\d][\w-]*(?:\.[^\W\d][\w-]*)*|\?[^\W\d][\w-]*|"(?:[^"\\\n]|\\.)*"|[<>!]=|[\d.]+|\S')
_PARTS = re.compile(r'"(?:[^"\\\n]|\\.)*"|#[^\n]*|\?[^\W\d][\w-]*|[^\W\d][\w-]*|[()]')


class CheckFormula(msgspec.Struct, frozen=True, kw_only=True):
    """A formula to check. `variables`: types of variables, in addition to those that the text declares. `types`: object types to treat as
    part of the ontology, such as a type that is being edited. `is_goal` (JSON: `goal`): also check what no service could bring about."""

    text: str
    variables: dict[str, str] = {}
    types: tuple[ObjectType, ...] = ()
    is_goal: bool = msgspec.field(default=False, name="goal")


class CompleteFormula(CheckFormula, frozen=True, kw_only=True):
    """A formula to complete. `cursor`: the position in the text, counted from 0."""

    cursor: int


class Mistake(msgspec.Struct, frozen=True, kw_only=True):
    """A mistake between `position` and `end` of the text, counted from 0. `hint`: what was expected, or probably meant."""

    position: int
    end: int
    problem: str
    hint: str = ""


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a check. `ok`: the text is a formula and fits the ontology and the map. `unfinished`: the text is correct so far, but
    incomplete. `unachievable`: the parts of a goal that do not hold now and that no service on offer could bring about."""

    ok: bool
    unfinished: bool = False
    problems: tuple[Mistake, ...] = ()
    unachievable: tuple[Mistake, ...] = ()


class FormulaService:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("POST", "/formulas/check", Right.SEE)
    async def check(self, body: CheckFormula) -> CheckResult:
        """Check a formula against the ontology and the map as they are now, and return all mistakes. Of a goal, also return what no
        service on offer could bring about."""
        ontology, map = self._ontology(body), self._context.map
        result = check_text(body.text, ontology, map, body.variables)
        if not result.ok or not body.is_goal:
            return result
        try:
            offers = await self._context.client.services()
        except SomrsError:
            return result  # the formula is checked, whatever the Registry does
        return msgspec.structs.replace(result, unachievable=_unachievable(body.text, offers, ontology, map))

    @operation("POST", "/formulas/complete", Right.SEE)
    async def complete(self, body: CompleteFormula) -> Completions:
        """Suggest completions at a position in a formula, the likeliest first. The rest of the formula may be wrong or missing."""
        return complete(body.text, body.cursor, self._ontology(body), self._context.map, body.variables)

    def _ontology(self, body: CheckFormula) -> Ontology:
        return self._context.ontology.extended(body.types) if body.types else self._context.ontology

    @operation("GET", "/formulas/things", Right.SEE)
    async def things(self, typed: str = "", type: str = ROOT, relation: str | None = None, place: int = 0, limit: int = 40) -> Things:
        """List objects of a type, or objects that fit an argument of a relation; `place` is the argument's index, counted from 0.

        With `typed`, only objects whose name, label or type name contains this text.
        """
        if relation is not None:
            relation_type = _look_up(relation, self._context.ontology.relations, "relation")
            if not 0 <= place < len(relation_type.joins):
                raise UsageError(f"{relation} joins {len(relation_type.joins)} objects; there is no place {place}, since they count from 0")
            type = relation_type.joins[place]
        return things(self._context.ontology, self._context.map, typed=typed, type_name=type, relation=relation, place=place, limit=limit)

    @operation("GET", "/formulas/things/{name}", Right.SEE)
    async def sayable(self, name: str) -> Sayable:
        """List the relations that an object can be in, and the attributes that it can have."""
        return sayable(_look_up(name, self._context.map.objects, "object"), self._context.ontology, self._context.map)

    @operation("GET", "/formulas/things/{name}/at/{target}", Right.SEE)
    async def placings(self, name: str, target: str) -> Placings:
        """List the formulas that locate an object at a target, as goals for bringing it there."""
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
        # The complete parts of an unfinished formula are checked, so that their mistakes are reported while it is typed.
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


def _unachievable(text: str, offers: Collection[Offer], ontology: Ontology, map: Map) -> tuple[Mistake, ...]:
    """The parts of the goal that no offered service could bring about, with the reason, and what would help."""
    providers: dict[str, list[str]] = {}
    for offer in offers:
        providers.setdefault(offer.service_type.name, []).append(offer.provider)
    offered = {offer.service_type.name: offer.service_type for offer in offers}
    known = {**ontology.services, **offered}
    possible = Achievability([*offered.values()], ontology, map, providers)
    conceivable = Achievability([*known.values()], ontology, map, providers)
    reading, mistakes_found = read(text), []
    for part in possible.unachievable_parts(reading.formula):
        others = [name for name, service in known.items() if name not in offered and conceivable.could_use(service, part.literal)]
        reason = f": {part.reason}" if part.reason else ""
        hint = f"{' or '.join(others)} could, but no device offers it now" if others else part.remedy
        atom = part.literal.atom if isinstance(part.literal, Not) else part.literal
        error = reading.error(atom, None, f"no service on offer brings about {part.literal}{reason}", hint)
        mistakes_found.append(Mistake(position=error.position, end=_end(text, error.position), problem=error.problem, hint=hint))
    return tuple(mistakes_found)


def _part_mistakes(part: str, ontology: Ontology, map: Map, variables: dict[str, str]) -> list[FormulaError]:
    try:
        return mistakes(read(part), ontology, map, variables)
    except FormulaError:
        return []


def _parts(text: str) -> list[str]:
    """The parts between keywords and grouping parentheses, each padded with leading blanks so that positions stay valid."""
    parts: list[str] = []
    begin, depth, named, quantified = 0, 0, False, False
    for token in _PARTS.finditer(text):
        word = token[0]
        groups = word == "(" and not depth and (quantified or not named)
        if word == "(" and not groups:
            depth += 1
        elif word == ")" and depth:
            depth -= 1
        elif word in CONNECTIVES or word in "()" or groups:
            parts.append(" " * begin + text[begin : token.start()])
            begin, depth = token.end(), 0
        named = word[0].isalpha() and word not in CONNECTIVES
        quantified = word in ("FORALL", "EXISTS") or (quantified and word != "(")
    parts.append(" " * begin + text[begin:])
    return [part for part in parts if part.strip()]


def _end(text: str, position: int) -> int:
    match = _PLACE.match(text, position)
    return match.end() if match is not None else position
