"""The traffic of the simulated world: the component, its roadmap made from the map, and the simulated robots that take part."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from itertools import count
from random import Random

import numpy as np

from somrs.devices.simulator.motion.driving import MARGIN
from somrs.devices.simulator.motion.road_user import RoadUser
from somrs.kernel.component import Answered, Ask, Input, Received, Send, SetTimer, TimerFired
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.traffic import ClosedLane, ClosedPassage, CloseWays, HoldTraffic
from somrs.space.clearance import Disc
from somrs.space.navigation import SLACK, Navigator
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Point, Role, Solid
from somrs.traffic.component import Traffic
from somrs.traffic.layout import SAME_SIZE, SAMPLES
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.planning.graph import FAR
from somrs.traffic.roadmap import Lane, NumberedRoadmap, Place, Roadmap
from somrs.traffic.state import PlanTraffic

ADDRESS = "traffic"
CLEAR_OF_LIFT = 5
"""How many places away from a lift a robot ends the trip that takes it to another floor."""
NEAREST = 20
"""How many places near a goal on another floor are tried."""
RENEWAL = 3.0
"""The time after which robots renew their leases, in simulated seconds."""


class TrafficOffice:
    """Traffic on a roadmap, on the simulated clock."""

    def __init__(self, roadmap: Roadmap) -> None:
        self.roadmap = NumberedRoadmap(roadmap)
        self.component = Traffic(ADDRESS, roadmap)
        self._planner = TrafficPlanner(roadmap, Random())
        self._users: dict[str, RoadUser] = {}
        self._timers: dict[Hashable, float] = {}
        self._problems: dict[Hashable, PlanTraffic] = {}
        """The plans that are asked for. They are made in the next period."""
        self._ids = count()
        self._now = 0.0
        self._renewed_at = 0.0
        self._closed = CloseWays()
        self._hold_count = 0
        """How often traffic was held or let go on."""
        self._ends = self._find_ends()

    @property
    def is_planning(self) -> bool:
        """Whether a plan is to be made."""
        return bool(self._problems)

    def serves(self, radius: float, level: float) -> bool:
        """Whether the roadmap is for robots of this radius, on the floor of this height."""
        radius_of_places = self.roadmap.radius_for(radius)
        return level in self._ends and radius_of_places / SAME_SIZE <= radius <= radius_of_places

    def join(self, user: RoadUser) -> None:
        """Deliver the messages to a robot."""
        self._users[user.robot] = user

    def leave(self, robot: str) -> None:
        self._users.pop(robot, None)

    def tell(self, robot: str, body: Body) -> Body | None:
        """Send a message of a robot. Returns the answer."""
        id = f"{robot}/m{next(self._ids)}"
        header = Header(sender=robot, recipient=ADDRESS, message_id=id, reply_to=robot)
        return self._handle(Received(Message(header=header, body=body)), id)

    def occupant(self, robot: str) -> str | None:
        """The robot that works where the trip of this one leads; None if there is none."""
        return self.component.occupant(robot)

    def is_awaited(self, robot: str) -> bool:
        """Whether others wait for places that this robot holds."""
        return self.component.is_awaited(robot)

    @property
    def levels(self) -> Collection[float]:
        """The heights of the floors."""
        return self._ends.keys()

    def landing(self, robot: str, level: float, goal: Point) -> str | None:
        """A place on the floor of a height, clear of the lift, to which the robot comes on its way to a point there; None if no way leads
        there."""
        graph, places, held = self.component.graph, self.roadmap.roadmap.places, self.component.place(robot)
        if held is None:
            return None
        radius = self.roadmap.radius_for(self._users[robot].radius)
        on_level = (
            number
            for number, place in enumerate(places)
            if place.radius == radius and abs(place.level - level) < SAME_FLOOR and place.zone is None
        )
        for number in sorted(on_level, key=lambda number: math.dist((places[number].x, places[number].y), goal))[:NEAREST]:
            distances = graph.distances(number)
            if distances[held] == FAR:
                continue
            here, steps = held, 0
            while here != number and steps < CLEAR_OF_LIFT:
                here = min(graph.options(here, robot), key=lambda end: graph.length(here, end) + distances[end])
                steps += here < len(places) and abs(places[here].level - level) < SAME_FLOOR and places[here].zone is None
            return places[here].name
        return None

    def advance(self, now: float, silent: Callable[[str], bool]) -> None:
        """Let time pass: timers fire, plans come in, and leases are renewed, but not by robots that are `silent`."""
        self._now = now
        if now >= self._renewed_at + RENEWAL:
            self._renewed_at = now
            for name, user in self._users.items():
                if not silent(name):
                    user.report()
        for question, problem in [*self._problems.items()]:
            del self._problems[question]
            self._handle(Answered(question, self._planner.plan(problem)))
        for timer, due_at in [*self._timers.items()]:
            if due_at <= now:
                self._timers.pop(timer, None)
                self._handle(TimerFired(timer))

    def _handle(self, event: Input, id: str = "") -> Body | None:
        """Carry out the effects of an input. Returns the answer to the message with this id, if there is one."""
        answer: Body | None = None
        for effect in self.component.handle(event, self._now):
            match effect:
                case Send(message) if id and message.header.relates_to == id:
                    answer = message.body
                case Send(message) if message.header.recipient in self._users:
                    self._users[message.header.recipient].receive(message.body)
                case SetTimer(timer, None):
                    self._timers.pop(timer, None)
                case SetTimer(timer, float() as due_at):
                    self._timers[timer] = due_at
                case Ask(question=question, task=PlanTraffic() as problem):
                    self._problems[question] = problem
        return answer

    @property
    def is_held(self) -> bool:
        """Whether nobody is granted a way."""
        return bool(self.component.state.hold)

    def hold(self, reason: str) -> None:
        """Hold traffic for a reason, or without one let it go on."""
        if reason != self.component.state.hold:
            self._hold_count += 1
            self.tell("map", HoldTraffic(reason=reason, number=self._hold_count))

    # What stands in the way

    def close(self, navigators: Mapping[float, Navigator], things: Mapping[float, list[Disc]], out_of_order: Sequence[Solid] = ()) -> None:
        """Close the places and lanes where something stands: by level, what the navigator knows, and things on the floor; and those in
        doors and lifts that are out of order."""
        places = self.roadmap.roadmap.places
        closed_places: list[str] = []
        closed_lanes: list[ClosedLane] = []
        for level in self._ends.keys() & navigators.keys():  # nobody drives on other levels now
            numbers, points, lanes = self._ends[level]
            need = np.array([self._need(places[number]) for number in numbers])
            navigator, discs = navigators[level], things[level]
            blocked = _room(navigator, discs, points) < need
            closed_places += (places[number].name for number in numbers[blocked])
            if not len(lanes):
                continue
            starts, ends = points[lanes[:, 0]], points[lanes[:, 1]]
            least = np.full(len(lanes), np.inf)
            for share in np.linspace(0, 1, SAMPLES + 1)[1:-1]:
                least = np.minimum(least, _room(navigator, discs, starts * (1 - share) + ends * share))
            shut = lanes[(least < need[lanes[:, 0]]) & ~blocked[lanes[:, 0]] & ~blocked[lanes[:, 1]]]
            closed_lanes += (ClosedLane(start=places[numbers[a]].name, end=places[numbers[b]].name) for a, b in shut)
        passages = tuple(self._closed_passage(passage) for passage in out_of_order)
        closing = CloseWays(places=tuple(closed_places), lanes=tuple(closed_lanes), passages=passages)
        if closing != self._closed:
            self._closed = closing
            self.tell("map", closing)

    @staticmethod
    def _need(place: Place) -> float:
        """The clearance that robots need at a place, m."""
        return place.radius + MARGIN - 1.2 * SLACK

    def _closed_passage(self, passage: Solid) -> ClosedPassage:
        """The places and lanes at which a robot would be in a door; or the lanes by which it would come into a lift, or ride in it."""
        if passage.role is Role.LIFT:
            lanes = (
                ClosedLane(start=lane.start, end=lane.end) for lane in self.roadmap.roadmap.lanes if self._leads_into(passage.name, lane)
            )
            return ClosedPassage(name=passage.name, places=(), lanes=tuple(lanes))
        return self._closed_door(passage)

    def _leads_into(self, zone: str, lane: Lane) -> bool:
        places, numbers = self.roadmap.roadmap.places, self.roadmap.numbers
        start, end = places[numbers[lane.start]], places[numbers[lane.end]]
        return end.zone == zone and (start.zone != zone or start.level != end.level)

    def _closed_door(self, door: Solid) -> ClosedPassage:
        """The places and lanes at which a robot would be in a door."""
        roadmap, graph = self.roadmap.roadmap, self.roadmap.graph
        reach = max(door.width, door.depth) + 2 * self.roadmap.widest
        near = {
            number
            for number, place in enumerate(roadmap.places)
            if abs(place.level - door.z) < SAME_FLOOR and math.dist((place.x, place.y), (door.x, door.y)) < reach
        }
        points = {number: (roadmap.places[number].x, roadmap.places[number].y) for number in near}
        closed = {number for number in near if door.distance(*points[number]) < self._need(roadmap.places[number])}
        lanes = (
            ClosedLane(start=roadmap.places[start].name, end=roadmap.places[end].name)
            for start in near - closed
            for end in graph.successors[start]
            if end in near and end not in closed and _touches(door, points[start], points[end], self._need(roadmap.places[start]))
        )
        return ClosedPassage(name=door.name, places=tuple(roadmap.places[number].name for number in sorted(closed)), lanes=tuple(lanes))

    def _find_ends(self) -> dict[float, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """By level: the numbers of the places, their points, and the lanes by the rows of their ends in these."""
        places, graph = self.roadmap.roadmap.places, self.roadmap.graph
        found = {}
        for level in {place.level for place in places}:
            numbers = np.array([number for number, place in enumerate(places) if place.level == level])
            rows = {int(number): row for row, number in enumerate(numbers)}
            points = np.array([(places[number].x, places[number].y) for number in numbers])
            lanes = np.array([(rows[start], rows[end]) for start in rows for end in graph.successors[start] if end in rows], dtype=int)
            found[level] = numbers, points, lanes.reshape(-1, 2)
        return found


def _touches(door: Solid, start: Point, end: Point, need: float) -> bool:
    """Whether a robot comes into a door on the straight line between two points."""
    shares = (number / SAMPLES for number in range(1, SAMPLES))
    return any(door.distance(start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share) < need for share in shares)


def _room(navigator: Navigator, discs: list[Disc], points: np.ndarray) -> np.ndarray:
    """The distance from each point to the nearest obstacle."""
    room = np.asarray(navigator.clearances(points), dtype=float)
    for disc in discs:
        room = np.minimum(room, np.hypot(points[:, 0] - disc.x, points[:, 1] - disc.y) - disc.radius)
    return room
