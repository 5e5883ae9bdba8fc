"""The lifts and automatic doors of a run: how they truly are, and the work of their programs. A robot in a door that shuts is a
violation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from random import Random

from somrs.protocol.messages.traffic import Berth
from somrs.runtime.virtual_time import QUIET, Work
from somrs.space.doorways import doors_between
from somrs.traffic.berths import Berths
from somrs.traffic.passage_call import PassageCall, PassageStatus
from somrs.traffic.passage_program import Complaint, Release
from somrs.traffic.passages import Passages
from somrs.traffic.roadmap import NumberedRoadmap, Roadmap
from verification.traffic_runs.vehicle import Robot

RIDE = 10.0
"""The time that a cabin takes from one storey to another, in seconds."""


class Violation(Exception):
    """Something happened that must not."""


@dataclass(slots=True, kw_only=True)
class Gate:
    """A lift or a door. `level`: where its cabin stands, None while it moves and for a door."""

    name: str
    is_lift: bool
    level: float | None = None
    is_open: bool = False
    is_shared: bool = False
    works: bool = True

    @property
    def status(self) -> PassageStatus:
        return PassageStatus(level=self.level, working=self.works, shared=self.is_shared)


class Hardware:
    """All gates of a roadmap. `berths`: those of the robots. `robots`: where they truly are. `notify`: passes the status of a gate to its
    program."""

    def __init__(
        self,
        roadmap: Roadmap,
        berths: Iterable[Berth],
        dice: Random,
        robots: Iterable[Robot],
        notify: Callable[[str, PassageStatus], None],
    ) -> None:
        numbered = NumberedRoadmap(roadmap)
        self._numbers, self._passages = numbered.numbers, Passages(Berths(numbered, []))
        self._doors = roadmap.doors
        self._levels = {place.name: place.level for place in roadmap.places}
        self._circles = {place.name: (place.x, place.y, place.radius) for place in roadmap.places}
        for berth in berths:
            self._levels[berth.name] = self._levels[berth.places[0]]
            self._circles[berth.name] = berth.x, berth.y, berth.radius
        self._dice, self._robots, self._notify = dice, robots, notify
        self.gates = {name: Gate(name=name, is_lift=name in roadmap.lifts) for name in self._passages.names}
        for gate in self.gates.values():
            gate.level = 0.0 if gate.is_lift else None

    def _entered(self, robot: Robot) -> Iterator[str]:
        """The gates that have to be open for a robot that has departed."""
        assert robot.towards is not None, "it has departed"
        if robot.place in self._numbers and robot.towards in self._numbers:
            yield from self._passages.entered(self._numbers[robot.place], self._numbers[robot.towards])
        else:
            yield from self._touched(robot).difference(self._touched(robot, stays=True))

    def _touched(self, robot: Robot, *, stays: bool = False) -> set[str]:
        """The doors that a robot touches on the way to a berth or from one, or where it `stays` before."""
        ends = robot.place, robot.place if stays else robot.towards or robot.place
        (x, y, radius), (end_x, end_y, _) = (self._circles[name] for name in ends)
        return {*doors_between(self._doors, self._levels[robot.place], (x, y), (end_x, end_y), radius)}

    def check_departure(self, robot: Robot) -> None:
        """Raise Violation if a robot has departed through something that is not open."""
        assert robot.towards is not None, "it has departed"
        for name in self._entered(robot):
            gate = self.gates[name]
            if not gate.is_open or (gate.is_lift and gate.level != self._levels[robot.towards]):
                raise Violation(f"{robot.name} drives to {robot.towards}, and {name} is not open there")

    def work(self, name: str, task: object) -> Work:
        """What the program of a gate has done by its hardware."""
        assert isinstance(task, PassageCall | Release | Complaint), "programs request nothing else"
        if isinstance(task, Complaint):  # messages of its program before the last start may come late
            yield 0.0, None
            return
        gate = self.gates[name]
        if isinstance(task, Release):
            self._shut(gate)
            yield 0.0, None
            return
        while gate.is_shared:
            yield 1.0, QUIET
        if task.level != gate.level:
            self._shut(gate)
            gate.level = None
            self._notify(name, gate.status)
            yield self._dice.uniform(0.5, 2.0) * RIDE, QUIET
            while not gate.works:
                yield 1.0, QUIET  # the cabin stands still on its way
            gate.level = task.level
            self._notify(name, gate.status)
        if not gate.is_open:
            yield self._dice.uniform(0.5, 3.0), QUIET
            gate.is_open = True
        yield 0.0, None

    def _shut(self, gate: Gate) -> None:
        """Raise Violation if a robot is in the way of the doors."""
        for robot in self._robots if gate.is_open else ():
            end = robot.towards or robot.place
            if robot.place not in self._numbers or end not in self._numbers:
                if gate.name in self._touched(robot):
                    raise Violation(f"{gate.name} shuts while {robot.name} drives through it to a berth, or from one")
                continue
            lane = self._numbers[robot.place], self._numbers[end]
            is_ride = self._levels[robot.place] != self._levels[end]
            if gate.name in self._passages.touched(*lane) or (gate.name == self._passages.lift_of(*lane) and not is_ride):
                raise Violation(f"{gate.name} shuts while {robot.name} is in its doors")
        gate.is_open = False
