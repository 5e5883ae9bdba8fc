"""Plays a scenario on virtual time, and watches that nobody touches anybody, and that everybody arrives."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from random import Random

from somrs.kernel.component import Input, Received
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.traffic import Granted, RequestTrip, TripEnded, TripResult
from somrs.runtime.virtual_time import QUIET, Work, World
from somrs.space.lines import segment_distance
from somrs.traffic.berths import SPEED
from somrs.traffic.component import SCHEMA, Traffic
from somrs.traffic.notices import HoldTraffic
from somrs.traffic.passage_program import PassageProgram
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.planning.graph import Graph
from somrs.traffic.roadmap import NumberedRoadmap
from somrs.traffic.state import PlanTraffic
from verification.traffic_runs.draw import RADIUS
from verification.traffic_runs.hardware import Hardware, Violation
from verification.traffic_runs.scenario import GateIncident, GateTrouble, Incident, Scenario, Trouble
from verification.traffic_runs.vehicle import Robot, Vehicle

TRAFFIC = "traffic"
LONGEST = 3_600.0
"""The time within which all robots have to be at the ends of their trips, in seconds of virtual time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """`violation`: what must not happen, and did, or empty. `seconds`: until the last robot arrived. `results`: how trips ended."""

    seed: int
    violation: str
    seconds: float
    results: Counter[TripResult]


MOST_ROBOTS, MOST_PLACES = 3, 16
"""The sizes up to which all configurations are searched, when a robot is told that there is no room."""


class Play:
    """One run."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._dice = Random(scenario.seed)
        self.world = World(medium=self._medium, watch=self._watch)
        self._graph = NumberedRoadmap(scenario.roadmap)
        self._lengths = {(lane.start, lane.end): lane.seconds for lane in scenario.roadmap.lanes}
        self._planner = TrafficPlanner(scenario.roadmap, Random())
        berths = [berth for own in scenario.berths for berth in own.values()]
        self._points = {place.name: (place.x, place.y) for place in scenario.roadmap.places}
        self._points |= {berth.name: (berth.x, berth.y) for berth in berths}
        self._levels = {place.name: place.level for place in scenario.roadmap.places}
        self._levels |= {berth.name: self._levels[berth.places[0]] for berth in berths}
        self._has_berths = bool(berths)
        self.robots = [
            Robot(name=f"Robot{number}", place=start, trips=list(trips), berths=own)
            for number, (start, trips, own) in enumerate(zip(scenario.starts, scenario.trips, scenario.berths, strict=True))
        ]
        self._hardware = Hardware(scenario.roadmap, berths, self._dice, self.robots, self.world.notify)
        self._lanes: dict[str, tuple[str, str | None]] = {}
        """By robot: the lane on which it was seen last."""
        self._program_count = 0
        self._hold = ""
        """Why traffic is held; empty if it is not."""
        self._leaving = False
        """Whether the granted way of a robot ends in a zone, which it has to leave when traffic is held."""
        self._grants: dict[tuple[str, int], Granted] = {}
        """By robot and fence: the last grant."""
        self._worker = Robot(name="Worker", place=scenario.worker, trips=[], berths={}) if scenario.worker is not None else None

    def run(self) -> Outcome:
        violation = ""
        started_at = self.world.now
        try:
            self._run()
        except Violation as error:
            violation = str(error)
        endings = [ending for robot in self.robots for ending in robot.endings]
        return Outcome(
            seed=self.scenario.seed,
            violation=violation,
            seconds=self.world.now - started_at,
            results=Counter(ending.result for ending in endings),
        )

    def _run(self) -> None:
        world = self.world
        self._apart()
        world.add(TRAFFIC, Traffic(TRAFFIC, self.scenario.roadmap), self._plan, journaled=SCHEMA)
        self._set_hold("robots enter")  # nobody drives while there may be robots that traffic does not know at all
        for gate in self._hardware.gates:
            self._start_gate(gate)
        for number in range(len(self.robots)):
            self._start(number)
        if self._worker is not None:
            world.add(self._worker.name, Vehicle(self._worker, TRAFFIC, partial(self._seconds, 1.0), 0.0, works=True))
        world.run(LONGEST, self._all_take_part)
        self._set_hold("")
        started_at = world.now
        for at, event in sorted(self._events(), key=lambda moment: moment[0]):
            world.run(started_at + at - world.now)
            event()
        if not world.run(LONGEST, lambda: not any(robot.trips for robot in self.robots)):
            places = ", ".join(f"{robot.name} at {robot.place} to {robot.trips[0]}" for robot in self.robots if robot.trips)
            raise Violation(f"not arrived: {places}")

    def _all_take_part(self) -> bool:
        traffic = self.world.components[TRAFFIC]
        return isinstance(traffic, Traffic) and all(robot.name in traffic.state.robots for robot in self.robots)

    def _events(self) -> Iterator[tuple[float, Callable[[], None]]]:
        """What happens to robots and traffic, and when."""
        for incident in self.scenario.incidents:
            yield incident.at, partial(self._meddle, incident, mended=False)
            yield incident.at + incident.seconds, partial(self._meddle, incident, mended=True)
        for hold in self.scenario.holds:
            yield hold.at, partial(self._set_hold, "fire alarm")
            yield hold.at + hold.seconds, partial(self._set_hold, "")
        for gate_incident in self.scenario.gate_incidents:
            yield gate_incident.at, partial(self._meddle_with_gate, gate_incident, mended=False)
            yield gate_incident.at + gate_incident.seconds, partial(self._meddle_with_gate, gate_incident, mended=True)

    def _set_hold(self, reason: str) -> None:
        self._hold = reason
        self._notify_of_hold()

    def _notify_of_hold(self) -> None:
        """As the program of traffic does, which ends with it, and says so again after its start."""
        if self.world.alive(TRAFFIC):
            self.world.notify(TRAFFIC, HoldTraffic(reason=self._hold))

    def _start_gate(self, name: str) -> None:
        self._program_count += 1
        program = PassageProgram(name, name, TRAFFIC, str(self._program_count))
        self.world.add(name, program, partial(self._hardware.work, name))
        self.world.notify(name, self._hardware.gates[name].status)

    def _meddle_with_gate(self, incident: GateIncident, *, mended: bool) -> None:
        world, gate = self.world, self._hardware.gates[incident.gate]
        match incident.trouble:
            case GateTrouble.DIES if not mended:
                world.remove(gate.name)
            case GateTrouble.DIES if not world.alive(gate.name):
                self._start_gate(gate.name)
            case GateTrouble.FAULT:
                gate.works = mended
            case GateTrouble.SHARED:
                gate.is_shared = not mended
        if world.alive(gate.name):
            world.notify(gate.name, gate.status)

    def _start(self, number: int) -> None:
        scenario, robot = self.scenario, self.robots[number]
        seconds = partial(self._seconds, scenario.slowness[number])
        self.world.add(robot.name, Vehicle(robot, TRAFFIC, seconds, scenario.work[number]))

    def _seconds(self, slowness: float, start: str, end: str) -> float:
        if self._levels[start] != self._levels[end] and self._hardware.gates:
            return 0.01  # the lift has taken the time
        length = self._lengths.get((start, end)) or math.dist(self._points[start], self._points[end]) / SPEED
        return length * slowness * self._dice.uniform(0.8, 1.6)

    def _meddle(self, incident: Incident, *, mended: bool) -> None:
        world, robot = self.world, self.robots[incident.robot]
        match incident.trouble, mended:
            case Trouble.BREAKS, _:
                robot.broken = not mended
                if mended and world.alive(robot.name):
                    world.remove(robot.name)  # it is started anew after the repair
                    self._start(incident.robot)
            case Trouble.DIES, False if world.alive(robot.name):
                world.remove(robot.name)
            case Trouble.DIES, True if not world.alive(robot.name):
                self._start(incident.robot)
            case Trouble.TRAFFIC_DIES, False if world.alive(TRAFFIC):
                world.kill(TRAFFIC)
            case Trouble.TRAFFIC_DIES, True if not world.alive(TRAFFIC):
                world.revive(TRAFFIC)
                self._notify_of_hold()

    def _plan(self, task: object) -> Work:
        assert isinstance(task, PlanTraffic)
        yield self._dice.uniform(0.0, 0.3), QUIET
        yield 0.0, self._planner.plan(task)

    def _medium(self, message: Message) -> list[float]:
        """Messages take a while, and some arrive twice, or only when they are sent again."""
        if isinstance(message.body, Granted):
            self._note_grant(message.body)
        drawn = self._dice.random()
        if drawn < 0.02:
            return []
        delay = self._dice.choice((0.001, 0.01, 0.05))
        return [delay, delay + self._dice.uniform(0.1, 3.0)] if drawn < 0.04 else [delay]

    def _note_grant(self, granted: Granted) -> None:
        """Raise Violation if a robot is granted more than before while traffic is held, and none has to leave a zone."""
        traffic, entry = self.world.components.get(TRAFFIC), (granted.robot, granted.fence)
        earlier = self._grants.get(entry, granted)
        if granted.number < earlier.number:
            return  # it is sent again
        if isinstance(traffic, Traffic) and traffic.state.hold and granted.way[-1] not in earlier.way and not self._leaving:
            raise Violation(f"{granted.robot} was granted its way to {granted.way[-1]} while traffic was held")
        self._grants[entry] = granted

    def _watch(self, address: str, event: Input) -> None:
        self._apart()
        self._check_departures()
        if address == TRAFFIC:
            traffic, size = self.world.components[TRAFFIC], self._graph.graph.size
            assert isinstance(traffic, Traffic)
            ends = [held[-1] for held in traffic.state.held.values()]
            self._leaving = any(end < size and self.scenario.roadmap.places[end].zone is not None for end in ends)
        match event:
            case Received(Message(body=TripEnded(result=TripResult.NO_ROOM) as ended)) if len(self.robots) <= MOST_ROBOTS:
                self._no_room(ended)

    def _check_departures(self) -> None:
        for robot in self.robots if self._hardware.gates else ():
            lane = robot.place, robot.towards
            if lane != self._lanes.get(robot.name):
                self._lanes[robot.name] = lane
                if robot.towards is not None:
                    self._hardware.check_departure(robot)

    def _no_room(self, ended: TripEnded) -> None:
        """Raise Violation if the robot could come to its goal, and the others could make room, by a search among all configurations."""
        graph, numbers = self._graph.graph, self._graph.numbers
        if (
            graph.size > MOST_PLACES
            or self._has_berths
            or self._hardware.gates
            or any(robot.towards is not None or robot.broken for robot in self.robots)
        ):
            return
        start = tuple(numbers[robot.place] for robot in self.robots)
        bodies = (message.body for message in self.world.messages)
        destination = next(body.destination for body in bodies if isinstance(body, RequestTrip) and body.trip == ended.trip)
        goals = [numbers[destination] if robot.name == ended.robot else None for robot in self.robots]
        if _can_reach(graph, start, goals):
            raise Violation(f"{ended.robot} was told that there is no room for its way to {destination}, and there is")

    def _apart(self) -> None:
        """Raise Violation if two robots are in one place, or in places that exclude each other, or on lines so near that they may touch."""
        if self._has_berths:
            self._lines_apart()
        occupied: dict[int, Robot] = {}
        for robot in self.robots:
            for name in (robot.place, robot.towards):
                if name not in self._graph.numbers:
                    continue
                place = self._graph.numbers[name]
                for close in (place, *self._graph.graph.exclusions[place]):
                    if (other := occupied.get(close, robot)) is not robot:
                        raise Violation(f"{robot.name} and {other.name} are both at {name}")
            occupied |= {self._graph.numbers[name]: robot for name in (robot.place, robot.towards) if name in self._graph.numbers}

    def _lines_apart(self) -> None:
        lines = [
            (robot.name, self._levels[robot.place], self._points[robot.place], self._points[robot.towards or robot.place])
            for robot in self.robots
        ]
        for (name, level, start, end), (near_name, near_level, near_start, near_end) in combinations(lines, 2):
            if level == near_level and segment_distance(start, end, near_start, near_end) < 2 * RADIUS:
                raise Violation(f"{name} and {near_name} touch each other")


def _can_reach(graph: Graph, start: tuple[int, ...], goals: list[int | None]) -> bool:
    """Whether robots that move one at a time can come to their goals."""
    known, waiting = {start}, [start]
    while waiting:
        here = waiting.pop()
        if all(goal is None or goal == place for goal, place in zip(goals, here, strict=True)):
            return True
        for after in _moves(graph, here):
            if after not in known:
                known.add(after)
                waiting.append(after)
    return False


def _moves(graph: Graph, here: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    for robot, place in enumerate(here):
        others = {other for number, other in enumerate(here) if number != robot}
        for after in graph.successors[place]:
            if others.isdisjoint((after, *graph.exclusions[after])):
                yield (*here[:robot], after, *here[robot + 1 :])
