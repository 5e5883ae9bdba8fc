"""Shortest ways on a roadmap, for quotes: how far a robot would drive to where it reaches something, through which doors and lifts.

The distances of all places from a goal are found together, once for all robots that ask for it. A robot then only needs to know which
places it sees from where it stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from somrs.space.clearance import Disc
from somrs.space.distances import distances_from, distances_from_segment
from somrs.space.free_space import SLACK, FreeSpace
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Point, Solid
from somrs.traffic.layout import MARGIN
from somrs.traffic.obstructions import Obstructions, least_room
from somrs.traffic.planning.graph import FAR, Lane
from somrs.traffic.planning.recent import recall
from somrs.traffic.roadmap import NumberedRoadmap, RobotKind

DOOR_WAIT = 3.0
"""What a robot is taken to wait until an automatic door is open, s."""
LIFT_WAIT = 10.0
"""The time for which a robot is taken to wait for a lift, s."""
MOST_FIELDS = 256
"""The number of distance fields and of goals that are kept."""
MOST_VIEWS = 4096
"""The number of ways that are kept, and of points for which it is kept what robots see from there."""

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Closed:
    """What robots cannot pass: these doors and lifts, what stands on floors, by their heights, and `forbidden` areas. `slow`: the zones in
    which they drive slowly, with the highest speed there, m/s."""

    doors: frozenset[str] = frozenset()
    lifts: frozenset[str] = frozenset()
    standing: tuple[tuple[float, Disc], ...] = ()
    forbidden: tuple[Solid, ...] = ()
    slow: tuple[tuple[Solid, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Stands:
    """Points (n, 2) from which a robot reaches something, in metres, and what it does to stand at better ones, in metres of driving (n)."""

    points: NDArray[np.float64]
    costs: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Where a robot of a kind wants to go on a floor: to one of some stands.

    `places` (n) are those from which it drives straight to a stand, whose number is in `stands_seen` (n).
    """

    level: float
    kind: RobotKind
    stands: Stands
    places: NDArray[np.int64]
    stands_seen: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Way:
    """A way. `length`: in metres, where a ride in a lift, and a lane in a slow zone, count as far as the robot drives in that time; `end`:
    where it ends, and the height of that floor; `doors`, `lifts`: through which it leads; `points`: those of its places, with its beginning
    and its end; empty for who does not drive."""

    length: float
    end: Point
    level: float
    doors: frozenset[str] = frozenset()
    lifts: frozenset[str] = frozenset()
    points: tuple[Point, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """For each place: the cost of the way to the goal, the following place on it, and the stand to which it leads straight from there."""

    costs: NDArray[np.float64]
    following: NDArray[np.int32]
    stands: Mapping[int, int]


class Ways:
    """The ways on a roadmap. `spaces`: the space of each floor with all doors open; `doors`: by their names."""

    def __init__(self, roadmap: NumberedRoadmap, spaces: Mapping[float, FreeSpace], doors: Mapping[str, Solid]) -> None:
        self._roadmap, self._spaces, self.doors = roadmap, spaces, doors
        places = roadmap.roadmap.places
        self._points = roadmap.points
        lanes = [(start, end) for start, ends in enumerate(roadmap.graph.successors) for end in ends]
        self._lane_numbers = {lane: number for number, lane in enumerate(lanes)}
        self._starts, self._ends = np.array(lanes, dtype=int).reshape(-1, 2).T
        is_ride = np.array([places[start].level != places[end].level for start, end in lanes], dtype=bool)
        self._metres = np.hypot(*(self._points[self._starts] - self._points[self._ends]).T) * ~is_ride
        self._seconds = np.array([LIFT_WAIT + roadmap.graph.length(*lane) for lane in lanes]) * is_ride
        """What rides take; 0 for lanes on one floor."""
        self._speed_limits = np.full(len(lanes), FAR)
        """In metres per second; infinite without one."""
        for (start, end), rules in roadmap.rules.items():
            self._speed_limits[self._lane_numbers[start, end]] = rules.speed_limit or FAR
        self._obstructions = obstructions = Obstructions(roadmap)
        self._closed_lanes: dict[tuple[Solid, ...], list[int]] = {}
        """By all no-go zones: the lanes that they close."""
        self._slow_lanes: dict[Solid, list[int]] = {}
        """By area: the lanes on which robots drive slowly."""
        self._lanes_of = {name: self._all_lanes(*obstructions.touching(door)) for name, door in doors.items()}
        self._lanes_of |= {lift: [self._lane_numbers[lane] for lane in obstructions.into_lift(lift)] for lift in roadmap.zones}
        self._doors_on: dict[int, list[str]] = {}
        """By lane."""
        for name in doors:
            for lane in self._lanes_of[name]:
                self._doors_on.setdefault(lane, []).append(name)
        self._waits = self._waits_for_doors(doors)
        """What robots wait on each lane for automatic doors to open, s."""
        self._goals: dict[Hashable, Goal] = {}
        self._fields: dict[Hashable, _Field] = {}
        self._ways: dict[Hashable, Way | None] = {}
        """By all on which they depend."""
        self._views: dict[Hashable, NDArray[np.int64]] = {}
        """By level, kind of robot, and point: the places that a robot sees from there."""

    def _all_lanes(self, places: Iterable[int], lanes: Iterable[Lane]) -> list[int]:
        """The numbers of lanes, and of those that lead to and from places."""
        touched = {*places}
        graph = self._roadmap.graph
        away = ((place, end) for place in touched for end in graph.successors[place])
        towards = ((start, place) for place in touched for start in graph.predecessors[place])
        return [self._lane_numbers[lane] for lane in {*lanes, *away, *towards}]

    def _waits_for_doors(self, doors: Mapping[str, Solid]) -> NDArray[np.float64]:
        """What robots wait on each lane for automatic doors to open, s: on those on which they come to a door."""
        waits = np.zeros(len(self._starts))
        for name, door in doors.items():
            if door.automatic:
                in_doorway = {*self._obstructions.touching(door)[0]}
                waits[[lane for lane in self._lanes_of[name] if self._starts[lane] not in in_doorway]] += DOOR_WAIT
        return waits

    @property
    def levels(self) -> Iterable[float]:
        """The heights of the floors."""
        return self._spaces.keys()

    def space(self, level: float) -> FreeSpace | None:
        """The space of the floor at a height, with all doors open; None if there is none."""
        return self._spaces.get(round(level, 1))

    # Goals

    def goal(self, key: Hashable, level: float, kind: RobotKind, find_stands: Callable[[FreeSpace], Stands]) -> Goal | None:
        """The goal of a robot on a floor; None if there is no such floor. It is kept: the same key stands for the same goal."""
        space = self.space(level)
        if space is None:
            return None
        whole_key = key, round(level, 1), kind
        return recall(self._goals, whole_key, lambda: self._find_goal(space, round(level, 1), kind, find_stands(space)), MOST_FIELDS)

    def _find_goal(self, space: FreeSpace, level: float, kind: RobotKind, stands: Stands) -> Goal:
        stand_numbers, places = self._roadmap.layer(level, kind).near(stands.points)
        clear = in_sight(space, kind.radius, self._points[places], stands.points[stand_numbers])
        return Goal(level, kind, stands, places[clear], stand_numbers[clear])

    # Ways

    def way(self, start: Point, level: float, goal: Goal, closed: Closed, speed: float) -> Way | None:
        """The shortest way of a robot from a point on a floor; None if there is none. `speed`: in metres per second.

        It is kept: all robots that are asked to bring a thing somewhere have the last part of their ways in common.
        """
        level = round(level, 1)
        return recall(
            self._ways, (start, level, goal, closed, speed), lambda: self._find_way(start, level, goal, closed, speed), MOST_VIEWS
        )

    def _find_way(self, start: Point, level: float, goal: Goal, closed: Closed, speed: float) -> Way | None:
        if level not in self._spaces:
            return None
        point = np.array(start, dtype=float)
        field = self._field(goal, closed, speed)
        visible_places = self._visible_places(level, goal.kind, start)
        places = visible_places[field.costs[visible_places] < FAR]
        stand_numbers = self._visible_stands(goal, start) if level == goal.level else np.zeros(0, dtype=int)
        ends = np.concatenate([self._points[places], goal.stands.points[stand_numbers]])
        clear = ~self._are_closed(level, np.broadcast_to(point, ends.shape), ends, closed, goal.kind.radius, around=start)
        costs = np.concatenate([field.costs[places], goal.stands.costs[stand_numbers]]) + np.hypot(*(ends - point).T)
        costs[~clear] = FAR
        if not len(costs) or costs.min() == FAR:
            return None
        best = int(costs.argmin())
        if best >= len(places):
            return self._finish(goal, int(stand_numbers[best - len(places)]), float(costs[best]), [], [(level, start)])
        return self._follow(field, goal, int(places[best]), float(costs[best]), level, start)

    def _visible_places(self, level: float, kind: RobotKind, start: Point) -> NDArray[np.int64]:
        """The places to which a robot can drive in a straight line from a point, with all doors open. Robots that stand are often asked."""

        def find() -> NDArray[np.int64]:
            _, near_places = self._roadmap.layer(level, kind).near(np.array([start]))
            ends = self._points[near_places]
            return near_places[in_sight(self._spaces[level], kind.radius, np.broadcast_to(np.array(start), ends.shape), ends)]

        return recall(self._views, (level, kind, start), find, MOST_VIEWS)

    def _visible_stands(self, goal: Goal, start: Point) -> NDArray[np.int64]:
        """The numbers of the stands to which a robot can drive in a straight line from a point, with all doors open."""
        point, stands = np.array(start, dtype=float), goal.stands.points
        near_stands = np.flatnonzero(np.hypot(*(stands - point).T) <= self._roadmap.layer(goal.level, goal.kind).spacing)
        ends = stands[near_stands]
        return near_stands[in_sight(self._spaces[goal.level], goal.kind.radius, np.broadcast_to(point, ends.shape), ends)]

    def _follow(self, field: _Field, goal: Goal, place: int, cost: float, level: float, start: Point) -> Way:
        """The way by the following places."""
        lanes: list[int] = []
        first = place
        while (following := int(field.following[place])) != len(self._points):
            lanes.append(self._lane_numbers[place, following])
            place = following
        ends = [(level, start), (level, self._point(first)), (goal.level, self._point(place))]
        return self._finish(goal, field.stands[place], cost, lanes, ends)

    def _finish(self, goal: Goal, stand: int, cost: float, lanes: list[int], ends: list[tuple[float, Point]]) -> Way:
        """The way by these lanes to a stand. `ends`: where it begins; where the lanes begin and end, with the heights of the floors."""
        x, y = goal.stands.points[stand].tolist()
        points = [*ends, (goal.level, (x, y))]
        doors = {door for lane in lanes for door in self._doors_on.get(lane, ())}
        for (level, start), (_, end) in (points[:2], points[-2:]):
            doors |= self._doors_between(level, start, end, goal.kind.radius)
        rides = (lane for lane in lanes if self._seconds[lane])
        lifts = {self._roadmap.roadmap.places[self._starts[lane]].zone or "" for lane in rides}
        length = max(cost - float(goal.stands.costs[stand]), 0.0)
        places = (*(point for _, point in ends[:2]), *(self._point(int(self._ends[lane])) for lane in lanes), (x, y))
        return Way(length, (x, y), goal.level, frozenset(doors), frozenset(lifts), places)

    def _point(self, place: int) -> Point:
        x, y = self._points[place].tolist()
        return x, y

    def _doors_between(self, level: float, start: Point, end: Point, radius: float) -> set[str]:
        """The doors that a robot touches on a straight line."""
        span = math.dist(start, end)
        near_doors = (
            d for d in self.doors.values() if abs(d.z - level) < SAME_FLOOR and math.dist((d.x, d.y), start) < d.extent + span + 1
        )
        return {door.name for door in near_doors if _touched(door, np.array([start]), np.array([end]), radius)[0]}

    # Distance fields

    def _field(self, goal: Goal, closed: Closed, speed: float) -> _Field:
        return recall(self._fields, (goal, closed, speed), lambda: self._find_field(goal, closed, speed), MOST_FIELDS)

    def _find_field(self, goal: Goal, closed: Closed, speed: float) -> _Field:
        """Dijkstra's algorithm, backwards from a place that all stands are joined to."""
        size = len(self._points)
        starts, ends = self._points[goal.places], goal.stands.points[goal.stands_seen]
        is_open = ~self._are_closed(goal.level, starts, ends, closed, goal.kind.radius)
        costs = np.hypot(*(starts - ends).T) + goal.stands.costs[goal.stands_seen]
        order = np.flatnonzero(is_open)[np.argsort(costs[is_open], kind="stable")]
        joined_places, first_rows = np.unique(goal.places[order], return_index=True)
        order = order[first_rows]  # the best stand of each place
        open_lanes = self._open_lanes(closed, goal.kind)
        weights = self._metres[open_lanes] * self._slowness(closed, speed)[open_lanes]
        weights += (self._seconds + self._waits)[open_lanes] * speed
        rows = np.concatenate([self._ends[open_lanes], np.full(len(joined_places), size)])
        columns = np.concatenate([self._starts[open_lanes], joined_places])
        backwards = csr_array((np.concatenate([weights, costs[order]]), (rows, columns)), (size + 1, size + 1))
        distances, following = dijkstra(backwards, indices=size, return_predecessors=True)
        stands = dict(zip(joined_places.tolist(), goal.stands_seen[order].tolist(), strict=True))
        return _Field(distances[:size], following[:size], stands)

    def _open_lanes(self, closed: Closed, kind: RobotKind) -> NDArray[np.bool_]:
        is_open = np.ones(len(self._starts), dtype=bool)
        for name in (*closed.doors, *closed.lifts):
            is_open[self._lanes_of.get(name, [])] = False
        is_open[self._closed_by(closed.forbidden)] = False
        for level, disc in closed.standing:
            near_lanes = self._near_lanes(level, disc, kind)
            starts, ends = self._points[self._starts[near_lanes]], self._points[self._ends[near_lanes]]
            is_open[near_lanes[_reach(disc, starts, ends, kind.radius)]] = False
        return is_open

    def _slowness(self, closed: Closed, speed: float) -> NDArray[np.float64]:
        """How many times longer each lane takes because of its speed limit, and of slow zones."""
        slowness: NDArray[np.float64] = np.maximum(speed / self._speed_limits, 1.0)
        for area, limit in closed.slow:
            lanes = self._slow_lanes_in(area)
            slowness[lanes] = np.maximum(slowness[lanes], speed / limit)
        return slowness

    def _closed_by(self, zones: tuple[Solid, ...]) -> list[int]:
        """The lanes that no-go zones close."""

        def find() -> list[int]:
            return [self._lane_numbers[lane] for lanes in self._obstructions.into_zones(zones) for lane in lanes]

        return recall(self._closed_lanes, zones, find, MOST_FIELDS)

    def _slow_lanes_in(self, area: Solid) -> list[int]:
        """The lanes of which a half or more is in a slow zone."""
        return recall(self._slow_lanes, area, lambda: self._lanes_in(area), MOST_FIELDS)

    def _lanes_in(self, area: Solid) -> list[int]:
        middles = (self._points[self._starts] + self._points[self._ends]) / 2
        levels = np.array([place.level for place in self._roadmap.roadmap.places])[self._starts]
        is_in_area = (abs(levels - area.z) < SAME_FLOOR) & (distances_from(area, middles) < 0)
        numbers: list[int] = np.flatnonzero(is_in_area).tolist()
        return numbers

    def _near_lanes(self, level: float, disc: Disc, kind: RobotKind) -> NDArray[np.int64]:
        layer, reach = self._roadmap.layer(round(level, 1), kind), disc.radius + kind.radius + self._roadmap.widest
        near_places = layer.numbers[layer.tree.query_ball_point((disc.x, disc.y), reach)] if len(layer.numbers) else ()
        lanes = [self._lane_numbers[int(start), end] for start in near_places for end in self._roadmap.graph.successors[start]]
        both_ways = {*lanes, *(self._lane_numbers.get((int(self._ends[lane]), int(self._starts[lane])), lane) for lane in lanes)}
        return np.array(sorted(both_ways), dtype=int)

    def _are_closed(
        self, level: float, starts: Points, ends: Points, closed: Closed, radius: float, *, around: Point | None = None
    ) -> NDArray[np.bool_]:
        """Whether each of the lines leads through a door that is closed, or past what stands on the floor too near. `around`: a robot is at
        this point, so what it touches there is not in its way."""
        closed_lines = np.zeros(len(starts), dtype=bool)
        if not len(starts):
            return closed_lines
        (left, bottom), (right, top) = np.minimum(starts, ends).min(axis=0), np.maximum(starts, ends).max(axis=0)
        for door in (*(self.doors[name] for name in closed.doors), *closed.forbidden):
            reach = door.extent + radius + MARGIN
            is_near = left - reach <= door.x <= right + reach and bottom - reach <= door.y <= top + reach
            if is_near and abs(door.z - level) < SAME_FLOOR and (around is None or door.distance(*around) >= radius):
                closed_lines |= _touched(door, starts, ends, radius)
        for disc_level, disc in closed.standing:
            if abs(disc_level - level) < SAME_FLOOR and (around is None or disc.distance(around) >= radius):
                closed_lines |= _reach(disc, starts, ends, radius)
        return closed_lines


def in_sight(space: FreeSpace, radius: float, starts: Points, ends: Points) -> NDArray[np.bool_]:
    """Whether a robot can drive in a straight line from each of the starts to each of the ends. One of them may be too near to something:
    then the robot does not come nearer to it."""
    if not len(starts):
        return np.zeros(0, dtype=bool)
    need = np.minimum(radius + MARGIN, np.minimum(space.clearances(starts), space.clearances(ends)))
    return np.asarray(least_room(space.clearances, starts, ends) >= need - SLACK)


def _touched(door: Solid, starts: Points, ends: Points, radius: float) -> NDArray[np.bool_]:
    """Whether a robot touches the door on each of the lines."""

    def room(points: Points) -> Points:
        return distances_from(door, points)

    nearest = np.minimum(np.minimum(room(starts), room(ends)), least_room(room, starts, ends))
    return np.asarray(nearest < radius + MARGIN - 1.2 * SLACK)


def _reach(disc: Disc, starts: Points, ends: Points, radius: float) -> NDArray[np.bool_]:
    """Whether a robot comes too near to the disc on each of the lines."""
    x, y, lines = np.array(disc.x), np.array(disc.y), zip(starts.tolist(), ends.tolist(), strict=True)
    nearest = np.array([distances_from_segment(x, y, (a, b), (c, d)) for (a, b), (c, d) in lines], dtype=float)
    return np.asarray(nearest < disc.radius + radius + MARGIN - SLACK)
