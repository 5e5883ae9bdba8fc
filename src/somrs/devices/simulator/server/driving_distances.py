"""Driving distances of a simulated robot, for quotes: from its position through a sequence of stops, in a promised situation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from somrs.devices.simulator.link.lines import Legs, Stops
from somrs.devices.simulator.motion.driving import MARGIN
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.server.simulation import Simulation
from somrs.entish import Attribute, Comparison, Name, Number, Relation, Truth
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.errors import FormulaError, UsageError
from somrs.space.clearance import Disc
from somrs.space.navigation import Navigator, Pose
from somrs.space.solids import CARRYING, Point, Role, Solid, path_length

ELEVATION = 0.8
"""Height at which the arm reaches a stop that is a point, m."""
BELOW, ABOVE = 0.5, 2.2
"""What stands lower or higher than this, from the robot's floor, is on another storey, m."""
SAMPLING = 0.1
"""Distance between the points of a path at which doors are looked for, m."""


@dataclass(slots=True)
class _Promised:
    """The promised situation: doors that will be open (True) or shut; what things and robots will be at; their known positions."""

    doors: dict[str, bool] = field(default_factory=dict)
    carriers: dict[str, str] = field(default_factory=dict)
    points: dict[str, Point] = field(default_factory=dict)

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
                case Comparison(Attribute(Name(name), "PositionX" | "PositionY" as path), "=", Number(value)) if name in solids:
                    positions.setdefault(name, {})[path] = value
                case Relation(_, (Name(name), Name(carrier), *_)) if carrier in solids and _is_movable(solids.get(name)):
                    promised.carriers[name] = carrier
        promised.points = {name: (at["PositionX"], at["PositionY"]) for name, at in positions.items() if len(at) == 2}
        return promised

    def stop(self, stop: str | Point) -> str | Point:
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
    unusable = simulation.out_of_order
    promised_doors = {solid.name: promised.doors.get(solid.name, solid.open) for solid in solids.values() if solid.role is Role.DOOR}
    doors = {name: is_open and name not in unusable for name, is_open in promised_doors.items()}
    planner = _LegPlanner(simulation, simulation.robots[robot], promised)
    last = solids.get(stops[-1]) if stops and isinstance(stops[-1], str) else None
    carries = last is None or last.role in CARRYING
    paths = planner.paths(stops, doors)
    if None not in paths or all(doors.values()):
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


def _out_of_order(planner: _LegPlanner, stops: Stops, doors: Iterable[str], unusable: frozenset[str]) -> tuple[str, ...]:
    """The doors that are out of order on the way that there would be with all doors open."""
    if not unusable:
        return ()
    paths = planner.paths(stops, dict.fromkeys(doors, True))
    return tuple(door for door in sorted(unusable) if None not in paths and planner.passes(door, paths))


def _needed(planner: _LegPlanner, stops: Stops, doors: Mapping[str, bool], paths: list[list[Point] | None]) -> tuple[str, ...]:
    """The open doors on the paths without which there is no path."""
    passed = [door for door, is_open in doors.items() if is_open and planner.passes(door, paths)]
    if None in paths or (len(passed) > 1 and None not in planner.paths(stops, {**doors, **dict.fromkeys(passed, False)})):
        return ()
    return tuple(door for door in passed if None in planner.paths(stops, {**doors, door: False}))


def _lengths(paths: list[list[Point] | None]) -> tuple[float | None, ...]:
    return tuple(path_length(path) if path is not None else None for path in paths)


class _LegPlanner:
    """Plans the legs of one robot in a promised situation."""

    def __init__(self, simulation: Simulation, robot: Robot, promised: _Promised) -> None:
        self._simulation, self._robot, self._promised = simulation, robot, promised
        broken = [(other_robot.pose(), other_robot.size.radius) for other_robot in robot.other_robots() if not other_robot.mobile]
        self._discs = [Disc(x, y, radius) for (x, y, _), radius in broken]
        self._radius = robot.size.radius + MARGIN

    def paths(self, stops: Stops, doors: Mapping[str, bool]) -> list[list[Point] | None]:
        """The path of each leg with the doors in these states; None from the first leg without a path on."""
        navigator = self._simulation.navigator_of(self._robot, doors)
        position: Point | None = self._start()
        paths: list[list[Point] | None] = []
        for stop in stops:
            stand = self._stand(navigator, position, self._promised.stop(stop)) if position is not None else None
            path = navigator.path(position, stand, self._radius, self._discs) if position is not None and stand is not None else None
            paths.append(path)
            position = stand if path is not None else None
        return paths

    def passes(self, name: str, paths: list[list[Point] | None]) -> bool:
        """Whether the robot touches the place of the door on one of the paths."""
        door = self._simulation.scene.world.solids[name]
        return any(door.distance(*point) < self._radius for path in paths if path is not None for point in _points_on(path))

    def _start(self) -> Point:
        place = self._promised.stop(self._robot.name)
        if not isinstance(place, str):
            return place
        return self._robot.pose()[:2] if place == self._robot.name else self._simulation.scene.pose(place)[:2]

    def _stand(self, navigator: Navigator, position: Point, stop: str | Point) -> Point | None:
        """The position from which the robot would reach the object or point; None if there is none."""
        radius, reach, discs = self._radius, (self._robot.size.nearest, self._robot.size.farthest), self._discs
        poses: list[Pose]
        if not isinstance(stop, str):
            if _is_reachable(position, stop, reach):
                return position
            return _first(navigator.approach(position, stop, radius, reach, discs, ELEVATION, limit=1))
        solid = self._simulation.scene.world.solids.get(stop)
        if solid is None:
            raise UsageError(f"{stop} is not in the simulated world")
        if not self._is_on_storey(stop, solid):
            return None
        if solid.role is Role.FLOOR and solid.distance(*position) < 0:
            return position
        if solid.role in (Role.THING, Role.MARK, Role.ROBOT, Role.FLOOR):
            object_state = self._simulation.observe(stop)
            if object_state.container is not None:
                return self._stand(navigator, position, object_state.container)
            poses = navigator.approach(position, (object_state.x, object_state.y), radius, reach, discs, object_state.z, limit=1)
        else:
            poses = navigator.approach_support(position, solid, radius, reach, discs, limit=1)
        return _first(poses)

    def _is_on_storey(self, stop: str, solid: Solid) -> bool:
        """Whether the object is on the storey of the robot: a robot that drove underneath would never reach it."""
        base = self._simulation.observe(stop).z if _is_movable(solid) else solid.z
        height = solid.top if solid.role is Role.FLOOR else base
        return -BELOW < height - self._robot.solid.z < ABOVE


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
