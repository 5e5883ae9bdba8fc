"""The traffic of the simulated world: the component, its roadmap made from the map, and the simulated robots that take part."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from itertools import count
from random import Random

import numpy as np
from numpy.typing import NDArray

from somrs.devices.simulator.motion.road_user import Points, RoadUser
from somrs.kernel.component import Answered, Ask, Input, Notified, Received, Send, SetTimer, TimerFired
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, reply
from somrs.protocol.messages.frp import Fault
from somrs.space.clearance import Disc
from somrs.space.free_space import FreeSpace
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Point, Solid
from somrs.traffic.component import Traffic
from somrs.traffic.layout import SAME_SIZE
from somrs.traffic.notices import ClosedLane, CloseWays, HoldTraffic
from somrs.traffic.obstructions import Obstructions
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.planning.graph import FAR
from somrs.traffic.roadmap import RobotKind, least_distance, numbered
from somrs.traffic.state import PlanTraffic
from somrs.traffic.surroundings import GAP

ADDRESS = "traffic"
"""The address of traffic in which only simulated robots take part."""
CLEAR_OF_LIFT = 5
"""How many places away from a lift a robot ends the trip that takes it to another floor."""
RENEWAL = 3.0
"""The time after which robots renew their leases, in simulated seconds."""


Deliver = Callable[[Message], None]
"""Sends a message to its recipient."""

ReceivePassage = Callable[[Body], None]
"""Takes a message to a lift or a door."""


class TrafficOffice:
    """Traffic on a roadmap, on the simulated clock. `deliver`: sends the messages for robots that are not simulated."""

    def __init__(self, component: Traffic, deliver: Deliver) -> None:
        roadmap = component.state.roadmap
        self.roadmap = numbered(roadmap)
        self.component, self._deliver = component, deliver
        self._random = Random()
        self._planner = TrafficPlanner(roadmap, self._random)
        self._users: dict[str, RoadUser] = {}
        self.passages: dict[str, ReceivePassage] = {}
        """The lifts and automatic doors of the simulation, by name: where messages to them go."""
        self._timers: dict[Hashable, float] = {}
        self._problems: dict[Hashable, PlanTraffic] = {}
        """The plans that are asked for. They are made in the next period."""
        self._ids = count()
        self._now = 0.0
        self.renewed_at = 0.0
        self._closed = CloseWays()
        self._obstructions = Obstructions(self.roadmap)

    @property
    def is_planning(self) -> bool:
        """Whether a plan is to be made."""
        return bool(self._problems)

    def serves(self, kind: RobotKind, level: float) -> bool:
        """Whether the roadmap is for robots of this kind, on the floor of this height."""
        served, graphs = self.roadmap.kind_for(kind), self.roadmap.roadmap.graphs
        has_lanes = served.graph == (kind.graph if kind.graph in graphs else None)
        return has_lanes and level in self._obstructions.levels and served.radius / SAME_SIZE <= kind.radius <= served.radius

    def join(self, user: RoadUser) -> None:
        """Deliver the messages to a robot."""
        self._users[user.robot] = user

    def leave(self, robot: str) -> None:
        self._users.pop(robot, None)

    def tell(self, robot: str, body: Body) -> Body | None:
        """Send a message of a robot. Returns the answer."""
        id = f"{robot}/m{self.component.state.edition}.{next(self._ids)}"  # the office of the next roadmap counts from 0, too
        header = Header(sender=robot, recipient=ADDRESS, message_id=id, reply_to=robot)
        return self._handle(Received(Message(header=header, body=body)), id)

    def receive(self, message: Message, now: float) -> None:
        """A message of a robot that is not simulated, or of somebody who wants to see traffic."""
        self._now = now
        if reason := self._why_refused(message):
            self._deliver(reply(message, Fault(code="Sender", text=reason), self.component.state.address))
            return
        self._handle(Received(message))

    def _why_refused(self, message: Message) -> str:
        """Why a message from outside is refused; empty if it is not."""
        robot, passage = getattr(message.body, "robot", None), getattr(message.body, "passage", None)
        if robot in self._users:
            return f"{robot} is a robot of the simulator, which moves it and reports where it is: let your robot have another name"
        if passage in self.passages:
            return f"{passage} is moved by the simulator, which calls it for robots: only a real lift or door has a program of its own"
        names = self._users.keys() | self.passages.keys()
        if (name := next((address for address in (message.header.sender, message.header.reply_to) if address in names), None)) is not None:
            return f"{name} is in the simulator: state the address of your own program in wsa:From, to which traffic sends what is for it"
        return ""

    @property
    def foreign(self) -> list[str]:
        """The robots that take part and are not simulated."""
        return [name for name in self.component.state.robots if name not in self._users]

    @property
    def is_foreign_trip_open(self) -> bool:
        """Whether a robot that is not simulated has a trip."""
        return any(self.component.state.robots[name].trip is not None for name in self.foreign)

    def occupant(self, robot: str) -> str | None:
        """The robot that works where the trip of this one leads; None if there is none."""
        return self.component.occupant(robot)

    def is_awaited(self, robot: str) -> bool:
        """Whether others wait for places that this robot holds."""
        return self.component.is_awaited(robot)

    def driving_times(self, robot: str) -> NDArray[np.float64]:
        """By place: how long the way there takes a robot that takes part, in seconds; infinite where none leads now."""
        held = self.component.place(robot)
        return (
            np.full(len(self.roadmap.names), FAR) if held is None else np.array(self.component.graph(past_fixed=True).distances_from(held))
        )

    def is_blocked(self, points: Points, level: float, radius: float, spacing: float) -> NDArray[np.bool_]:
        """Whether robots that cannot move are too near to points (n, 2) on a floor for a robot of this radius, whose places have this
        spacing, in metres."""
        blocked, state = np.zeros(len(points), dtype=bool), self.component.state
        for name in (name for name, record in state.robots.items() if record.is_fixed):
            for number, position in zip(state.held[name], self.component.positions(name), strict=True):
                is_berth = number >= len(self.roadmap.names)
                least = radius + position.radius + GAP if is_berth else least_distance(spacing, self.roadmap.spacing(number))
                if abs(position.level - level) < SAME_FLOOR:
                    blocked |= np.hypot(points[:, 0] - position.x, points[:, 1] - position.y) < least
        return blocked

    @property
    def levels(self) -> Collection[float]:
        """The heights of the floors."""
        return self._obstructions.levels

    def landing(self, robot: str, level: float, goal: Point) -> str | None:
        """A place on the floor of a height, clear of the lift, to which the robot comes on its way to a point there; None if no way leads
        there."""
        graph, places, held = self.component.graph(), self.roadmap.roadmap.places, self.component.place(robot)
        if held is None:
            return None
        times, layer = graph.distances_from(held), self.roadmap.layer(level, self._users[robot].kind)
        numbers = [number for number in layer.numbers.tolist() if places[number].zone is None and times[number] < FAR]
        if not numbers:
            return None
        nearest = min(numbers, key=lambda number: math.dist((places[number].x, places[number].y), goal))
        end, steps = held, 0
        for end in graph.way(held, nearest, robot):
            steps += end < len(places) and abs(places[end].level - level) < SAME_FLOOR and places[end].zone is None
            if steps == CLEAR_OF_LIFT:
                break
        return places[end].name

    def advance(self, now: float, silent: Callable[[str], bool]) -> None:
        """Let time pass: timers fire, plans come in, and leases are renewed, but not by robots that are `silent`."""
        self._now = now
        if now >= self.renewed_at + RENEWAL:
            self.renewed_at = now
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
                case Send(message) if message.header.recipient in self.passages:
                    self.passages[message.header.recipient](message.body)
                case Send(message):
                    self._deliver(message)
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
            self._handle(Notified(HoldTraffic(reason=reason)))

    # What stands in the way

    def close(
        self,
        free_spaces: Mapping[float, FreeSpace],
        things: Mapping[float, list[Disc]],
        out_of_order: Sequence[Solid] = (),
        forbidden: Sequence[Solid] = (),
        occupied_lifts: Collection[str] = (),
    ) -> None:
        """Close the places and lanes where something stands: by level, what the free space knows, and things on the floor; those in doors
        and lifts that are out of order; the ways into no-go zones; and those into lifts in which robots may be that take no part."""
        closing = self._obstructions.closing(free_spaces, things, out_of_order, forbidden, occupied_lifts)
        if closing != self._closed:
            self._closed = closing
            self._handle(Notified(closing))

    @property
    def closed_places(self) -> set[str]:
        """The places that nobody uses."""
        return {*self._closed.places, *(place for passage in self._closed.passages for place in passage.places)}

    @property
    def closed_lanes(self) -> set[ClosedLane]:
        """The lanes between other places that nobody uses."""
        return {*self._closed.lanes, *(lane for passage in self._closed.passages for lane in passage.lanes)}
