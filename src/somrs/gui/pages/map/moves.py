"""The changes of the map when a user moves an object: the objects that move with it, and its new support; or the corners of a zone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from somrs.api.zones import shape_of
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, ValueSet
from somrs.ontology.types import PART_OF, Ontology, Value
from somrs.ontology.values import value_of
from somrs.space.solids import Point

ON_RELATION, IN_RELATION, HELD_RELATION, _AT_RELATION = "isOn", "isIn", "isHeldBy", "isAt"
X, Y, Z, TURNED = "PositionX", "PositionY", "PositionZ", "RotationZ"
DIGITS = 4
"""In metres: a tenth of a millimetre, finer than any measurement."""
STAND_TOLERANCE = 0.02
"""Tolerance for a thing to stand on a surface at this height, m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """The new pose of an object, m and rad; `target`: its new support, None to leave it unchanged."""

    name: str
    x: float
    y: float
    turned: float
    target: str | None = None


def move_changes(map: Map, ontology: Ontology, move: Move) -> tuple[Change, ...]:
    """The changes that move an object with everything that stands on it, is in it, is held by it, or is part of it."""
    x, y = number(map, ontology, move.name, X), number(map, ontology, move.name, Y)
    old_heading = number(map, ontology, move.name, TURNED) or 0.0
    turn = _normalize_angle(move.turned - old_heading)
    rise = 0.0
    changes = [*_position_changes(move.name, move.x, move.y), *_heading_changes(move.name, old_heading, move.turned)]
    if move.target is not None and _is_thing(map, ontology, move.name):
        facts = [*_put_on_target(map, ontology, move.name, move.target)]
        changes += facts
        z, height = number(map, ontology, move.name, Z), top(map, ontology, move.target)
        has_new_support = any(isinstance(change, FactAdded) for change in facts)
        if z is None or has_new_support or abs(height - z) > STAND_TOLERANCE:
            changes.append(ValueSet(move.name, Z, round(height, DIGITS)))
            rise = height - z if z is not None else 0.0
    changes += _leave_places(map, ontology, move)
    if x is None or y is None:
        return tuple(changes)
    cos, sin = math.cos(turn), math.sin(turn)
    for rider in _riders(map, ontology, move.name):
        dx, dy = ((number(map, ontology, rider, X) or 0.0) - x, (number(map, ontology, rider, Y) or 0.0) - y)
        changes += _position_changes(rider, move.x + cos * dx - sin * dy, move.y + sin * dx + cos * dy)
        if turn:
            heading = number(map, ontology, rider, TURNED) or 0.0
            changes += _heading_changes(rider, heading, heading + turn)
        if rise and (z := number(map, ontology, rider, Z)) is not None:
            changes.append(ValueSet(rider, Z, round(z + rise, DIGITS)))
    return tuple(changes)


def shape_changes(map: Map, name: str, corners: Sequence[Point]) -> tuple[Change, ...]:
    """The changes after which a zone has these corners. Raises UsageError if they make no zone."""
    values: dict[str, Value | None] = dict.fromkeys(("Shape.Width", "Shape.Depth", TURNED))
    values |= shape_of(corners)
    current_values = map.objects[name].values
    return tuple(ValueSet(name, path, value) for path, value in values.items() if current_values.get(path) != value)


def _riders(map: Map, ontology: Ontology, name: str) -> list[str]:
    """The objects that move with an object and have a position."""
    rider_names: dict[str, None] = {}
    waiting = [name]
    while waiting:
        carrier = waiting.pop()
        for relation in (ON_RELATION, IN_RELATION, HELD_RELATION, PART_OF):
            for rider, *_ in map.facts_with(relation, 1, carrier):
                if rider not in rider_names and rider != name and rider in map.objects:
                    rider_names[rider] = None
                    waiting.append(rider)
    return [rider for rider in rider_names if number(map, ontology, rider, X) is not None]


def _put_on_target(map: Map, ontology: Ontology, name: str, target: str) -> Iterator[Change]:
    """The changes of facts after which the object stands on the target only."""
    support_fact = Fact(ON_RELATION, (name, target))
    if map.has_fact(support_fact.relation, support_fact.arguments):
        return
    group = ontology.relations[ON_RELATION].excludes if ON_RELATION in ontology.relations else None
    for fact in map.facts_about(name):
        relation = ontology.relations.get(fact.relation)
        is_replaced = fact.relation == ON_RELATION or (relation is not None and group is not None and relation.excludes == group)
        if fact.arguments[0] == name and is_replaced:
            yield FactRemoved(fact)
    yield FactAdded(support_fact)


def top(map: Map, ontology: Ontology, name: str) -> float:
    """The height of an object's upper surface, m. For a place, this is the floor's height."""
    return (number(map, ontology, name, Z) or 0.0) + (number(map, ontology, name, "Shape.Height") or 0.0)


def _normalize_angle(angle: float) -> float:
    """The angle between -pi and pi."""
    return math.remainder(angle, math.tau)


def number(map: Map, ontology: Ontology, name: str, path: str) -> float | None:
    value = value_of(name, path, map, ontology)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _position_changes(name: str, x: float, y: float) -> list[Change]:
    return [ValueSet(name, X, round(float(x), DIGITS)), ValueSet(name, Y, round(float(y), DIGITS))]


def _heading_changes(name: str, old_heading: float, new_heading: float) -> list[Change]:
    if abs(_normalize_angle(new_heading - old_heading)) < 1e-6:
        return []
    return [ValueSet(name, TURNED, round(_normalize_angle(new_heading), DIGITS + 2))]


def _is_thing(map: Map, ontology: Ontology, name: str) -> bool:
    """Whether the object stands on others: graspable things, and objects that already stand on something."""
    return ontology.is_subtype(map.objects[name].type, "Graspable") or bool(map.facts_with(ON_RELATION, 0, name))


def _leave_places(map: Map, ontology: Ontology, move: Move) -> Iterator[Change]:
    """The changes that remove a device from the place that it is moved away from."""
    for fact in [Fact(_AT_RELATION, arguments) for arguments in map.facts_with(_AT_RELATION, 0, move.name)]:
        place = fact.arguments[1]
        x, y = number(map, ontology, place, X), number(map, ontology, place, Y)
        radius = number(map, ontology, place, "Shape.Radius") or 0.0
        if x is None or y is None or math.hypot(move.x - x, move.y - y) > radius:
            yield FactRemoved(fact)
