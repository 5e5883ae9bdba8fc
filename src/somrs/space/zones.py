"""Zones that operators draw on a map: robots do not enter no-go zones, and drive slowly in slow zones."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from somrs.errors import SimulationError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Point, Solid, area_of

NO_GO_ZONE, SLOW_ZONE = "NoGoZone", "SlowZone"


@dataclass(frozen=True, slots=True)
class Zone:
    """A zone on a floor. `limit`: the highest speed there, in metres per second; None in a no-go zone."""

    area: Solid
    limit: float | None

    @property
    def name(self) -> str:
        return self.area.name


@dataclass(frozen=True)
class Zones:
    """The zones of a map, by name."""

    zones: tuple[Zone, ...] = ()

    @cached_property
    def forbidden(self) -> tuple[Solid, ...]:
        """The areas that nobody enters."""
        return tuple(zone.area for zone in self.zones if zone.limit is None)

    @cached_property
    def slow(self) -> tuple[tuple[Solid, float], ...]:
        """The areas where robots drive slowly, with the highest speed there, m/s."""
        return tuple((zone.area, zone.limit) for zone in self.zones if zone.limit is not None)

    def forbidden_zone_at(self, point: Point, level: float, radius: float) -> str | None:
        """The no-go zone that a robot of a radius would touch at a point; None if there is none."""
        on_floor = (area for area in self.forbidden if abs(area.z - level) < SAME_FLOOR)
        return next((area.name for area in on_floor if area.distance(*point) < radius), None)

    def speed_limit(self, point: Point, level: float, direction: Point, braking: float) -> float:
        """How fast a robot may drive at a point, so that it is slow enough when its middle enters a slow zone, m/s. `braking`: how it slows
        down, m/s²."""
        limit = math.inf
        for area, highest in self.slow:
            if abs(area.z - level) >= SAME_FLOOR:
                continue
            room = max(area.distance(*point), 0.0)
            ahead = point[0] + _STEP * direction[0], point[1] + _STEP * direction[1]
            if not room or area.distance(*ahead) < room:
                limit = min(limit, math.sqrt(highest * highest + 2 * braking * room))
        return limit


_STEP = 0.01
"""How far ahead it is looked at whether a robot approaches a zone, m."""


def zones_of(map: Map, ontology: Ontology) -> Zones:
    """The zones of a map. One without a usable shape is left out: `somrs check` names it."""
    return Zones(tuple(zone for object in zone_objects(map, ontology) if (zone := _zone(object, ontology)) is not None))


def zone_objects(map: Map, ontology: Ontology) -> Iterable[Object]:
    """The zones on the map as objects, by name."""
    kinds = [type for type in ontology.types if ontology.is_subtype(type, NO_GO_ZONE) or ontology.is_subtype(type, SLOW_ZONE)]
    return (map.objects[name] for name in sorted(name for kind in kinds for name in map.of_type(kind)))


def _zone(object: Object, ontology: Ontology) -> Zone | None:
    try:
        area = area_of(object, ontology)
    except SimulationError:
        return None
    if area is None or ontology.is_subtype(object.type, NO_GO_ZONE):
        return Zone(area, None) if area is not None else None
    limit = object.values.get("SpeedLimit", ontology.default(object.type, "SpeedLimit"))
    return Zone(area, float(limit)) if isinstance(limit, int | float) and limit > 0 else None
