"""What changes on a map when somebody moves an object: what goes along with it, and on what it stands then."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Map, ValueSet
from somrs.ontology.types import PART_OF, Ontology
from somrs.ontology.values import value_of

ON, IN, HELD, AT = "isOn", "isIn", "isHeldBy", "isAt"
X, Y, Z, TURNED = "PositionX", "PositionY", "PositionZ", "RotationZ"
DIGITS = 4
"""Of metres: a tenth of a millimetre is finer than anybody measures."""
STANDS = 0.02
"""A thing whose underside is so near a height stands on it, m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """Where an object is to be, m and rad; `target`: what it would stand on then, if that matters."""

    name: str
    x: float
    y: float
    turned: float
    target: str | None = None


def moved(map: Map, ontology: Ontology, move: Move) -> tuple[Change, ...]:
    """The changes that move an object, and with it all that stands on it, is in it, is held by it, or is part of it."""
    x, y = number(map, ontology, move.name, X), number(map, ontology, move.name, Y)
    before = number(map, ontology, move.name, TURNED) or 0.0
    turn = turned(move.turned - before)
    rise = 0.0
    changes = [*_placed(move.name, move.x, move.y), *_turned(map, ontology, move.name, before, move.turned)]
    if move.target is not None and _is_thing(map, ontology, move.name):
        facts = [*put(map, ontology, move.name, move.target)]
        changes += facts
        z, height = number(map, ontology, move.name, Z), top(map, ontology, move.target)
        stood = any(isinstance(change, FactAdded) for change in facts)
        if z is None or stood or abs(height - z) > STANDS:
            changes.append(ValueSet(move.name, Z, round(height, DIGITS)))
            rise = height - z if z is not None else 0.0
    changes += _left(map, ontology, move)
    if x is None or y is None:
        return tuple(changes)
    cos, sin = math.cos(turn), math.sin(turn)
    for rider in riders(map, ontology, move.name):
        dx, dy = ((number(map, ontology, rider, X) or 0.0) - x, (number(map, ontology, rider, Y) or 0.0) - y)
        changes += _placed(rider, move.x + cos * dx - sin * dy, move.y + sin * dx + cos * dy)
        if turn:
            heading = number(map, ontology, rider, TURNED) or 0.0
            changes += _turned(map, ontology, rider, heading, heading + turn)
        if rise and (z := number(map, ontology, rider, Z)) is not None:
            changes.append(ValueSet(rider, Z, round(z + rise, DIGITS)))
    return tuple(changes)


def riders(map: Map, ontology: Ontology, name: str) -> list[str]:
    """All that goes along when the object is moved, and has a position."""
    found: dict[str, None] = {}
    waiting = [name]
    while waiting:
        below = waiting.pop()
        for relation in (ON, IN, HELD, PART_OF):
            for rider, *_ in map.facts_with(relation, 1, below):
                if rider not in found and rider != name and rider in map.objects:
                    found[rider] = None
                    waiting.append(rider)
    return [rider for rider in found if number(map, ontology, rider, X) is not None]


def put(map: Map, ontology: Ontology, name: str, target: str) -> Iterator[Change]:
    """The facts change so that the object stands on the target, and nowhere else."""
    wanted = Fact(ON, (name, target))
    if map.has_fact(wanted.relation, wanted.arguments):
        return
    group = ontology.relations[ON].excludes if ON in ontology.relations else None
    for fact in map.facts_about(name):
        relation = ontology.relations.get(fact.relation)
        same = fact.relation == ON or (relation is not None and group is not None and relation.excludes == group)
        if fact.arguments[0] == name and same:
            yield FactRemoved(fact)
    yield FactAdded(wanted)


def top(map: Map, ontology: Ontology, name: str) -> float:
    """The height at which things stand that are put on an object, m. On a place, that is the floor's."""
    return (number(map, ontology, name, Z) or 0.0) + (number(map, ontology, name, "Shape.Height") or 0.0)


def turned(angle: float) -> float:
    """The same heading, between half a turn to the right and to the left."""
    return math.remainder(angle, math.tau)


def number(map: Map, ontology: Ontology, name: str, path: str) -> float | None:
    value = value_of(name, path, map, ontology)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _placed(name: str, x: float, y: float) -> list[Change]:
    return [ValueSet(name, X, round(float(x), DIGITS)), ValueSet(name, Y, round(float(y), DIGITS))]


def _turned(map: Map, ontology: Ontology, name: str, before: float, after: float) -> list[Change]:
    if abs(turned(after - before)) < 1e-6:
        return []
    return [ValueSet(name, TURNED, round(turned(after), DIGITS + 2))]


def _is_thing(map: Map, ontology: Ontology, name: str) -> bool:
    """Whether it is put on things: what can be carried, and what stands on something already."""
    return ontology.is_subtype(map.objects[name].type, "Graspable") or bool(map.facts_with(ON, 0, name))


def _left(map: Map, ontology: Ontology, move: Move) -> Iterator[Change]:
    """A device that is moved off the place it was at is not at it any more."""
    for fact in [Fact(AT, arguments) for arguments in map.facts_with(AT, 0, move.name)]:
        place = fact.arguments[1]
        x, y = number(map, ontology, place, X), number(map, ontology, place, Y)
        radius = number(map, ontology, place, "Shape.Radius") or 0.0
        if x is None or y is None or math.hypot(move.x - x, move.y - y) > radius:
            yield FactRemoved(fact)
