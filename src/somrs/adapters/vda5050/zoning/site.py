"""The areas of a building in which vehicles have something to heed, on the map of the site."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import msgspec
from msgspec import Struct

from somrs.adapters.vda5050.messages.orders import ZoneAction, ZoneType
from somrs.adapters.vda5050.shapes import Point, counterclockwise, overlap
from somrs.errors import SimulationError
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.ontology.values import value_of
from somrs.space.lanes import MapLane, lanes_of
from somrs.space.shafts import SAME_FLOOR, shafts_of
from somrs.space.solids import Role, Solid, area_of, solid_of
from somrs.space.zones import zones_of

LANE_WIDTH = 0.5
"""The width in metres of a one-way lane for which the map has none: what counts is where the middle of the vehicle is."""


class ZoneActions(Struct, frozen=True, kw_only=True):
    """What vehicles do when they enter a zone, while they are in it, and when they leave it."""

    entry: tuple[ZoneAction, ...] = ()
    during: tuple[ZoneAction, ...] = ()
    exit: tuple[ZoneAction, ...] = ()

    @property
    def all(self) -> tuple[ZoneAction, ...]:
        return (*self.entry, *self.during, *self.exit)


NO_ACTIONS: Mapping[str, ZoneActions] = MappingProxyType({})


class SiteZone(Struct, frozen=True, kw_only=True):
    """An area on a floor. `outline`: its corners in metres, counterclockwise; `level`: the height of the floor in metres.
    `maximum_speed`: in metres per second; `direction`: in radians; where its type has them. `actions`: of an ACTION zone."""

    name: str
    zone_type: ZoneType
    outline: tuple[Point, ...]
    level: float
    maximum_speed: float | None = None
    direction: float | None = None
    actions: ZoneActions = ZoneActions()


class ZoneCatalogue:
    """The zones of the site, for all vehicles of a process. What has not changed is not made anew. `actions`: of areas of the map, by their
    names."""

    def __init__(self, actions: Mapping[str, ZoneActions] = NO_ACTIONS) -> None:
        self._actions = actions
        self._map: Map | None = None
        self._ontology: Ontology | None = None
        self._zones: tuple[SiteZone, ...] = ()

    def zones(self, map: Map, ontology: Ontology) -> tuple[SiteZone, ...]:
        """The zones of a map: the same object as before if they are the same."""
        if map is not self._map or ontology is not self._ontology:
            self._map, self._ontology = map, ontology
            zones = site_zones(map, ontology, self._actions)
            self._zones = self._zones if zones == self._zones else zones
        return self._zones


def site_zones(map: Map, ontology: Ontology, actions: Mapping[str, ZoneActions] = NO_ACTIONS) -> tuple[SiteZone, ...]:
    """The zones of a map:

    - no-go zones are BLOCKED, slow zones SPEED_LIMIT, and one-way lanes DIRECTED;
    - the cabins of lifts are RELEASE on each floor where they stop, because traffic lets one robot in at a time;
    - floors are LINE_GUIDED: traffic grants straight lines from node to node;
    - areas with `actions`, by their names, are ACTION.
    """
    zones = zones_of(map, ontology)
    found = [_zone(area, ZoneType.BLOCKED, area.z) for area in zones.forbidden]
    found += [_zone(area, ZoneType.SPEED_LIMIT, area.z, limit) for area, limit in zones.slow]
    found += [_zone(shaft.cabin, ZoneType.RELEASE, landing.level) for shaft in shafts_of(map, ontology) for landing in shaft.landings]
    found += _one_way_zones(lanes_of(map, ontology), map, ontology)
    found += [_zone(floor, ZoneType.LINE_GUIDED, floor.top) for floor in _floors(map, ontology)]
    found += _action_zones(map, ontology, actions)
    return tuple(zone for zone in found if len(zone.outline) > 2)


def _zone(area: Solid, zone_type: ZoneType, level: float, maximum_speed: float | None = None) -> SiteZone:
    outline = counterclockwise([area.world(*corner) for corner in area.corners()])
    return SiteZone(name=area.name, zone_type=zone_type, outline=outline, level=level, maximum_speed=maximum_speed)


def _action_zones(map: Map, ontology: Ontology, actions: Mapping[str, ZoneActions]) -> Iterator[SiteZone]:
    for name in sorted(actions.keys() & map.objects.keys()):
        with contextlib.suppress(SimulationError):  # one without a usable shape is left out: `somrs check` names it
            if (area := area_of(map.objects[name], ontology)) is not None:
                yield msgspec.structs.replace(_zone(area, ZoneType.ACTION, area.z), actions=actions[name])


def _floors(map: Map, ontology: Ontology) -> Iterator[Solid]:
    kinds = [kind for kind in ontology.types if ontology.is_subtype(kind, "Floor")]
    for name in sorted(name for kind in kinds for name in map.of_type(kind)):
        solid = solid_of(map.objects[name], ontology)
        if solid is not None and solid.role is Role.FLOOR:
            yield solid


def _one_way_zones(lanes: Sequence[MapLane], map: Map, ontology: Ontology) -> list[SiteZone]:
    """Zones that meet no other lane: those of two directions must not overlap (3.0, table 8)."""
    on_floors = [(lane, _strip(lane, map, ontology)) for lane in lanes if abs(lane.start.level - lane.end.level) < SAME_FLOOR]
    strips = [(lane, strip) for lane, strip in on_floors if strip]
    found: list[SiteZone] = []
    for lane, strip in strips:
        if lane.bidirectional or lane.start.lift is not None or lane.end.lift is not None:
            continue
        if any(_meet(lane, strip, neighbour, area) for neighbour, area in strips if neighbour is not lane):
            continue
        direction = math.atan2(lane.end.y - lane.start.y, lane.end.x - lane.start.x)
        level = lane.start.level
        found.append(SiteZone(name=lane.name, zone_type=ZoneType.DIRECTED, outline=strip, level=level, direction=direction))
    return found


def _meet(lane: MapLane, strip: Sequence[Point], neighbour: MapLane, area: Sequence[Point]) -> bool:
    return abs(lane.start.level - neighbour.start.level) < SAME_FLOOR and overlap(strip, area)


def _strip(lane: MapLane, map: Map, ontology: Ontology) -> tuple[Point, ...]:
    """The area of a lane, which ends half of its width before its waypoints; empty if it is too short."""
    width = value_of(lane.name, "LaneWidth", map, ontology)
    half = (float(width) if isinstance(width, int | float) and width > 0 else LANE_WIDTH) / 2
    if lane.length <= 2 * half:
        return ()
    dx, dy = (lane.end.x - lane.start.x) / lane.length, (lane.end.y - lane.start.y) / lane.length
    start = lane.start.x + half * dx, lane.start.y + half * dy
    end = lane.end.x - half * dx, lane.end.y - half * dy
    side = -half * dy, half * dx
    return (
        (start[0] - side[0], start[1] - side[1]),
        (end[0] - side[0], end[1] - side[1]),
        (end[0] + side[0], end[1] + side[1]),
        (start[0] + side[0], start[1] + side[1]),
    )
