"""Shafts of lifts: on which floors a lift stops, where its cabin is open there, and what robots cannot drive through.

A lift is a box, the cabin. Where it stops, the cabin is a small room with a doorway for each of its doors on that storey; on all other
floors between its lowest and its highest stop, the shaft is solid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.space.solids import Point, Role, Solid, solid_of
from somrs.space.storeys import elevation_of

LIFT_RELATIONS = ("stopsAt", "leadsInto")
"""The relations that say where a lift stops, and which doors it has."""
WALL = 0.06
"""Thickness of the walls of a cabin, which stand around it, m."""
THRESHOLD = 0.1
"""How far the floor of a doorway reaches into the cabin, and out of the door, m."""
THINNEST = 0.01
"""Pieces of wall that are narrower are left out, m."""
SAME_FLOOR = 0.5
"""Difference in height up to which two heights are those of one floor, m."""


@dataclass(frozen=True, slots=True)
class Landing:
    """A floor on which a lift stops: its height in metres, the name of the storey, and the doors of the lift there."""

    level: float
    storey: str
    doors: tuple[Solid, ...]


@dataclass(frozen=True, slots=True)
class Shaft:
    """The shaft of a lift. `cabin`: where it was on the map; `landings`: the lowest first."""

    cabin: Solid
    landings: tuple[Landing, ...]

    @property
    def name(self) -> str:
        """The name of the lift."""
        return self.cabin.name

    def landing(self, level: float) -> Landing | None:
        """Where the lift stops at this height; None if it does not."""
        return next((landing for landing in self.landings if abs(landing.level - level) < SAME_FLOOR), None)

    def contains(self, point: Point) -> bool:
        """Whether the point is in the cabin, seen from above."""
        return self.cabin.distance(*point) < 0

    def room_to_doors(self, point: Point, level: float) -> float:
        """The distance from a point to the nearest door on a floor, m; infinite without one."""
        landing = self.landing(level)
        return min((door.distance(*point) for door in landing.doors), default=math.inf) if landing is not None else math.inf

    def obstacles(self, level: float) -> Iterator[Solid]:
        """What robots cannot drive through at this height: the walls of the cabin, or all of the shaft where it does not stop."""
        landing = self.landing(level)
        if landing is not None:
            yield from self._walls(landing)
        elif not self.landings or self.landings[0].level <= level <= self.landings[-1].level + self.cabin.height:
            yield replace(self.cabin, z=level)

    def ground(self, level: float) -> Iterator[Solid]:
        """What is floor at this height because the lift stops there: the cabin, and its doorways."""
        landing = self.landing(level)
        if landing is None:
            return
        yield replace(self.cabin, z=landing.level)
        for door in landing.doors:
            side, along, outward = self._doorway(door)
            far = outward + min(door.width, door.depth) / 2 + THRESHOLD
            x, y = self.cabin.world(*side.point(along, (far - THRESHOLD) / 2))
            yield replace(
                self.cabin, name=door.name, x=x, y=y, z=landing.level, yaw=self.cabin.yaw + side.angle, width=_width(door),
                depth=max(far + THRESHOLD, THRESHOLD),
            )  # fmt: skip

    def _walls(self, landing: Landing) -> Iterator[Solid]:
        doorways = [(*self._doorway(door), _width(door)) for door in landing.doors]
        for side in self._sides():
            begin = -WALL
            gaps = sorted((along - width / 2, along + width / 2) for door_side, along, _, width in doorways if door_side == side)
            for start, end in [*gaps, (side.length + WALL, 0.0)]:
                if start - begin > THINNEST:
                    yield self._wall(side, begin, start, landing.level)
                begin = max(begin, end)

    def _wall(self, side: _Side, begin: float, end: float, level: float) -> Solid:
        x, y = side.point((begin + end) / 2, WALL / 2)
        middle = self.cabin.world(x, y)
        return replace(
            self.cabin, x=middle[0], y=middle[1], z=level, yaw=self.cabin.yaw + side.angle, width=end - begin, depth=WALL
        )  # fmt: skip

    def _doorway(self, door: Solid) -> tuple[_Side, float, float]:
        """The side of the cabin on which a door is, how far along it, and how far outside, m."""
        c, s, dx, dy = math.cos(self.cabin.yaw), math.sin(self.cabin.yaw), door.x - self.cabin.x, door.y - self.cabin.y
        middle = c * dx + s * dy, c * dy - s * dx
        side = min(self._sides(), key=lambda side: abs(side.outward(middle)))
        return side, side.along(middle), side.outward(middle)

    def _sides(self) -> tuple[_Side, ...]:
        half_width, half_depth = self.cabin.width / 2, self.cabin.depth / 2
        corners = [(-half_width, -half_depth), (half_width, -half_depth), (half_width, half_depth), (-half_width, half_depth)]
        return tuple(_Side(start, end) for start, end in zip(corners, [*corners[1:], corners[0]], strict=True))


@dataclass(frozen=True, slots=True)
class _Side:
    """A side of a cabin, counter-clockwise, in the cabin's frame: the outside is on the right."""

    start: Point
    end: Point

    @property
    def length(self) -> float:
        return math.dist(self.start, self.end)

    @property
    def angle(self) -> float:
        return math.atan2(self.end[1] - self.start[1], self.end[0] - self.start[0])

    def along(self, point: Point) -> float:
        """How far along the side a point is, m."""
        return (point[0] - self.start[0]) * math.cos(self.angle) + (point[1] - self.start[1]) * math.sin(self.angle)

    def outward(self, point: Point) -> float:
        """How far outside the side a point is, m."""
        return (point[0] - self.start[0]) * math.sin(self.angle) - (point[1] - self.start[1]) * math.cos(self.angle)

    def point(self, along: float, outward: float) -> Point:
        c, s = math.cos(self.angle), math.sin(self.angle)
        return self.start[0] + along * c + outward * s, self.start[1] + along * s - outward * c


def _width(door: Solid) -> float:
    return max(door.width, door.depth)


def shafts_of(map: Map, ontology: Ontology) -> list[Shaft]:
    """The shafts of the lifts on a map. A lift that is no box, or stops nowhere, has no landings."""
    doors: dict[str, list[Solid]] = {}
    for fact in map.facts("leadsInto"):
        door = solid_of(map.objects[fact.arguments[0]], ontology)
        if door is not None:
            doors.setdefault(fact.arguments[1], []).append(door)
    shafts = []
    for object in map.objects.values():
        cabin = solid_of(object, ontology) if ontology.is_subtype(object.type, "Lift") else None
        if cabin is None or cabin.role is not Role.LIFT:
            continue
        storeys = [arguments[1] for arguments in map.facts_with("stopsAt", 0, object.name)] if cabin.form == "Box" else []
        levels = sorted((elevation_of(storey, map, ontology), storey) for storey in storeys)
        landings = (
            Landing(level, storey, tuple(door for door in doors.get(object.name, ()) if abs(door.z - level) < SAME_FLOOR))
            for level, storey in levels
        )
        shafts.append(Shaft(cabin, tuple(landing for landing in landings if landing.doors)))
    return shafts
