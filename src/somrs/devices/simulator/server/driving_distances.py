"""Driving distances of a simulated robot, for quotes: from its position through a sequence of stops, in a promised situation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from somrs.devices.simulator.link.lines import Legs, PathStop, Stops
from somrs.devices.simulator.motion.driving import MARGIN
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.server.simulation import Simulation
from somrs.entish import Attribute, Comparison, Name, Number, Relation, Truth
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.errors import FormulaError, UsageError
from somrs.space.clearance import Disc
from somrs.space.navigation import Navigator, Pose
from somrs.space.shafts import SAME_FLOOR, Shaft
from somrs.space.solids import CARRYING, Point, Role, Solid, path_length
from somrs.traffic.layout import ride_seconds

ELEVATION = 0.8
"""Height at which the arm reaches a stop that is a point, m."""
LIFT_WAIT = 10.0
"""The time for which a robot is taken to wait for a lift, s."""
BELOW, ABOVE = 0.5, 2.2
"""What stands lower or higher than this, from the robot's floor, is on another storey, m."""
SAMPLING = 0.1
"""Distance between the points of a path at which doors are looked for, m."""


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
        seen = set[str]()
        while isinstance(stop, str) and stop not in seen and stop in {*self.points, *self.carriers}:
            seen.add(stop)
            stop = self.points[stop] if stop in self.points else self.carriers[stop]
        return stop


def _is_movable(solid: Solid | None) -> bool:
    return solid is not None and solid.role in (Role.THING, Role.ROBOT)


def find_legs(simulation: Simulation, robot: str, stops: Stops, situation: str | None = None) -> Legs:
    """Driving distances in metres to the first stop, from there to the next, and so on; None from the first leg without a path on.

    If shut doors leave no path, the legs are those of a shortest path with the doors on it open, and the doors are named. So are the open
    doors without which there is no path. Other robots count as obstacles only if they cannot move. Raises UsageError for an unknown robot
    or object.
    """
    if robot not in simulation.robots:
        raise UsageError(f"there is no robot {robot}; there are {', '.join(simulation.robots) or 'none'}")
    solids = simulation.scene.world.solids
    promised = _Promised.read(situation, solids)
    unusable = {name for name in simulation.out_of_order if name in solids and solids[name].role is Role.DOOR}
    lift_doors = {door.name for lift in simulation.lifts for landing in lift.shaft.landings for door in landing.doors}
    promised_doors = {
        solid.name: promised.doors.get(solid.name, solid.open)
        for solid in solids.values()
        if solid.role is Role.DOOR and solid.name not in lift_doors
    }
    doors = {name: is_open and name not in unusable for name, is_open in promised_doors.items()}
    planner = _LegPlanner(simulation, simulation.robots[robot], promised)
    last = solids.get(stops[-1]) if stops and isinstance(stops[-1], str) else None
    carries = last is None or last.role in CARRYING
    paths = planner.paths(stops, doors)
    if None not in paths or (all(doors.values()) and not planner.unusable_lifts):
        return Legs(_lengths(paths), (), _needed(planner, stops, doors, paths), carries)
    open_paths = planner.paths(stops, {name: name not in unusable for name in doors})
    if None in open_paths:
        return Legs(_lengths(paths), carries=carries, out_of_order=_out_of_order(planner, stops, doors, unusable))
    shut = [door for door, is_open in doors.items() if not is_open and planner.passes(door, open_paths)]
    for door in [*shut] if len(shut) > 1 else ():  # a longer way may need fewer doors
        fewer = planner.paths(stops, {**doors, **dict.fromkeys(shut, True), door: False})
        if None not in fewer:
            shut.remove(door)
            open_paths = fewer
    needed = _needed(planner, stops, {**doors, **dict.fromkeys(shut, True)}, open_paths)
    return Legs(_lengths(open_paths), tuple(shut), tuple(door for door in needed if door not in shut), carries)


def _out_of_order(planner: _LegPlanner, stops: Stops, doors: Iterable[str], unusable: set[str]) -> tuple[str, ...]:
    """The doors and lifts that are out of order on the way that there would be with all doors open, and with all lifts."""
    if not (unusable or planner.unusable_lifts):
        return ()
    paths = planner.paths(stops, dict.fromkeys(doors, True), with_all_lifts=True)
    if None in paths:
        return ()
    doors_passed = (door for door in sorted(unusable) if planner.passes(door, paths))
    lifts_used = (lift for lift in sorted(planner.unusable_lifts) if planner.rides_in(lift, paths))
    return (*doors_passed, *lifts_used)


def _needed(planner: _LegPlanner, stops: Stops, doors: Mapping[str, bool], paths: list[_Way | None]) -> tuple[str, ...]:
    """The open doors on the paths without which there is no path."""
    passed = [door for door, is_open in doors.items() if is_open and planner.passes(door, paths)]
    if None in paths or (len(passed) > 1 and None not in planner.paths(stops, {**doors, **dict.fromkeys(passed, False)})):
        return ()
    return tuple(door for door in passed if None in planner.paths(stops, {**doors, door: False}))


def _lengths(paths: list[_Way | None]) -> tuple[float | None, ...]:
    return tuple(path.length if path is not None else None for path in paths)


@dataclass(frozen=True, slots=True)
class _Way:
    """The way of a leg: a path on each floor, with its height, and the rides between these."""

    paths: tuple[tuple[float, list[Point]], ...]
    rides: tuple[_Ride, ...]

    @property
    def length(self) -> float:
        """In metres; a ride counts as far as the robot drives in that time."""
        return sum(ride.metres for ride in self.rides) + sum(path_length(path) for _, path in self.paths)

    @property
    def end(self) -> tuple[Point, float]:
        """Where the robot is then, and the height of that floor."""
        level, path = self.paths[-1]
        return path[-1], level


@dataclass(frozen=True, slots=True)
class _Ride:
    """A ride in a lift between two floors. `metres`: how far the robot would drive meanwhile."""

    shaft: Shaft
    level: float
    goal: float
    metres: float

    @property
    def cabin(self) -> Point:
        return self.shaft.cabin.x, self.shaft.cabin.y


class _LegPlanner:
    """Plans the legs of one robot in a promised situation."""

    def __init__(self, simulation: Simulation, robot: Robot, promised: _Promised) -> None:
        self._simulation, self._robot, self._promised = simulation, robot, promised
        self._broken = [other_robot for other_robot in simulation.robots.values() if other_robot is not robot and not other_robot.mobile]
        self._radius = robot.size.radius + MARGIN
        self._shafts = [lift.shaft for lift in simulation.lifts]
        self.unusable_lifts = {lift.name for lift in simulation.lifts if not lift.is_usable}
        self._avoided_lifts = self.unusable_lifts

    def paths(self, stops: Stops, doors: Mapping[str, bool], *, with_all_lifts: bool = False) -> list[_Way | None]:
        """The way of each leg with the doors in these states; None from the first leg without a way on. `with_all_lifts`: as if robots
        could use all of them."""
        self._avoided_lifts = set() if with_all_lifts else self.unusable_lifts
        place: tuple[Point, float] | None = self._start()
        ways: list[_Way | None] = []
        for stop in stops:
            way = self._way(*place, self._promised.stop(stop), doors) if place is not None else None
            ways.append(way)
            place = way.end if way is not None else None
        return ways

    def _way(self, position: Point, level: float, stop: PathStop, doors: Mapping[str, bool]) -> _Way | None:
        """The shortest way to where the robot would reach the stop, by lifts if that is on another floor; None if there is none."""
        goal = self._level_of(stop, level)
        if goal is None:
            return None
        ways = (self._way_by(rides, position, level, stop, doors) for rides in self._rides(level, goal))
        return min((way for way in ways if way is not None), key=lambda way: way.length, default=None)

    def _rides(self, level: float, goal: float) -> list[tuple[_Ride, ...]]:
        """The sequences of as few rides as possible from one floor to another."""
        sequences: list[tuple[_Ride, ...]] = [()]
        visited = {round(level, 1)}
        while sequences:
            if arrived := [rides for rides in sequences if abs((rides[-1].goal if rides else level) - goal) < SAME_FLOOR]:
                return arrived
            sequences = [(*rides, ride) for rides in sequences for ride in self._rides_from(rides[-1].goal if rides else level, visited)]
            visited |= {round(rides[-1].goal, 1) for rides in sequences}
        return []

    def _rides_from(self, level: float, visited: set[float]) -> Iterator[_Ride]:
        for shaft in self._shafts:
            stops_here = shaft.name not in self._avoided_lifts and shaft.landing(level) is not None
            for landing in shaft.landings if stops_here else ():
                if round(landing.level, 1) not in visited:
                    seconds = LIFT_WAIT + ride_seconds(shaft.cabin, level, landing.level)
                    yield _Ride(shaft, level, landing.level, seconds * self._robot.solid.speed)

    def _way_by(self, rides: Sequence[_Ride], position: Point, level: float, stop: PathStop, doors: Mapping[str, bool]) -> _Way | None:
        paths: list[tuple[float, list[Point]]] = []
        for ride in rides:
            path = self._path(position, ride.cabin, level, doors)
            if path is None:
                return None
            paths.append((level, path))
            position, level = ride.cabin, ride.goal
        stand = self._stand(self._simulation.navigator_of(level, doors), position, level, stop)
        path = self._path(position, stand, level, doors) if stand is not None else None
        return _Way((*paths, (level, path)), tuple(rides)) if path is not None else None

    def _path(self, start: Point, end: Point, level: float, doors: Mapping[str, bool]) -> list[Point] | None:
        return self._simulation.navigator_of(level, doors).path(start, end, self._radius, self._discs(level))

    def _discs(self, level: float) -> list[Disc]:
        """The robots on a floor that cannot move."""
        on_floor = (robot for robot in self._broken if abs(robot.level - level) < SAME_FLOOR)
        return [Disc(*robot.pose()[:2], robot.size.radius) for robot in on_floor]

    def passes(self, name: str, paths: list[_Way | None]) -> bool:
        """Whether the robot touches the place of the door on one of the ways."""
        door = self._simulation.scene.world.solids[name]
        on_floor = (path for way in paths if way is not None for level, path in way.paths if abs(door.z - level) < SAME_FLOOR)
        return any(door.distance(*point) < self._radius for path in on_floor for point in _points_on(path))

    def rides_in(self, lift: str, paths: list[_Way | None]) -> bool:
        """Whether one of the ways leads through the lift."""
        return any(ride.shaft.name == lift for way in paths if way is not None for ride in way.rides)

    def _start(self) -> tuple[Point, float]:
        """Where the robot will be, and the height of that floor."""
        place = self._promised.stop(self._robot.name)
        level = self._level_of(place, self._robot.level) if place != self._robot.name else None
        position = self._robot.pose()[:2] if place == self._robot.name else place
        if isinstance(position, str):
            position = self._simulation.scene.pose(position)[:2]
        return (position[0], position[1]), self._robot.level if level is None else level

    def _stand(self, navigator: Navigator, position: Point, level: float, stop: PathStop) -> Point | None:
        """The position on a floor from which the robot would reach the object or point; None if there is none."""
        radius, reach, discs = self._radius, (self._robot.size.nearest, self._robot.size.farthest), self._discs(level)
        poses: list[Pose]
        if not isinstance(stop, str):
            point = stop[0], stop[1]
            if _is_reachable(position, point, reach):
                return position
            return _first(navigator.approach(position, point, radius, reach, discs, ELEVATION, limit=1))
        solid = self._simulation.scene.world.solids.get(stop)
        if solid is None:
            raise UsageError(f"{stop} is not in the simulated world")
        if solid.role is Role.FLOOR and solid.distance(*position) < 0:
            return position
        if solid.role in (Role.THING, Role.MARK, Role.ROBOT, Role.FLOOR):
            object_state = self._simulation.observe(stop)
            if object_state.container is not None:
                return self._stand(navigator, position, level, object_state.container)
            poses = navigator.approach(position, (object_state.x, object_state.y), radius, reach, discs, object_state.z, limit=1)
        else:
            poses = navigator.approach_support(position, solid, radius, reach, discs, limit=1)
        return _first(poses)

    def _level_of(self, stop: PathStop, level: float) -> float | None:
        """The height of the floor on which an object or a point is: the highest one below it. None if the robot cannot reach it from there.

        A point without a height is on the robot's `level`.
        """
        if isinstance(stop, str):
            solid = self._simulation.scene.world.solids.get(stop)
            if solid is None:
                raise UsageError(f"{stop} is not in the simulated world")
            base = self._simulation.observe(stop).z if _is_movable(solid) else solid.z
            height = solid.top if solid.role is Role.FLOOR else base
        elif len(stop) > 2:
            height = stop[2]
        else:
            return level
        landings = (landing.level for shaft in self._shafts for landing in shaft.landings)
        floors = [floor for floor in (self._robot.level, level, *landings) if -BELOW < height - floor < ABOVE]
        return max(floors, default=None)


def _points_on(path: list[Point]) -> Iterator[Point]:
    """Points of a path, close to each other."""
    for (start_x, start_y), (end_x, end_y) in pairwise(path):
        count = max(1, math.ceil(math.dist((start_x, start_y), (end_x, end_y)) / SAMPLING))
        for i in range(count + 1):
            yield start_x + (end_x - start_x) * i / count, start_y + (end_y - start_y) * i / count


def _is_reachable(position: Point, target: Point, reach: tuple[float, float]) -> bool:
    return reach[0] <= math.dist(position, target) <= reach[1]


def _first(poses: list[Pose]) -> Point | None:
    return (poses[0].x, poses[0].y) if poses else None
