"""Sends robots on: begins and ends their trips, grants them places in the order of the plan, and asks for the next plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import takewhile

from somrs.errors import UsageError
from somrs.kernel.component import Ask, Effects, Send, SetTimer
from somrs.ontology.modes import why_closed
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.traffic import Granted, Mobility, RequestTrip, RoadmapReplaced, TripBegun, TripEnded, TripResult
from somrs.traffic.berths import Berths
from somrs.traffic.closures import Closures
from somrs.traffic.exits import Exits, Lane
from somrs.traffic.passages import Passages
from somrs.traffic.planning.graph import FAR, Graph
from somrs.traffic.schedule import Schedule
from somrs.traffic.state import (
    Obstacle,
    OutOfOrder,
    PlanDue,
    PlannedRobot,
    PlanQuestion,
    PlanTraffic,
    RobotRecord,
    TrafficPlan,
    TrafficState,
    Trip,
    names_of,
)

AHEAD = 3
"""The number of places that a robot is granted beyond the one where it is: enough not to stop at each."""
HORIZON = 20
"""The number of steps that are planned ahead."""
PAUSE = 0.2
"""The least time between two plans, in seconds. It doubles with each plan that moves nobody, up to `LONGEST_PAUSE`."""
LONGEST_PAUSE = 10.0
HELD_UP = 2.0
"""The time after which a robot that comes no nearer to its goal looks for ways round those that stand, in seconds."""
STALL = 15.0
"""The time after which ways are searched for, because a robot comes no nearer to its goal, in seconds."""
LONGEST_TURN = 60.0
"""The time after which ways are searched for, although others come through the corridor for which the robot waits, in seconds."""
RENEWAL = 2.0
"""The time after which a plan is renewed that has come to its end for some robots, and not for all, in seconds."""
EFFORT = 1_000
"""The steps that a search for ways takes at most. They double with each plan that moves nobody, up to `MOST_EFFORT`."""
MOST_EFFORT = 16_000
MOST_DOUBLINGS = 10
"""After so many, both are at their limits: 2 to the power of the plans of a day is no number that a pause could be multiplied by."""
CROWD = 20
"""Of so many robots; more robots get as many steps fewer, as each step takes longer: meanwhile, traffic stands still."""


class Dispatcher:
    """The part of traffic that follows from its state: the same for every input, after it was handled."""

    def __init__(self, state: TrafficState, schedule: Schedule, berths: Berths, passages: Passages) -> None:
        self.state, self._schedule, self._berths, self._passages = state, schedule, berths, passages
        self.closures = Closures(state, schedule)
        self._exits = Exits(state, schedule, berths)
        self._concerned: dict[str, None] = {}
        """The robots whose places, trips or mobility may have changed since trips were ended last."""
        self._circumstances: tuple[Graph, frozenset[int]] | None = None
        """The graph without berths, and the closed places, then."""

    # Trips

    def begin_trip(self, body: RequestTrip, now: float) -> TripBegun:
        """Begin the trip of a robot that takes part, unless it has begun: the same request may arrive again. Raises UsageError without a
        way."""
        record = self.state.robots[body.robot]
        destination, start = self._berths.number(body.destination, body.robot), self._schedule.last(body.robot)
        distance = self._berths.graph.distance(start, destination)
        if distance == FAR:
            reason = self._why_no_way(body.robot, start, destination)
            raise UsageError(f"no lanes lead from {self._berths.name(start)} to {body.destination}{reason}")
        if body.number > record.requested:
            record.requested = body.number
            record.trip = Trip(id=body.trip, destination=destination, since=now, nearest=distance, progressed_at=now)
            self.state.changed, self.state.failures = True, 0
            self.concern(body.robot)
        return TripBegun(trip=body.trip, length=distance)

    def _why_no_way(self, robot: str, start: int, destination: int) -> str:
        passages = self._closed_passages(robot, destination)
        if passages:
            return f": {why_closed(*names_of(passages))}"
        return " now, because of doors that are shut, or of what stands there" if self._berths.is_shut(start, destination) else ""

    def end_trips(self) -> Effects:
        """End the trips of robots that have arrived, and of those that cannot arrive any more."""
        circumstances = self._schedule.graph.public, self.closures.places
        concerned = self._concerned if circumstances == self._circumstances else self.state.robots
        self._circumstances, self._concerned, closed = circumstances, {}, circumstances[1]
        for name in concerned:
            record = self.state.robots.get(name)
            if record is None or record.trip is None or record.silent:
                continue
            if self._schedule.held(name)[0] == record.trip.destination:
                yield self._end_trip(name, TripResult.ARRIVED)
            elif record.mobility is Mobility.IMMOBILE:
                yield self._end_trip(name, TripResult.IMMOBILE)
            elif (blockers := self.closures.blockers(name, record.trip, closed)) is not None:
                passages = self._closed_passages(name, record.trip.destination) if not blockers else ()
                yield self._end_trip(name, TripResult.CLOSED, blockers, passages)

    def work_changed(self) -> None:
        """A robot begins or ends its work. What is planned is good until there is another plan: nobody is granted a place that is not free,
        and where there is no room, it is proved with room for those that come free."""
        self.state.changed, self.state.whole, self.state.failures = True, False, 0

    def obstacles_changed(self) -> None:
        """What was planned does not hold any more, nor what is being planned."""
        self.state.changed, self.state.whole, self.state.is_planning = True, False, False
        self.state.serial, self.state.failures = self.state.serial + 1, 0
        self._schedule.plan({})

    def concern(self, name: str) -> None:
        """Have it looked at whether the trip of this robot ends."""
        self._concerned[name] = None

    def _closed_passages(self, name: str, destination: int) -> tuple[OutOfOrder, ...]:
        """The passages that are out of order, and the no-go zones, on the robot's way to a place to which no other way leads."""
        return self._berths.closed_passages(name, self._schedule.last(name), destination)

    def _end_trip(self, name: str, result: TripResult, robots: tuple[str, ...] = (), closed: tuple[OutOfOrder, ...] = ()) -> Send:
        record = self.state.robots[name]
        assert record.trip is not None, "only trips end"
        passages, zones = names_of(closed)
        ended = TripEnded(robot=name, trip=record.trip.id, result=result, robots=robots, passages=passages, zones=zones)
        record.trip = None
        self.state.changed = True
        return self._send(record, ended)

    # Grants

    def take_back(self) -> Effects:
        """Take back what robots in lifts that stand still were granted outside, where others may pass meanwhile. Those that were told that
        the lift is open may be on their way there."""
        for name in filter(self._is_confined, self.state.robots):
            held, record = self._schedule.held(name), self.state.robots[name]
            inside = len([*takewhile(self._passages.is_inside, held)])
            may_leave = inside == 1 and record.told is not None and record.told.is_open and record.told.progress == record.progress
            if len(held) > inside and not may_leave:
                self._schedule.retreat(name, inside)
                self.obstacles_changed()
                yield self.granted(name)

    def _is_confined(self, name: str) -> bool:
        """Whether a robot is in a lift that stands still between floors, or whose program does not answer: it goes on as soon as that
        changes, and not before. Out of one that is at a floor it is let, even if nobody else is taken along."""
        if not self.state.idle:
            return False
        records = (self.state.passages.get(lift) for lift in self._passages.lifts_on(self.state.held[name][:1]))
        return any(record is None or record.silent or (not record.working and record.level is None) for record in records)

    def grant(self, now: float) -> Effects:
        """Grant places in the order of the plan, unless a plan is being made, which begins where the granted ways end."""
        if self.state.is_planning or self.state.is_roadmap_expected:
            return
        leaving = self._leaving
        granted: dict[str, None] = {}
        while waiting := [name for name, planned in self.state.planned.items() if planned]:
            progressed = [name for name in waiting if self._grant_next(name, now, leaving)]
            if not progressed:
                break
            granted |= dict.fromkeys(progressed)
        if self.state.hold and not leaving:
            self._schedule.plan({})  # those that made room stay where they are
        for name in granted:
            yield self.granted(name)

    def _grant_next(self, name: str, now: float, leaving: set[str]) -> bool:
        """Grant the robot its next place. `leaving`: see `_leaving`; a robot whose way ends outside is none of them any more."""
        record = self.state.robots[name]
        if self.state.hold and not leaving:
            return False
        if record.silent or record.mobility is not Mobility.FREE or len(self._schedule.held(name)) > AHEAD:
            return False
        place = self._schedule.grant(name)
        if place is not None:
            self.state.granted_at = now
            self.concern(name)
        if place is not None and record.trip is not None:
            distance = self._berths.graph.distance(place, record.trip.destination)
            if distance < record.trip.nearest:
                record.trip.nearest, record.trip.progressed_at = distance, now
        if name in leaving and self._goal(name, self._exits.stuck_lanes()) is None:
            leaving.discard(name)
        return place is not None

    def granted(self, name: str, *, anew: bool = True) -> Send:
        """Tell a robot which places it holds. `anew`: they are others than it was told before."""
        record = self.state.robots[name]
        record.grants += anew
        held = self._schedule.held(name)
        way, gated = tuple(map(self._berths.name, held)), self._passages.gated(held)
        planned = tuple(map(self._berths.name, self._schedule.planned(name)))
        grant = Granted(
            robot=name, fence=record.fence, number=record.grants, progress=record.progress, way=way, gated=gated, planned=planned
        )
        return self._send(record, grant)

    def roadmap_replaced(self, edition: int) -> Effects:
        """Tell all robots that there is a new roadmap."""
        for name, record in self.state.robots.items():
            yield self._send(record, RoadmapReplaced(robot=name, fence=record.fence, edition=edition))

    def _send(self, record: RobotRecord, body: Body) -> Send:
        return self.send(record.address, body)

    def send(self, address: str, body: Body) -> Send:
        """Send a message that nobody has asked for."""
        self.state.sent += 1
        header = Header(
            sender=self.state.address,
            recipient=address,
            # The edition makes the id one of this program, also if an earlier one has left no journal.
            message_id=message_id(self.state.address, "traffic", self.state.edition, self.state.sent),
            reply_to=self.state.address,
        )
        return Send(Message(header=header, body=body))

    # Plans

    def plan(self, now: float, drop_berths: Callable[[], None]) -> Effects:
        """Ask for a plan, if there is reason to, and none is being made. Before, `drop_berths` forgets those that nobody uses."""
        state = self.state
        if state.is_planning or not (state.changed or self._is_exhausted()) or self._is_followed(now):
            return
        if state.hold and not self._leaving:
            return
        growth = 2 ** min(state.failures, MOST_DOUBLINGS)
        pause = PAUSE * growth if state.changed or not any(state.planned.values()) else RENEWAL
        due_at = state.planned_at + min(pause, LONGEST_PAUSE)
        if now < due_at:
            yield SetTimer(PlanDue(), due_at)
            return
        drop_berths()
        state.serial += 1
        planned_before, state.planned_at = state.planned_at, now
        state.is_planning, state.changed = True, False
        may_search, stuck = now > state.searched_at + STALL, self._exits.stuck_lanes()
        robots = tuple(
            self._planned_robot(name, self._goal(name, stuck), now, planned_before, may_search=may_search) for name in state.robots
        )
        searches = may_search and any(self._is_stalled(name, record, now, LONGEST_TURN) for name, record in state.robots.items())
        if any(robot.stalled for robot in robots):
            state.searched_at = now
            state.searches += 1
            # Of the searches, every second one is twice as thorough, every fourth one four times, and so on.
            growth = max(growth, state.searches & -state.searches)
        effort = min(EFFORT * growth, MOST_EFFORT) * CROWD // max(CROWD, len(robots))
        problem = PlanTraffic(
            serial=state.serial,
            robots=robots,
            closed=state.all_closed,
            blocked=tuple(sorted(self.closures.places)),
            private=tuple(self._berths.private_places),
            steps=HORIZON,
            effort=effort,
            searches=searches,
        )
        yield Ask(PlanQuestion(state.serial), problem)

    def _goal(self, name: str, stuck: Mapping[str, Lane]) -> int | None:
        """Where the robot is to go now, if anywhere. While traffic is held, it only leaves the zone in which its granted way ends; without
        a trip, the place where robots are not to stop. `stuck`: the lanes of robots that are stuck."""
        if self._is_confined(name):
            return None
        if self.state.hold:
            return self._exits.nearest(name)
        record = self.state.robots[name]
        if record.trip is not None:
            return record.trip.destination
        return self._exits.rest(name, stuck) if record.mobility is Mobility.FREE and not record.silent else None

    def _current_trip(self, name: str) -> Trip | None:
        """The robot's trip, if it can go on with it now."""
        return self.state.robots[name].trip if not self.state.hold and not self._is_confined(name) else None

    @property
    def _leaving(self) -> set[str]:
        """While traffic is held, the robots that still have to leave a zone."""
        if not self.state.hold:
            return set()
        stuck = self._exits.stuck_lanes()
        return {name for name in self.state.robots if self._goal(name, stuck) is not None}

    def _planned_robot(self, name: str, goal: int | None, now: float, planned_before: float, *, may_search: bool) -> PlannedRobot:
        record = self.state.robots[name]
        trip, is_confined = self._current_trip(name), self._is_confined(name)
        return PlannedRobot(
            name=name,
            place=self._schedule.last(name),
            goal=goal,
            waiting=now - trip.since if trip is not None else 0.0,
            nearest=trip.nearest if trip is not None else FAR,
            movable=not record.silent and record.mobility is Mobility.FREE and not is_confined,
            busy=not record.silent and (record.mobility is Mobility.BUSY or is_confined),
            begins=trip is not None and trip.since >= planned_before,
            held_up=trip is not None and now > trip.progressed_at + HELD_UP,
            stalled=may_search and self._is_stalled(name, record, now, STALL),
        )

    def _is_stalled(self, name: str, record: RobotRecord, now: float, limit: float) -> bool:
        """Whether a robot has come no nearer to its goal for so long, though it drives where it may, and nobody works at its goal."""
        trip = self._current_trip(name)
        if trip is None or record.silent or now <= trip.progressed_at + limit:
            return False
        has_way = len(self._schedule.held(name)) > AHEAD and now > record.moved_at + STALL
        return not has_way and self.occupant(name, trip) is None

    def occupant(self, name: str, trip: Trip) -> str | None:
        """The robot that works where the trip of this one leads; None if there is none."""
        holder = self._schedule.holder(trip.destination, besides=name)
        return holder if holder is not None and self.state.robots[holder].mobility is Mobility.BUSY else None

    def _is_followed(self, now: float) -> bool:
        """Whether the plan is to be followed to its end, and somebody gets on by it: those for whom it waits may not come for long."""
        state = self.state
        return state.whole and any(state.planned.values()) and now <= max(state.planned_at, state.granted_at) + LONGEST_TURN

    def _is_exhausted(self) -> bool:
        """Whether the plan has come to its end for a robot that is not at its goal."""
        stuck = self._exits.stuck_lanes()
        return any(
            not planned and (goal := self._goal(name, stuck)) is not None and goal != self._schedule.last(name)
            for name, planned in self.state.planned.items()
        )

    def apply(self, value: object) -> Effects:
        """Follow the plan that was asked for."""
        self.state.is_planning = False
        if not isinstance(value, TrafficPlan):
            self.state.changed = True  # the planner failed, or its work was lost
            return
        self._schedule.plan(value.ways)
        moves = any(self.state.planned.values())
        self.state.whole = value.whole and moves
        robots = self.state.robots
        stuck = self._exits.stuck_lanes()
        self.state.failures = 0 if moves or all(self._goal(name, stuck) is None for name in robots) else self.state.failures + 1
        if self.state.hold:
            return  # the trips go on afterwards
        for name, obstacle in value.stuck.items():
            trip = robots[name].trip
            if trip is not None and trip.destination == obstacle.goal:  # it may have another one since
                yield self._end_stuck_trip(name, obstacle)

    def _end_stuck_trip(self, name: str, obstacle: Obstacle) -> Send:
        """End a trip for which the others have no room: with those that cannot move and without which they would have it, if any."""
        holders = (self._schedule.holder(place, besides=name) for place in obstacle.places)
        fixed = [holder for holder in holders if holder is not None]
        result = TripResult.CLOSED if fixed else TripResult.NO_ROOM
        return self._end_trip(name, result, tuple(dict.fromkeys((*fixed, *obstacle.robots))))
