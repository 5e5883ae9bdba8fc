"""Mistakes in the geometry of a map: what stands in walls, what no robot can reach, lanes that lead through something, coordinates that
cannot be metres.

Objects and their positions are taken exactly; only for what is reachable the ground is a grid, coarser than that of `free_space.py`.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from somrs.errors import SimulationError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology
from somrs.space.dimensions import ROBOT_HEIGHT, dimensions_of
from somrs.space.distances import STEP, distances_from, distances_from_segment, points_along
from somrs.space.fitting import TOLERANCE, is_in_the_way, overlaps
from somrs.space.lanes import MapLane, lanes_of
from somrs.space.reachability import Ground
from somrs.space.solids import Point, Role, Solid, area_of, solid_of
from somrs.space.standing import BESIDE, above_supports, beside_supports, beside_text
from somrs.space.way_back import lanes_without_way_back
from somrs.space.zones import NO_GO_ZONE, zone_objects

ROBOT_RADIUS = 0.25
"""The radius of a robot where the map has none, m."""
_LEVEL_DISTANCE = 0.3
"""The largest difference between the height of an object and of the floor that it stands on, m."""
_NARROW = 0.05
"""By how much a lane may be too narrow, m: drawn lanes are not in the middle of doors."""
_SMALLEST_SITE, _LARGEST_SITE = 1.0, 20_000.0
_FARTHEST = 100_000.0
"""How far from the origin of its map an object may be, m: a building is not, and computations would become inexact."""
_SHORTEST_LANE = 0.05
_DOOR_WIDTHS = (0.4, 12.0)
_EDGE = 0.3
"""How far the floors of neighbouring storeys may overlap, m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A mistake in the geometry: the object, what is wrong with it, and what to do."""

    subject: str
    rule: str
    message: str


def find_mistakes(map: Map, ontology: Ontology) -> list[Finding]:
    """All mistakes in the geometry of a map. If its coordinates cannot be metres, this alone; else if storeys are in one another, this."""
    site = _Site(map, ontology)
    return site.unbuildable + (
        list(site.implausible_sizes())
        or list(site.storeys_in_one())
        or [
            *site.in_walls(),
            *site.beside_supports(),
            *site.above_supports(),
            *site.standing_still(),
            *site.without_floor(),
            *site.small_lifts(),
            *site.in_shafts(),
            *site.blocked_lanes(),
            *site.without_way_back(),
            *site.in_zones(),
            *site.unreachable(),
        ]
    )


@dataclass(frozen=True, slots=True)
class _Spot:
    """A robot, a place or a waypoint: where it is."""

    name: str
    type: str
    point: Point
    z: float


class _Site:
    """The solids of a map, its robots, places and lanes."""

    def __init__(self, map: Map, ontology: Ontology) -> None:
        self.map, self.ontology = map, ontology
        self.unbuildable: list[Finding] = []
        solids = [solid for object in map.objects.values() if (solid := self._solid(object, solid_of)) is not None]
        self.zones = [area for object in zone_objects(map, ontology) if (area := self._solid(object, area_of)) is not None]
        self.solids = solids
        self.floors = [solid for solid in solids if solid.role is Role.FLOOR]
        self.walls = [solid for solid in solids if solid.role is Role.WALL]
        self.robots = [solid for solid in solids if solid.role is Role.ROBOT]
        self.passages = [solid for solid in solids if ontology.is_subtype(solid.type, "Passage")]
        self.in_lifts = {
            fact.arguments[0] for fact in map.facts("isIn") if ontology.is_subtype(map.objects[fact.arguments[1]].type, "Lift")
        }
        self.standing = [solid for solid in solids if is_in_the_way(solid, ontology)]
        self.places = [spot for spot in self._spots("Place") if spot.name not in self.in_lifts]
        self.waypoints = [spot for spot in self._spots("Waypoint") if spot.name not in self.in_lifts]
        self.robot_radius = min((dimensions_of(robot).radius for robot in self.robots), default=ROBOT_RADIUS)
        self.levels = self._levels()

    def _solid(self, object: Object, solid_maker: Callable[[Object, Ontology], Solid | None]) -> Solid | None:
        try:
            return solid_maker(object, self.ontology)
        except SimulationError as error:
            self.unbuildable.append(Finding(subject=object.name, rule="shape", message=str(error).removeprefix(f"{object.name}: ")))
            return None

    def _spots(self, type: str) -> list[_Spot]:
        return [spot for object in self.map.objects.values() if self.ontology.is_subtype(object.type, type) and (spot := _spot(object))]

    def _levels(self) -> list[float]:
        """The heights of the floors, of which those that are almost equal are one."""
        levels: list[float] = []
        for top in sorted(floor.top for floor in self.floors):
            if not levels or top - levels[-1] > _LEVEL_DISTANCE:
                levels.append(top)
        return levels

    def _level_of(self, z: float) -> float | None:
        level = min(self.levels, key=lambda level: abs(level - z), default=None)
        return level if level is not None and abs(level - z) <= _LEVEL_DISTANCE else None

    def _floors_of(self, level: float) -> list[Solid]:
        return [floor for floor in self.floors if abs(floor.top - level) <= _LEVEL_DISTANCE]

    def _standing_on(self, level: float) -> list[Solid]:
        return [solid for solid in self.standing if solid.z < level + ROBOT_HEIGHT and solid.top > level + TOLERANCE]

    # Coordinates that cannot be metres

    def implausible_sizes(self) -> Iterator[Finding]:
        points = [(solid.x, solid.y) for solid in (*self.walls, *self.standing, *self.robots)] + [spot.point for spot in self.waypoints]
        root = next(iter(self.map.roots()), "map")
        if len(points) > 3:
            extent = max(max(values) - min(values) for values in zip(*points, strict=True))
            if not _SMALLEST_SITE <= extent <= _LARGEST_SITE:
                text = f"all that is there lies within {_length(extent)}: the coordinates cannot be metres"
                yield Finding(subject=root, rule="not-metres", message=f"{text}; convert degrees, pixels or millimetres")
                return
        for name, point, extent in (
            *((s.name, (s.x, s.y), s.extent) for s in self.solids),
            *((s.name, s.point, 0.0) for s in self.waypoints),
        ):
            if not (extent <= _LARGEST_SITE and math.hypot(*point) <= _FARTHEST):
                text = f"it reaches {_length(math.hypot(*point) + extent)} from the map's origin"
                yield Finding(subject=name, rule="not-metres", message=f"{text}; move the origin near, or correct its position or size")
        lengths = [lane.length for lane in self._lanes()]
        if len(lengths) > 3 and statistics.median(lengths) < _SHORTEST_LANE:
            text = f"half of the lanes are shorter than {_length(_SHORTEST_LANE)}: the coordinates cannot be metres; convert them"
            yield Finding(subject=root, rule="not-metres", message=text)
        for door in self.passages:
            width = max(door.width, door.depth)
            if door.form == "Box" and self.ontology.is_subtype(door.type, "Door") and not _DOOR_WIDTHS[0] <= width <= _DOOR_WIDTHS[1]:
                text = f"it is {_length(width)} wide, which no door is; correct its Shape.Width, or the unit of the coordinates"
                yield Finding(subject=door.name, rule="not-metres", message=text)

    # Storeys and lifts

    def storeys_in_one(self) -> Iterator[Finding]:
        """Storeys at the height of another one whose floor is under the same points."""
        floors: dict[str, list[Solid]] = {}
        for floor in self.floors:
            storey = self.map.whole(floor.name)
            while storey is not None and not self.ontology.is_subtype(self.map.objects[storey].type, "Storey"):
                storey = self.map.whole(storey)
            if storey is not None:
                floors.setdefault(storey, []).append(floor)
        for storey, second_storey in combinations(floors, 2):
            pairs = product(floors[storey], floors[second_storey])
            if any(abs(floor.top - second.top) <= _LEVEL_DISTANCE and _shares_ground(floor, second) for floor, second in pairs):
                text = f"its floor is where that of {storey} is: their heights are equal"
                yield Finding(
                    subject=second_storey, rule="same-height", message=f"{text}; correct Elevation, and the height of all that is there"
                )

    def small_lifts(self) -> Iterator[Finding]:
        """Lifts with cabins into which no robot fits."""
        for lift in (solid for solid in self.solids if self.ontology.is_subtype(solid.type, "Lift")):
            size = min(lift.width, lift.depth) if lift.form == "Box" else 2 * lift.extent
            if size < 2 * self.robot_radius:
                text = f"its cabin is {_length(size)} wide, and the smallest robot {_length(2 * self.robot_radius)}; correct its Shape"
                yield Finding(subject=lift.name, rule="lift-small", message=text)

    def in_shafts(self) -> Iterator[Finding]:
        """Robots in the shaft of a lift that are not where its cabin is."""
        for lift, robot in product((solid for solid in self.solids if solid.role is Role.LIFT), self.robots):
            if lift.distance(robot.x, robot.y) < 0 and abs(robot.z - lift.z) > _LEVEL_DISTANCE:
                text = f"it is in the shaft of {lift.name} at {_length(robot.z)}, and the cabin at {_length(lift.z)}; move one of them"
                yield Finding(subject=robot.name, rule="in-shaft", message=text)

    # Things in walls

    def in_walls(self) -> Iterator[Finding]:
        """Robots that overlap something, and furniture that overlaps a wall or a window: what each of them is deepest in."""
        deepest: dict[str, tuple[float, Solid, Solid]] = {}
        for solid, obstacle, depth in overlaps([*self.robots, *self.standing], self.solids, self.map, self.ontology):
            is_told_of_the_robot = obstacle.role is Role.ROBOT and solid.role is not Role.ROBOT
            if not is_told_of_the_robot and (solid.name not in deepest or depth > deepest[solid.name][0]):
                deepest[solid.name] = depth, solid, obstacle
        for name, (depth, solid, obstacle) in deepest.items():
            correction = "move it away" if solid.role is Role.ROBOT else "move it away, or correct its Shape"
            yield Finding(subject=name, rule="in-wall", message=f"it stands {_length(depth)} deep in {obstacle.name}; {correction}")

    def beside_supports(self) -> Iterator[Finding]:
        """Things that are beside what they are on."""
        for name, support, distance in beside_supports(self.map, self.ontology, self.map.objects):
            yield Finding(subject=name, rule=BESIDE, message=beside_text(support, distance))

    def above_supports(self) -> Iterator[Finding]:
        """Things that float above what they are on."""
        for name, support, distance in above_supports(self.map, self.ontology, self.map.objects):
            text = f"it is on {support}, and its position is {distance:.2f} m above that; correct PositionZ, or what it is on"
            yield Finding(subject=name, rule="floating", message=text)

    def standing_still(self) -> Iterator[Finding]:
        """Robots that would never arrive."""
        for robot in self.robots:
            if robot.speed <= 0:
                yield Finding(
                    subject=robot.name, rule="speed", message="its Speed is 0, so it never moves; give how fast it drives, in m/s"
                )

    def without_floor(self) -> Iterator[Finding]:
        """Robots and places that are on no floor."""
        if not self.floors:
            return
        robots = [_Spot(robot.name, robot.type, (robot.x, robot.y), robot.z) for robot in self.robots if robot.name not in self.in_lifts]
        zones = [_Spot(zone.name, zone.type, (zone.x, zone.y), zone.z) for zone in self.zones if self._level_of(zone.z) is None]
        for spot in (*robots, *self.places, *zones):
            if not self._is_on_floor(spot):
                message = "there is no floor under it; move it, correct its height, or add a floor"
                yield Finding(subject=spot.name, rule="no-floor", message=message)

    def _is_on_floor(self, spot: _Spot) -> bool:
        level = self._level_of(spot.z)
        return level is not None and any(floor.distance(*spot.point) <= STEP for floor in self._floors_of(level))

    # Zones

    def in_zones(self) -> Iterator[Finding]:
        """Places in no-go zones, to which nobody goes, and robots that stand in one."""
        for zone in (area for area in self.zones if self.ontology.is_subtype(area.type, NO_GO_ZONE)):
            for place in self.places:
                if abs(place.z - zone.z) <= _LEVEL_DISTANCE and zone.distance(*place.point) < 0:
                    message = f"no robot goes there: it is in the no-go zone {zone.name}; move one of them"
                    yield Finding(subject=place.name, rule="no-go", message=message)
            for robot in self.robots:
                if abs(robot.z - zone.z) <= _LEVEL_DISTANCE and zone.distance(robot.x, robot.y) < 0:
                    message = f"it stands in the no-go zone {zone.name}, and can only leave it; move one of them"
                    yield Finding(subject=robot.name, rule="no-go", message=message)

    # Lanes

    def _lanes(self) -> Iterator[MapLane]:
        """The lanes on one storey."""
        return (lane for lane in lanes_of(self.map, self.ontology) if abs(lane.start.level - lane.end.level) <= _LEVEL_DISTANCE)

    def blocked_lanes(self) -> Iterator[Finding]:
        """Lanes that lead through something, or so near to it that no robot of their graph gets through."""
        centres, extents = np.array([(s.x, s.y) for s in self.standing]).reshape(-1, 2), np.array([s.extent for s in self.standing])
        radii = self._radii()
        for lane in self._lanes():
            start, end = (lane.start.x, lane.start.y), (lane.end.x, lane.end.y)
            radius, points = radii.get(lane.graph, 0.0), points_along(start, end)
            near = np.nonzero(distances_from_segment(centres[:, 0], centres[:, 1], start, end) < extents + radius)[0]
            distances = {
                solid.name: float(distances_from(solid, points).min())
                for solid in (self.standing[index] for index in near.tolist())
                if solid.z < lane.start.level + ROBOT_HEIGHT and solid.top > lane.start.level + 2 * TOLERANCE
            }
            ends = f"from {lane.start.name} to {lane.end.name}"
            if blocking := [name for name, distance in distances.items() if distance < -TOLERANCE]:
                message = f"{ends}, it leads through {_some(blocking)}; move a waypoint or what stands there"
                yield Finding(subject=lane.name, rule="lane-blocked", message=message)
            elif distances and (distance := min(distances.values())) < radius - _NARROW:
                nearest = min(distances, key=lambda name: distances[name])
                text = f"{ends}, {nearest} is {_length(max(distance, 0.0))} from it, and the robots of its graph need {_length(radius)}"
                yield Finding(subject=lane.name, rule="lane-narrow", message=f"{text}; move a waypoint or what stands there")

    def without_way_back(self) -> Iterator[Finding]:
        """One-way lanes behind which robots would be caught."""
        for lane in lanes_without_way_back(self.map, self.ontology):
            text = f"from {lane.start}, it leads one way to {_some(lane.behind)}, and no lane leads back from there, so robots return on it"
            message = f"{text}; make it Bidirectional, turn it round, or add a lane back"
            yield Finding(subject=lane.lane, rule="no-way-back", message=message)

    def _graph(self, name: str) -> str | None:
        graph = self.map.objects[name].values.get("NavigationGraph")
        return None if graph is None else str(graph)

    def _radii(self) -> dict[str | None, float]:
        """The radius of the smallest robot of each graph, and of all, for lanes of no graph."""
        radii: dict[str | None, float] = {None: self.robot_radius}
        for robot in self.robots:
            graph, radius = self._graph(robot.name), dimensions_of(robot).radius
            if graph is not None:
                radii[graph] = min(radius, radii.get(graph, radius))
        return radii

    # Places that cannot be reached

    def unreachable(self) -> Iterator[Finding]:
        for level in self.levels:
            places = [place for place in self.places if self._level_of(place.z) == level and self._is_on_floor(place)]
            if not places:
                continue
            standing = self._standing_on(level)
            tight = {place.name: nearest for place in places if (nearest := self._too_near(place, standing)) is not None}
            for name, solid in tight.items():
                message = f"no robot has room there: {solid.name} is nearer than {_length(self.robot_radius)}; move one of them"
                yield Finding(subject=name, rule="unreachable", message=message)
            ground = Ground(standing, self._floors_of(level), self.passages, self.robot_radius)
            robots = [robot for robot in self.robots if self._level_of(robot.z) == level]
            home = ground.regions([(robot.x, robot.y) for robot in robots]) or ground.largest([place.point for place in places])
            origin = "where robots stand" if robots else "the other places of the storey"
            for place in places:
                if place.name not in tight and ground.region(place.point) not in home:
                    message = f"there is no way to it from {origin} that is {_length(2 * self.robot_radius)} wide; open one, or move it"
                    yield Finding(subject=place.name, rule="unreachable", message=message)

    def _too_near(self, place: _Spot, standing: Sequence[Solid]) -> Solid | None:
        nearest = min(standing, key=lambda solid: solid.distance(*place.point), default=None)
        return nearest if nearest is not None and nearest.distance(*place.point) < self.robot_radius - TOLERANCE else None


def _shares_ground(floor: Solid, second: Solid) -> bool:
    """Whether the two have points in common that are well inside both, seen from above: neighbours may overlap at their edges."""
    offsets = np.linspace(-floor.extent, floor.extent, 40)
    points = np.stack(np.meshgrid(floor.x + offsets, floor.y + offsets), axis=-1).reshape(-1, 2)
    return bool(np.any((distances_from(floor, points) < -_EDGE) & (distances_from(second, points) < -_EDGE)))


def _spot(object: Object) -> _Spot | None:
    x, y, z = (object.values.get(path) for path in ("PositionX", "PositionY", "PositionZ"))
    if not isinstance(x, float | int) or not isinstance(y, float | int) or not math.isfinite(x + y):
        return None
    return _Spot(object.name, object.type, (float(x), float(y)), float(z) if isinstance(z, float | int) else 0.0)


def _length(metres: float) -> str:
    return f"{metres:.2f} m" if metres < 1000 else f"{metres / 1000:.0f} km"


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
