"""Zones that operators draw on a storey: robots do not enter no-go zones, and drive slowly in slow zones. They are objects of the map."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import count

import msgspec

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.client.operations import operation
from somrs.client.refusals import NotFound
from somrs.entish.parse import nearest
from somrs.errors import UsageError
from somrs.ontology.objects import Change, Object, ObjectAdded, ObjectRemoved
from somrs.ontology.types import Value
from somrs.ontology.values import value_of
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.space.solids import Point
from somrs.space.zones import NO_GO_ZONE, SLOW_ZONE, Zone, zones_of

SMALLEST = 0.01
"""The least area of a zone, m²."""
DIGITS = 3
"""Decimal digits of corners: a millimetre."""


class ZoneView(msgspec.Struct, frozen=True, kw_only=True):
    """A zone. `corners`: on the map, in metres; `height`: of its floor; `storey`: the one with this floor, if there is one. `limit`: the
    highest speed, m/s; None in a no-go zone."""

    name: str
    corners: tuple[Point, ...]
    height: float
    storey: str | None = None
    limit: float | None = None


class ZoneList(msgspec.Struct, frozen=True, kw_only=True):
    """All zones, by name."""

    zones: tuple[ZoneView, ...]


class ZoneDrawn(msgspec.Struct, frozen=True, kw_only=True):
    """A zone that was drawn, and the version of the map that has it."""

    zone: ZoneView
    version: int


class ZoneDrawing(msgspec.Struct, frozen=True, kw_only=True):
    """A zone as it is drawn. `name`: of a new zone, or of the one that it replaces; by default a new one. `corners`: in metres on the map;
    two are those of a box. `storey`: needed if there are several. `limit`: the highest speed, m/s; None: robots do not enter it. `by`: the
    author."""

    corners: tuple[Point, ...]
    name: str | None = None
    storey: str | None = None
    limit: float | None = None
    by: str = ""


def _of_box(corners: tuple[Point, ...]) -> tuple[Point, ...]:
    """All corners: of two, those of the box between them."""
    if len(corners) != 2:
        return corners
    (x, y), (far_x, far_y) = corners
    return (x, y), (far_x, y), (far_x, far_y), (x, far_y)


def shape_of(corners: Sequence[Point]) -> dict[str, Value]:
    """The position and the shape of a zone with these corners, by attribute. Raises UsageError if they make none."""
    if len(corners) < 3 or not all(math.isfinite(value) for corner in corners for value in corner):
        raise UsageError("a zone has three or more corners, in metres; give them as [[x, y], ...]")
    pairs = zip(corners, (*corners[1:], corners[0]), strict=True)
    if abs(sum(ax * by - bx * ay for (ax, ay), (bx, by) in pairs)) / 2 < SMALLEST or _sides_cross(corners):
        raise UsageError("the corners of the zone lie on one line, or its sides cross; give them in their order around it")
    xs, ys = zip(*corners, strict=True)
    x, y = round((min(xs) + max(xs)) / 2, DIGITS), round((min(ys) + max(ys)) / 2, DIGITS)
    outline = " ".join(f"{round(corner_x - x, DIGITS):g},{round(corner_y - y, DIGITS):g}" for corner_x, corner_y in corners)
    return {"PositionX": x, "PositionY": y, "Shape.Form": "Polygon", "Shape.Outline": outline}


def _sides_cross(corners: Sequence[Point]) -> bool:
    """Whether two sides that are not neighbours cross."""
    sides = [*zip(corners, (*corners[1:], corners[0]), strict=True)]
    pairs = ((first, second) for index, first in enumerate(sides) for second in sides[index + 2 :])
    return any(
        _side(*first, second[0]) * _side(*first, second[1]) < 0 and _side(*second, first[0]) * _side(*second, first[1]) < 0
        for first, second in pairs
    )


def _side(start: Point, end: Point, point: Point) -> float:
    """On which side of a line a point is: positive on its left, negative on its right."""
    return (end[0] - start[0]) * (point[1] - start[1]) - (end[1] - start[1]) * (point[0] - start[0])


class ZoneService:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("GET", "/zones", Right.SEE)
    async def list(self) -> ZoneList:
        """The no-go zones and the slow zones."""
        zones = zones_of(self._context.map, self._context.ontology)
        return ZoneList(zones=tuple(map(self._view, zones.zones)))

    @operation("POST", "/zones", Right.MODEL)
    async def draw(self, body: ZoneDrawing) -> ZoneDrawn:
        """Draw a zone, or draw the zone of this name anew. Robots obey it at once; those that are in a no-go zone may leave it."""
        map, body = self._context.map, msgspec.structs.replace(body, corners=_of_box(body.corners))
        name = body.name or next(name for number in count(1) if (name := f"Zone{number:03d}") not in map.objects)
        if body.name is not None and body.name in map.objects:
            self._known(body.name)
        elif name in self._context.ontology.types:
            raise UsageError(f"{name} is the name of a type; give the zone another one")
        drawn = self._object(name, body)
        changes: tuple[Change, ...] = (*([ObjectRemoved(name)] if name in map.objects else []), ObjectAdded(drawn))
        version = await self._context.client.update(UpdateMap(changes=changes, author=body.by))
        storey, height = self._storey(body.storey), self._height(body.storey)
        zone = ZoneView(name=name, corners=body.corners, height=height, storey=storey, limit=body.limit)
        return ZoneDrawn(zone=zone, version=version)

    @operation("DELETE", "/zones/{name}", Right.MODEL)
    async def remove(self, name: str, by: str = "") -> None:
        """Remove a zone. Robots use its ways again at once."""
        self._known(name)
        await self._context.client.update(UpdateMap(changes=(ObjectRemoved(name),), author=by))

    def _object(self, name: str, drawing: ZoneDrawing) -> Object:
        """The object of a zone. Raises UsageError for a drawing of which none can be made."""
        values: dict[str, Value] = {**shape_of(drawing.corners), "PositionZ": self._height(drawing.storey)}
        if drawing.limit is not None and not (math.isfinite(drawing.limit) and drawing.limit > 0):
            raise UsageError("the highest speed in a slow zone is more than 0 m/s; leave it out for a no-go zone")
        if drawing.limit is not None:
            values["SpeedLimit"] = drawing.limit
        return Object(name=name, type=NO_GO_ZONE if drawing.limit is None else SLOW_ZONE, values=values)

    def _height(self, storey: str | None) -> float:
        chosen = self._storey(storey)
        elevation = value_of(chosen, "Elevation", self._context.map, self._context.ontology) if chosen is not None else 0.0
        return float(elevation) if isinstance(elevation, int | float) else 0.0

    def _storey(self, name: str | None) -> str | None:
        """The storey of this name, or the only one; None on a map without storeys. Raises UsageError."""
        storeys = [*self._storeys()]
        if name is not None:
            if name not in storeys:
                raise NotFound(f"there is no storey {name}; {nearest(name, storeys) or 'GET /map lists the objects'}")
            return name
        if len(storeys) > 1:
            raise UsageError(f"say on which storey the zone is: {', '.join(storeys)}")
        return storeys[0] if storeys else None

    def _storeys(self) -> Iterator[str]:
        map, ontology = self._context.map, self._context.ontology
        yield from sorted(name for kind in ontology.types if ontology.is_subtype(kind, "Storey") for name in map.of_type(kind))

    def _view(self, zone: Zone) -> ZoneView:
        area, map, ontology = zone.area, self._context.map, self._context.ontology
        heights = {storey: value_of(storey, "Elevation", map, ontology) for storey in self._storeys()}
        storey = next((name for name, height in heights.items() if isinstance(height, int | float) and abs(height - area.z) < 0.3), None)
        corners = tuple((round(x, DIGITS), round(y, DIGITS)) for x, y in (area.world(*corner) for corner in area.corners()))
        return ZoneView(name=zone.name, corners=corners, height=area.z, storey=storey, limit=zone.limit)

    def _known(self, name: str) -> None:
        """Raise NotFound if there is no zone of this name, and UsageError if it is the name of something else."""
        object, ontology = self._context.map.objects.get(name), self._context.ontology
        if object is not None and not ontology.is_subtype(object.type, "Zone"):
            raise UsageError(f"{name} is a {object.type}, and no zone; give the zone another name")
        if object is None:
            names = [zone.name for zone in zones_of(self._context.map, ontology).zones]
            raise NotFound(f"there is no zone {name}; {nearest(name, names) or 'GET /zones lists the zones'}")
