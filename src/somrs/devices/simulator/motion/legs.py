"""Driving distances of a robot, for quotes: from its position through a sequence of stops, in a promised situation."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from somrs.devices.simulator.link.lines import HANDLES, Legs, PathStop, StandAt, Stops
from somrs.devices.simulator.motion.driven_world import DrivenWorld, Driver
from somrs.devices.simulator.motion.driving import MARGIN
from somrs.devices.simulator.motion.placement import outline_spots, reaching_bases
from somrs.entish import Attribute, Comparison, Name, Number, Relation, Truth
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.errors import FormulaError, UsageError
from somrs.space.clearance import Disc
from somrs.space.edges import edge_targets
from somrs.space.free_space import FreeSpace
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import CARRYING, Point, Role, Solid
from somrs.traffic.ways import Closed, Goal, Stands, Way, Ways

EDGE = 0.1
"""Distance from the edge of a support at which things are taken to be put, m."""
AROUND = 1.5
"""Height above the floor above which an arm does not reach into what it is beside, m."""
ELEVATION = 0.8
"""Height above the floor at which the arm reaches a stop that is a point, m."""
BELOW, ABOVE = 0.5, 2.2
"""What stands lower or higher than this, from the robot's floor, is on another storey, m."""


@dataclass(slots=True)
class _Promised:
    """The promised situation: doors that will be open (True) or shut; what things and robots will be at; their known positions."""

    doors: dict[str, bool] = field(default_factory=dict)
    carriers: dict[str, str] = field(default_factory=dict)
    points: dict[str, tuple[float, ...]] = field(default_factory=dict)

    @classmethod
    def read(cls, situation: str | None, solids: Mapping[str, Solid]) -> _Promised:
        """Raises UsageError for a situation that is no formula."""
        promised, positions = cls(), dict[str, dict[str, float]]()
        try:
            parts = conjuncts(parse(situation)) if situation is not None else ()
        except FormulaError as error:
            raise UsageError(f"the situation is no formula: {error}") from None
        for part in parts:
            match part:
                case Comparison(Attribute(Name(name), "Open"), "=", Truth(is_open)) if name in solids and solids[name].role is Role.DOOR:
                    promised.doors[name] = is_open
                case Comparison(Attribute(Name(name), "PositionX" | "PositionY" | "PositionZ" as path), "=", Number(value)) if (
                    name in solids
                ):
                    positions.setdefault(name, {})[path] = value
                case Relation(_, (Name(name), Name(carrier), *_)) if carrier in solids and _is_movable(solids.get(name)):
                    promised.carriers[name] = carrier
        stated = {name: values for name, values in positions.items() if {"PositionX", "PositionY"} <= values.keys()}
        promised.points = {
            name: tuple(values[path] for path in ("PositionX", "PositionY", "PositionZ") if path in values)
            for name, values in stated.items()
        }
        return promised

    def stop(self, stop: PathStop) -> PathStop:
        """Where the robot has to go for this stop."""
        visited_stops = set[str]()
        while isinstance(stop, str) and stop not in visited_stops and stop in {*self.points, *self.carriers}:
            visited_stops.add(stop)
            stop = self.points[stop] if stop in self.points else self.carriers[stop]
        return stop


@lru_cache(maxsize=1024)
def _edge_points(solid: Solid) -> tuple[Point, ...]:
    """Points on a support where things are taken to be put."""
    return tuple(point for point, _ in edge_targets(solid, EDGE))


def _is_movable(solid: Solid | None) -> bool:
    return solid is not None and solid.role in (Role.THING, Role.ROBOT)


def _nothing(way: Way) -> float:
    return 0.0


def find_legs(
    world: DrivenWorld, driver: Driver, stops: Stops, situation: str | None = None, extra: Callable[[Way], float] = _nothing
) -> Legs:
    """Driving distances in metres to the first stop, from there to the next, and so on; None from the first leg without a path on.

    If shut doors leave no path, the legs are those of a shortest path with the doors on it open, and the doors are named. So are the open
    doors without which there is no path. Other robots count as obstacles only if they cannot move. Raises UsageError for an unknown
    object.
    """
    solids = world.solids
    promised = _Promised.read(situation, solids)
    last_solid = solids.get(stops[-1]) if stops and isinstance(stops[-1], str) else None
    carries = last_solid is None or last_solid.role in CARRYING
    ways = world.ways()
    doors = {name: solids[name] for name in ways.doors if name in solids and name not in world.doors_for_all}
    unusable = frozenset(name for name in doors if name in world.unusable_doors)
    shut_doors = frozenset(name for name, door in doors.items() if name in unusable or not promised.doors.get(name, door.open))
    planner = _LegPlanner(world, ways, driver, promised, doors)
    lifts, zones = frozenset(world.unusable_lifts), world.zones
    closed = Closed(shut_doors, lifts, planner.standing(), zones.forbidden, zones.slow)
    leg_ways = planner.ways(stops, closed)
    if None not in leg_ways or not (shut_doors or lifts or zones.forbidden):
        needed_doors = _needed(planner, stops, closed, leg_ways)
        return Legs(_lengths(leg_ways, extra), (), needed_doors, carries, out_of_reach=planner.is_out_of_reach(stops, leg_ways))
    to_move = {stop.removesuffix(HANDLES) for stop in stops if isinstance(stop, str) and stop.endswith(HANDLES)}
    staying_shut = unusable | (shut_doors & to_move)  # none can be opened from behind itself
    with_doors = planner.ways(stops, replace(closed, doors=staying_shut))
    if None in with_doors:
        out_of_order, forbidden = _closing(planner, stops, replace(closed, doors=staying_shut))
        passages = tuple(passage for passage in out_of_order if passage not in to_move)
        out_of_reach = planner.is_out_of_reach(stops, leg_ways)
        return Legs(_lengths(leg_ways, extra), carries=carries, out_of_order=passages, zones=forbidden, out_of_reach=out_of_reach)
    to_open = [door for door in doors if door in shut_doors and door in _doors(with_doors)]
    for door in [*to_open] if len(to_open) > 1 else ():  # a longer way may need fewer doors
        shorter = planner.ways(stops, replace(closed, doors=(shut_doors - {*to_open}) | {door}))
        if None not in shorter:
            to_open.remove(door)
            with_doors = shorter
    closed = replace(closed, doors=shut_doors - {*to_open})
    needed_doors = _needed(planner, stops, closed, with_doors)
    return Legs(_lengths(with_doors, extra), tuple(to_open), tuple(door for door in needed_doors if door not in to_open), carries)


def _closing(planner: _LegPlanner, stops: Stops, closed: Closed) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What closes the way: the doors and lifts that are out of order, on the ways that there would be without some of them; and the no-go
    zones without each of which there would be one."""
    zones = tuple(area.name for area in closed.forbidden if _is_way(planner, stops, closed, omitted=area))
    for passable in (closed, replace(closed, forbidden=())) if not zones else ():
        passages = _closed_passages(planner, stops, passable)
        if passages is not None:
            return passages, () if passable is closed else tuple(area.name for area in closed.forbidden)
    return (), zones


def _closed_passages(planner: _LegPlanner, stops: Stops, closed: Closed) -> tuple[str, ...] | None:
    """The doors, and then the lifts, on a way that there would be if none was closed, and on those which lead around each of them; None if
    there is no way."""
    passages: dict[str, None] = {}
    avoided: frozenset[str] = frozenset()
    on_way = _passed(planner, stops, closed, avoided)
    if on_way is None:
        return None
    waiting = [*on_way]
    while waiting:
        passage = waiting.pop(0)
        passages[passage] = None
        on_way = _passed(planner, stops, closed, avoided | {passage})
        if on_way is not None:
            avoided |= {passage}
            waiting += [name for name in on_way if name not in passages and name not in waiting]
    return (*sorted(closed.doors & passages.keys()), *sorted(closed.lifts & passages.keys()))


def _passed(planner: _LegPlanner, stops: Stops, closed: Closed, avoided: frozenset[str]) -> list[str] | None:
    """The closed doors and lifts through which the way would lead if only those to be avoided were closed; None without a way."""
    leg_ways = planner.ways(stops, replace(closed, doors=closed.doors & avoided, lifts=closed.lifts & avoided))
    if None in leg_ways:
        return None
    lifts = {lift for way in leg_ways if way is not None for lift in way.lifts}
    return sorted((closed.doors & _doors(leg_ways)) | (closed.lifts & lifts))


def _is_way(planner: _LegPlanner, stops: Stops, closed: Closed, omitted: Solid) -> bool:
    """Whether there would be a way without this no-go zone."""
    return None not in planner.ways(stops, replace(closed, forbidden=tuple(area for area in closed.forbidden if area is not omitted)))


def _needed(planner: _LegPlanner, stops: Stops, closed: Closed, leg_ways: Sequence[Way | None]) -> tuple[str, ...]:
    """The open doors on the ways without which there is no way."""
    passed_doors = [door for door in planner.doors if door in _doors(leg_ways) and door not in closed.doors]
    if None in leg_ways or (
        len(passed_doors) > 1 and None not in planner.ways(stops, replace(closed, doors=closed.doors | {*passed_doors}))
    ):
        return ()
    return tuple(door for door in passed_doors if None in planner.ways(stops, replace(closed, doors=closed.doors | {door})))


def _doors(leg_ways: Sequence[Way | None]) -> frozenset[str]:
    """The doors through which the ways lead."""
    return frozenset(door for way in leg_ways if way is not None for door in way.doors)


def _lengths(leg_ways: Sequence[Way | None], extra: Callable[[Way], float]) -> tuple[float | None, ...]:
    return tuple(way.length + extra(way) if way is not None else None for way in leg_ways)


class _LegPlanner:
    """Plans the legs of one robot in a promised situation."""

    def __init__(self, world: DrivenWorld, ways: Ways, robot: Driver, promised: _Promised, doors: Collection[str]) -> None:
        self._world, self._ways, self._robot, self._promised = world, ways, robot, promised
        self.doors = doors
        """The doors that do not open for robots."""

    def standing(self) -> tuple[tuple[float, Disc], ...]:
        """The other robots that cannot move, of any make, and the heights of their floors."""
        all_discs = self._world.standing(self._robot)
        return tuple((round(level, 1), Disc(round(disc.x, 2), round(disc.y, 2), disc.radius)) for level, disc in all_discs)

    def ways(self, stops: Stops, closed: Closed) -> list[Way | None]:
        """The way of each leg; None from the first leg without a way on."""
        place: tuple[Point, float] | None = self._start()
        leg_ways: list[Way | None] = []
        for stop in stops:
            way = self._way(*place, self._promised.stop(stop), closed) if place is not None else None
            leg_ways.append(way)
            place = (way.end, way.level) if way is not None else None
        return leg_ways

    def _way(self, position: Point, level: float, stop: PathStop, closed: Closed) -> Way | None:
        """The shortest way to where the robot would reach the stop; None if there is none."""
        goal_level = self._level_of(stop, level)
        if goal_level is None:
            return None
        if abs(goal_level - level) < SAME_FLOOR and self._is_there(position, stop):
            return Way(0.0, position, level)
        goal = self._goal(stop, goal_level)
        return self._ways.way(position, level, goal, closed, self._robot.solid.speed) if goal is not None else None

    def is_out_of_reach(self, stops: Stops, leg_ways: Sequence[Way | None]) -> bool:
        """Whether there is no point from which the robot would reach the first stop without a way: none on the floor below it that is not
        in a gap, or no such floor in the building."""
        if None not in leg_ways:
            return False
        stop = self._promised.stop(stops[leg_ways.index(None)])
        level = self._level_of(stop, self._robot.level)
        if level is not None:
            goal = self._goal(stop, level)
            return goal is not None and not len(goal.places)
        floors = [solid.top for solid in self._world.solids.values() if solid.role is Role.FLOOR]
        return self._highest_below(stop, floors) is None

    def _is_there(self, position: Point, stop: PathStop) -> bool:
        """Whether the robot is where it is to go: within reach of the point, or in the room."""
        if isinstance(stop, StandAt):
            return position == (stop.x, stop.y)
        if isinstance(stop, str):
            solid = self._world.solids.get(stop)
            return solid is not None and solid.role is Role.FLOOR and solid.distance(*position) < 0
        return self._robot.size.nearest <= math.dist(position, stop[:2]) <= self._robot.size.farthest

    def _goal(self, stop: PathStop, level: float) -> Goal | None:
        """Where on a floor the robot would reach the object or point."""
        if isinstance(stop, StandAt):
            return self._standing_at((stop.x, stop.y), level)
        if not isinstance(stop, str):
            return self._reaching([(stop[0], stop[1])], level + ELEVATION, level)
        if stop.endswith(HANDLES):
            return self._moving(stop.removesuffix(HANDLES), level)
        solid = self._world.solids[stop]
        if solid.role in CARRYING and solid.role not in (Role.MARK, Role.FLOOR):
            return self._reaching(_edge_points(solid), solid.top, level)
        if solid.role in (Role.THING, Role.MARK, Role.ROBOT, Role.FLOOR):
            x, y, z, _ = self._world.pose(stop)
            return self._reaching([(round(x, 2), round(y, 2))], round(z, 2), level, self._world.container(stop))
        return self._reaching(outline_spots(solid).tolist(), max(solid.top, level + AROUND), level)

    def _standing_at(self, point: Point, level: float) -> Goal | None:
        """The point itself, if the robot has room there."""

        def find_stands(space: FreeSpace) -> Stands:
            has_room = space.free(point, self._robot.size.radius + MARGIN)
            points = np.array([point] if has_room else []).reshape(-1, 2)
            return Stands(points, np.zeros(len(points)))

        return self._ways.goal((point, self._robot.size), level, self._robot.kind, find_stands)

    def _moving(self, owner: str, level: float) -> Goal | None:
        """Where on a floor the robot would begin to move a door, or the first of the doors of furniture, all of which it can move."""
        robot, world = self._robot, self._world
        ways = world.leaf_ways(owner, self._promised.doors.get(owner, world.solids[owner].open))

        def find_stands(space: FreeSpace) -> Stands:
            bases_by_leaf = world.leaf_bases(robot, owner, ways, level)
            free_bases = [bases[space.clearances(bases) >= robot.size.radius + MARGIN + 0.015] for bases in bases_by_leaf]
            chosen = free_bases[0] if all(map(len, free_bases)) else np.zeros((0, 2))
            return Stands(chosen, np.zeros(len(chosen)))

        return self._ways.goal((owner, *ways, robot.size), level, robot.kind, find_stands)

    def _reaching(self, spots: Sequence[Sequence[float]], top: float, level: float, container: str | None = None) -> Goal | None:
        """Where on a floor the robot would reach one of some spots at a height, on a support or in a container."""
        robot, world, solids = self._robot, self._world, self._world.solids
        points, container_solid = np.array(spots, dtype=float), solids[container] if container is not None else None

        def find_stands(space: FreeSpace) -> Stands:
            bases, _, costs = reaching_bases(
                robot.size, world.clearances, points, top, np.zeros(len(points)), space.clearances, container_solid
            )
            return Stands(bases, costs)

        key = points.tobytes(), top, container, robot.size
        return self._ways.goal(key, level, robot.kind, find_stands)

    def _start(self) -> tuple[Point, float]:
        """Where the robot will be, and the height of that floor."""
        place = self._promised.stop(self._robot.name)
        level = self._level_of(place, self._robot.level) if place != self._robot.name else None
        position = self._robot.pose()[:2] if place == self._robot.name else place
        if isinstance(position, str):
            position = self._world.pose(position)[:2]
        assert isinstance(position, tuple), "a promise says where a robot will be, and not where it is to stand"
        return (position[0], position[1]), self._robot.level if level is None else level

    def _level_of(self, stop: PathStop, level: float) -> float | None:
        """The height of the floor on which an object or a point is: the highest one below it. None if the robot cannot reach it from there.

        A point without a height is on the robot's `level`.
        """
        if (isinstance(stop, StandAt) and stop.z is None) or (isinstance(stop, tuple) and len(stop) < 3):
            return level
        return self._highest_below(stop, self._ways.levels)

    def _highest_below(self, stop: PathStop, floors: Iterable[float]) -> float | None:
        """The highest of some floors from which an object, or a point with a height, could be reached; None if there is none."""
        if isinstance(stop, str):
            name = stop.removesuffix(HANDLES)
            solid = self._world.solids.get(name)
            if solid is None:
                raise UsageError(f"{name} is not in the simulated world")
            if name != stop and not self._world.has_leaves(name):
                raise UsageError(f"{name} has no door that could be moved")
            base = self._world.pose(stop)[2] if _is_movable(solid) else solid.z
            height = solid.top if solid.role is Role.FLOOR else base
        else:
            height = (stop.z or 0.0) if isinstance(stop, StandAt) else stop[2]
        return max((floor for floor in floors if -BELOW < height - floor < ABOVE), default=None)
