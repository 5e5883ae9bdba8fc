"""Halls with tables and many robots, most of which stand at tables, on virtual time: what becomes of the trips of the others."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from random import Random

from somrs.kernel.component import Input, Received
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.traffic import Berth, TripBegun, TripEnded
from somrs.runtime.virtual_time import Work, World
from somrs.space.solids import Point
from somrs.traffic.berths import SPEED
from somrs.traffic.component import SCHEMA, Traffic
from somrs.traffic.layout import MARGIN, OpenBuilding, lay_out
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import NumberedRoadmap, Roadmap, RobotKind
from somrs.traffic.state import PlanTraffic
from tests.support.simulator_room import box
from verification.traffic_runs.vehicle import Robot, Vehicle

RADIUS = 0.25
"""Of the robots, in metres."""
TABLE = (1.6, 0.8)
"""Width and depth, in metres."""
PLANNING = 0.1
"""How long a plan takes, in seconds of virtual time."""
TRAFFIC = "traffic"


@dataclass(frozen=True, slots=True, kw_only=True)
class Hall:
    """A square hall of this side with tables this far apart, in metres. `has_wall`: a wall with one door divides it in two."""

    side: float
    aisle: float
    has_wall: bool = False

    @property
    def tables(self) -> list[Point]:
        count = int(self.side // self.aisle)
        middles = [(number + 0.5) * self.side / count for number in range(count)]
        is_near_wall = {x: self.has_wall and abs(x - self.side / 2) < 1.5 for x in middles}
        return [(x, y) for x in middles for y in middles if not is_near_wall[x]]

    @property
    def map(self) -> Map:
        side, half = self.side, self.side / 2
        furniture = [box(f"Table{number}", "Support", (x, y, 0), (*TABLE, 0.74)) for number, (x, y) in enumerate(self.tables)]
        walls = [*self._walls()] if self.has_wall else []
        return Map([box("Floor", "Floor", (half, half, -0.1), (side, side, 0.1)), *furniture, *walls])

    def _walls(self) -> Iterator[Object]:
        half, length = self.side / 2, self.side / 2 - 0.8
        yield box("Wall0", "Wall", (half, length / 2, 0), (0.2, length, 2.5))
        yield box("Wall1", "Wall", (half, self.side - length / 2, 0), (0.2, length, 2.5))


@dataclass(frozen=True, slots=True, kw_only=True)
class Journey:
    """A trip as it was: how long it took, and how long the shortest way takes for a robot that is alone, in seconds."""

    robot: str
    seconds: float
    alone: float


@lru_cache
def _laid_out(hall: Hall) -> tuple[OpenBuilding, Roadmap]:
    building = OpenBuilding(hall.map, upper(), [0.0])
    return building, lay_out(building, [RobotKind(RADIUS)])


class Crowd:
    """Robots in a hall. The first `travellers` of them go to `trips` tables each, and work there for `work` seconds; the others stand at
    tables. `busy_tables`: all are at so many of the tables, at any points around them; None: at eight points of each table."""

    def __init__(
        self, hall: Hall, *, robots: int, travellers: int, trips: int, work: float, seed: int, busy_tables: int | None = None
    ) -> None:
        self._dice = Random(seed)
        building, roadmap = _laid_out(hall)
        self._space, self._roadmap = building.spaces[0.0], NumberedRoadmap(roadmap)
        self._planner = TrafficPlanner(roadmap, Random())
        self._lengths = {(lane.start, lane.end): lane.seconds for lane in roadmap.lanes}
        self._points = {place.name: (place.x, place.y) for place in roadmap.places}
        self.world = World(watch=self._watch)
        self.journeys: list[Journey] = []
        self._begun: dict[str, tuple[float, float]] = {}
        """By trip: when it began, and how long it takes alone."""
        stands = self._stands(hall) if busy_tables is None else [*self._stands_around(self._dice.sample(hall.tables, busy_tables))]
        self._dice.shuffle(stands)
        parked = self._apart(stands, robots)
        self.robots = [self._robot(number, parked[number], stands, trips * (number < travellers)) for number in range(robots)]
        self._work = work

    def run(self, longest: float) -> list[Journey]:
        """Let all robots travel, for so many seconds at the longest. Returns how the trips were that have ended."""
        world = self.world
        world.add(TRAFFIC, Traffic(TRAFFIC, self._roadmap.roadmap), self._plan, journaled=SCHEMA)
        for robot in self.robots:
            world.add(robot.name, Vehicle(robot, TRAFFIC, self._seconds, self._work))
        world.run(longest, lambda: not any(robot.trips for robot in self.robots))
        return self.journeys

    def _stands(self, hall: Hall) -> list[Point]:
        """Points at which a robot works at a table."""
        width, depth = TABLE[0] / 2 + RADIUS + MARGIN, TABLE[1] / 2 + RADIUS + MARGIN
        sides = [(along * width / 2, depth * side) for side in (-1, 1) for along in (-1, 0, 1)] + [(-width, 0.0), (width, 0.0)]
        return [(x + dx, y + dy) for x, y in hall.tables for dx, dy in sides]

    def _stands_around(self, tables: list[Point]) -> Iterator[Point]:
        """Points at which a robot works at a table, anywhere around it."""
        width, depth = TABLE[0] / 2 + RADIUS + MARGIN, TABLE[1] / 2 + RADIUS + MARGIN
        for (x, y), _ in product(tables, range(40)):
            along, side = self._dice.uniform(-1, 1), self._dice.choice((-1, 1))
            dx, dy = (along * width, side * depth) if self._dice.random() < 0.5 else (side * width, along * depth)
            yield x + dx, y + dy

    def _apart(self, stands: list[Point], count: int) -> list[Point]:
        """So many of the stands, at which robots do not touch each other."""
        chosen: list[Point] = []
        for stand in stands:
            if len(chosen) < count and all(math.dist(stand, point) > 2 * RADIUS + 0.1 for point in chosen):
                chosen.append(stand)
        return chosen

    def _robot(self, number: int, stand: Point, stands: list[Point], trips: int) -> Robot:
        name = f"Robot{number:03}"
        points = [stand, *self._dice.sample(stands, trips)]
        berths = [self._berth(f"{name}/{count}", point) for count, point in enumerate(points)]
        return Robot(name=name, place=berths[0].name, trips=[b.name for b in berths[1:]], berths={b.name: b for b in berths})

    def _berth(self, name: str, point: Point) -> Berth:
        self._points[name] = point
        places = [self._roadmap.roadmap.places[number] for number in self._roadmap.near(point, 0.0)]
        near = sorted(places, key=lambda place: math.dist((place.x, place.y), point))
        visible_places = [
            place.name
            for place in near
            if math.dist((place.x, place.y), point) < self._roadmap.widest and self._space.is_clear((place.x, place.y), point, RADIUS)
        ]
        return Berth(name=name, x=point[0], y=point[1], radius=RADIUS, places=tuple(visible_places))

    def _seconds(self, start: str, end: str) -> float:
        return self._lengths.get((start, end)) or max(math.dist(self._points[start], self._points[end]) / SPEED, 0.1)

    def _plan(self, task: object) -> Work:
        assert isinstance(task, PlanTraffic)
        yield PLANNING, self._planner.plan(task)

    def _watch(self, address: str, event: Input) -> None:
        match event:
            case Received(Message(body=TripBegun(trip=trip, length=length))):
                self._begun[trip] = self.world.now, length
            case Received(Message(body=TripEnded(trip=trip))):
                began, alone = self._begun.pop(trip)
                self.journeys.append(Journey(robot=address, seconds=self.world.now - began, alone=alone))
