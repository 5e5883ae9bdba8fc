"""Traffic: grants robots places of the roadmap, one after the other, so that no two are in one place and none waits for ever.

A robot drives only where it was granted places, and gives them back behind it. Which robot comes first at which place is planned for all
robots together, again and again (`planning/window.py`), and kept by the schedule (`schedule.py`) however late a robot is. Robots without a
trip take part, and make room. A robot that falls silent keeps its places, because it may be anywhere on them, until it enters again or
somebody takes it out of traffic.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import chain
from typing import Self

from msgspec import structs

from somrs.errors import InputError, UsageError
from somrs.kernel.codec import Schema
from somrs.kernel.component import Answered, Effect, Effects, ErrorAnswer, Input, Notified, Received, Send, SetTimer, Started, TimerFired
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, normalised_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.leases import grant_lease
from somrs.protocol.messages.traffic import (
    Berth,
    CancelTrip,
    EnterPassage,
    EnterTraffic,
    LeaveTraffic,
    Mobility,
    PassageEntered,
    ReadRoadmap,
    ReadTraffic,
    ReportPassage,
    ReportPlace,
    RequestTrip,
    TrafficEntered,
    TrafficLeft,
    TripBegun,
)
from somrs.traffic.berths import Berths
from somrs.traffic.dispatcher import Dispatcher
from somrs.traffic.drives import Drives
from somrs.traffic.notices import CloseWays, HoldTraffic, Notice, RoadmapExpected, RoadmapMade
from somrs.traffic.passages import Passages
from somrs.traffic.planning.graph import Graph
from somrs.traffic.roadmap import Roadmap, numbered
from somrs.traffic.schedule import Schedule
from somrs.traffic.state import (
    LeasesDue,
    PlanDue,
    PlanQuestion,
    PlanTraffic,
    Position,
    RobotRecord,
    Timer,
    TrafficPlan,
    TrafficState,
    closed_by,
)
from somrs.traffic.view import held_up, roadmap_page, traffic_view

REMEMBERED = 1_000
"""How many entries are remembered, so that one that arrives again changes nothing."""


class Traffic:
    """The traffic on a roadmap. Robots enter, ask for trips, and report where they are."""

    def __init__(self, address: str, roadmap: Roadmap, *, edition: int = 0) -> None:
        self._begin(TrafficState(address=address, roadmap=roadmap, edition=edition, fences=edition))

    @classmethod
    def restored(cls, state: TrafficState) -> Self:
        """Create traffic from its state."""
        traffic = cls.__new__(cls)
        traffic._begin(state)
        return traffic

    def _begin(self, state: TrafficState) -> None:
        self.state = state
        self._berths = Berths(numbered(state.roadmap), state.berths, state.all_closed)
        self._schedule = Schedule(self._berths.graph, state.held, state.planned)
        passages = Passages(self._berths)
        self._dispatcher = Dispatcher(state, self._schedule, self._berths, passages)
        self._drives = Drives(state, self._schedule, self._berths, passages, self._dispatcher.send)

    @property
    def open(self) -> list[str]:
        """The robots that have a trip."""
        return [name for name, robot in self.state.robots.items() if robot.trip is not None]

    def occupant(self, robot: str) -> str | None:
        """The robot that works where the trip of this one leads; None if there is none."""
        record = self.state.robots.get(robot)
        return self._dispatcher.occupant(robot, record.trip) if record is not None and record.trip is not None else None

    def graph(self, *, past_fixed: bool = False) -> Graph:
        """The places and berths, and the lanes that are open; `past_fixed`: without those that fixed robots are in the way of."""
        return self._dispatcher.closures.open_graph if past_fixed else self._berths.graph

    def place(self, robot: str) -> int | None:
        """The number of the last place that the robot holds; None if it takes no part."""
        return self._schedule.last(robot) if robot in self.state.robots else None

    def is_awaited(self, robot: str) -> bool:
        """Whether others wait for places that this robot holds."""
        return any(robot in self._schedule.obstacles(name) for name in self.state.robots if name != robot)

    def may_be_passage(self, name: str) -> bool:
        """Whether a program may take part as this lift or automatic door."""
        return self._drives.passages.may_be(name)

    def positions(self, robot: str) -> tuple[Position, ...]:
        """The points of the places that a robot holds, in the order of its way."""
        return tuple(map(self._berths.position, self._schedule.held(robot)))

    def handle(self, event: Input, now: float) -> list[Effect]:
        """Handle an input and return its effects."""
        return [*self._effects(event, now)]

    def _effects(self, event: Input, now: float) -> Effects:
        match event:
            case Received(Message(body=ReadTraffic() | ReadRoadmap()) as message):
                yield self._answer(message, self._read(message.body))
                return
            case Started(address):
                self.state.address = address
                self.state.extend_leases(now)
            case Received(message):
                try:
                    yield from self._handle_request(message, now)
                except InputError as error:
                    yield Send(reply(message, Fault(code="Sender", text=str(error)), self.state.address))
            case TimerFired(LeasesDue() | PlanDue()):
                pass
            case Answered(PlanQuestion(serial), value) if serial == self.state.serial:
                yield from self._dispatcher.apply(value)
            case Notified(RoadmapExpected(is_expected)):
                self.state.is_roadmap_expected = is_expected
            case Notified(RoadmapMade(roadmap=roadmap, closing=closing)):
                yield from self.renew(roadmap, int(now))
                self._close(closing)
            case Notified(CloseWays() as closing):
                self._close(closing)
            case Notified(HoldTraffic(reason=reason)):
                self._hold(reason, now)
        self._note_silent(now)
        yield from self._dispatcher.take_back()
        yield from self._dispatcher.end_trips()
        yield from self._dispatcher.grant(now)
        yield from self._dispatcher.plan(now, self._drop_berths)
        yield from self._drives.follow()
        times = chain((robot.expires_at for robot in self.state.robots.values() if not robot.silent), self._drives.ends)
        yield SetTimer(LeasesDue(), min(times, default=None))

    def renew(self, roadmap: Roadmap, edition: int, placed: Collection[str] = ()) -> Effects:
        """Go on with a new roadmap, of at least this edition. All robots have to enter anew; until they do, they are astray, but for those
        that are `placed` otherwise."""
        state, edition = self.state, max(edition, self.state.fences + 1)
        sends = [*self._dispatcher.roadmap_replaced(edition)]
        astray = state.astray | {name: self.positions(name) for name in state.robots}
        self._begin(
            TrafficState(
                address=state.address,
                roadmap=roadmap,
                edition=edition,
                fences=edition,
                sent=state.sent,
                serial=state.serial,
                entered=state.entered,
                hold=state.hold,
                passages=state.passages,
                astray={name: positions for name, positions in astray.items() if name not in placed},
            )
        )
        state = self.state
        state.passages = {name: record for name, record in state.passages.items() if self.may_be_passage(name)}
        yield from sends

    def _handle_request(self, message: Message, now: float) -> Effects:
        match message.body:
            case EnterTraffic() | EnterPassage() as body:
                yield from self._enter_once(message, body, now)
            case ReportPassage() as body:
                yield self._answer(message, self._drives.report(body, now))
                if self._drives.is_outdated(body):
                    yield self._drives.called(body.passage)
            case ReportPlace() as body:
                yield self._answer(message, self._report(body, now))
                if body.grant < self.state.robots[body.robot].grants:
                    yield self._dispatcher.granted(body.robot, anew=False)  # it may have come before the answer to the entry
            case RequestTrip() as body:
                yield self._answer(message, self._request_trip(body, now))
            case CancelTrip(robot=name, fence=fence, trip=trip):
                record = self.state.robots.get(name)
                if record is not None and record.fence == fence and record.trip is not None and record.trip.id == trip:
                    record.trip = None
                    self.state.changed = True
            case LeaveTraffic(robot=name):
                self.state.astray.pop(name, None)
                if self.state.robots.pop(name, None) is not None:
                    self._schedule.leave(name)
                    self._dispatcher.obstacles_changed()
                yield self._answer(message, TrafficLeft(robot=name))
            case Fault():
                pass  # a Fault is never answered, least of all by a Fault
            case body:
                text = f"traffic does not understand {type(body).__name__}; robots enter it, report their places and request trips"
                yield self._answer(message, Fault(code="ActionNotSupported", text=text))

    def _read(self, body: Body) -> Body:
        if isinstance(body, ReadRoadmap):
            return roadmap_page(self.state, self._berths.roadmap, self._drives.passages, body.after)
        return traffic_view(self.state, self._schedule, self._berths, self._drives)

    def _answer(self, request: Message, body: Body) -> Send:
        return Send(reply(request, body, self.state.address))

    # Robots

    def _enter_once(self, message: Message, body: EnterTraffic | EnterPassage, now: float) -> Effects:
        """Let a robot or a passage enter. A repeated message is of a time that is over: the robot may have moved since."""
        entered, request = self.state.entered, normalised_id(message.header.message_id)
        if request not in entered:
            answer = self._enter(body, robot_address(message.header), now)
            entered[request] = answer.fence
            while len(entered) > REMEMBERED:
                del entered[next(iter(entered))]
            yield self._answer(message, answer)
            if isinstance(body, EnterTraffic):
                yield self._dispatcher.granted(body.robot)
            else:
                yield self._drives.called(body.passage)
        elif isinstance(body, EnterPassage):
            record = self.state.passages.get(body.passage)
            if record is not None and record.fence == entered[request]:
                yield self._answer(message, self._drives.entered(body.passage))
        elif (robot := self.state.robots.get(body.robot)) is not None and robot.fence == entered[request]:
            yield self._answer(message, self._entered(body.robot))

    def _enter(self, body: EnterTraffic | EnterPassage, address: str, now: float) -> TrafficEntered | PassageEntered:
        if address == ANONYMOUS:
            what = "a robot needs an address, to which places are granted" if isinstance(body, EnterTraffic) else "it needs an address"
            raise UsageError(f"{what}: state it in wsa:From")
        if isinstance(body, EnterPassage):
            return self._drives.enter(body, address, now)
        if body.edition not in (None, self.state.edition):
            raise UsageError(
                f"the roadmap has edition {self.state.edition}, and not {body.edition} any more: read it again, and enter anew"
            )
        lease = grant_lease(body.lease)
        for berth in body.berths:
            self._use_berth(body.robot, berth)
        place = self._berths.number(body.place, body.robot)
        towards = self._berths.number(body.towards, body.robot) if body.towards is not None else None
        if towards is not None and not self._berths.are_joined(place, towards):
            raise UsageError(f"no lane leads from {body.place} to {body.towards}")
        self._put(body.robot, place, towards)
        self.state.astray.pop(body.robot, None)
        self.state.fences += 1
        self.state.robots[body.robot] = RobotRecord(
            address=address, fence=self.state.fences, lease=lease, expires_at=now + lease, mobility=body.mobility
        )
        self._dispatcher.obstacles_changed()
        self._dispatcher.concern(body.robot)
        return self._entered(body.robot)

    def _put(self, name: str, place: int, towards: int | None = None) -> None:
        """The robot is at this place, or on its way to the next one, and holds no others. Raises UsageError if another robot holds them."""
        for held_place in (place, towards):
            if held_place is not None and (holder := self._schedule.holder(held_place, besides=name)) is not None:
                raise UsageError(f"{name} cannot be at {self._berths.name(held_place)}: {holder} holds it, or a place that is too close")
        if name in self._schedule:
            self._schedule.leave(name)
        self._schedule.enter(name, place)
        if towards is not None:
            self._schedule.hold(name, towards)

    def _entered(self, name: str) -> TrafficEntered:
        record = self.state.robots[name]
        return TrafficEntered(robot=name, fence=record.fence, until=record.expires_at, renew_within=record.lease / 3)

    def _report(self, body: ReportPlace, now: float) -> TrafficEntered:
        record = self._record(body.robot, body.fence)
        if body.number <= record.reported:
            return self._entered(body.robot)  # a later report has overtaken it
        place = self._berths.number(body.place, body.robot)
        record.reported = body.number
        self._dispatcher.concern(body.robot)
        count = body.progress - record.progress
        held = self._schedule.held(body.robot)
        if not 0 <= count < len(held) or held[count] != place:
            raise UsageError(f"{body.robot} was not granted its way to {body.place}: let it enter anew, where it is")
        record.progress = body.progress
        record.moved_at = now if count else record.moved_at
        self._schedule.advance(body.robot, count)
        kept_count = 2 if body.between else 1
        if body.mobility is not Mobility.FREE and body.grant == record.grants and len(held) > count + kept_count:
            self._schedule.retreat(body.robot, kept_count)
            self._dispatcher.obstacles_changed()
        if record.silent or (record.mobility is not body.mobility and Mobility.IMMOBILE in (record.mobility, body.mobility)):
            record.silent, record.mobility = False, body.mobility
            self._dispatcher.obstacles_changed()
        elif record.mobility is not body.mobility:
            record.mobility = body.mobility
            self._dispatcher.work_changed()
        record.expires_at = now + record.lease
        passage, robots = (None, ()) if count or body.between else held_up(body.robot, record, self._schedule, self._drives)
        return structs.replace(self._entered(body.robot), passage=passage, waits_for=robots)

    def _record(self, name: str, fence: int) -> RobotRecord:
        """The record of a robot. Raises UsageError if it does not take part, or if the fence is an earlier one."""
        record = self.state.robots.get(name)
        if record is None:
            raise UsageError(f"{name} does not take part in traffic: let it enter first")
        if record.fence != fence:
            raise UsageError(f"{name} has entered traffic anew since: {fence} is an earlier fence than {record.fence}")
        return record

    def _note_silent(self, now: float) -> None:
        for record in self.state.robots.values():
            if not record.silent and record.expires_at <= now:
                record.silent = True
                self._dispatcher.obstacles_changed()
        self._drives.note_silent(now)
        if (idle := self._drives.idle) != self.state.idle:
            self.state.idle = idle
            self._apply_closed()

    # Berths

    def _use_berth(self, robot: str, berth: Berth) -> None:
        if self._berths.has(berth.name, robot):
            self._drop_berths()  # the robot may have used the name for another point, and not any more
        self._berths.add(robot, berth)
        self._schedule.graph = self._berths.graph

    def _close(self, closing: CloseWays) -> None:
        self.state.closed = closed_by(closing, self._berths.roadmap.number)
        self._apply_closed()

    def _apply_closed(self) -> None:
        self.state.closings += 1
        self._berths.close(self.state.all_closed)
        self._schedule.graph = self._berths.graph
        self._dispatcher.obstacles_changed()

    def _hold(self, reason: str, now: float) -> None:
        """Hold traffic, or let it go on: what was planned ends. The time in which it was held counts for no trip."""
        self.state.hold = reason
        for record in self.state.robots.values():
            if record.trip is not None:
                record.trip.progressed_at = now
        self._dispatcher.obstacles_changed()

    def _drop_berths(self) -> None:
        """Forget the berths that nobody uses any more, but not while a plan is being made in which they may occur. Each trip adds one, and
        before each plan is soon enough."""
        if not self.state.is_planning and self.state.berths and self._berths.keep(self.state.used_places):
            self._schedule.graph = self._berths.graph

    # Trips

    def _request_trip(self, body: RequestTrip, now: float) -> TripBegun:
        record = self._record(body.robot, body.fence)
        if body.number < record.requested:
            raise UsageError(f"{body.robot} has asked for another trip since")
        if body.berth is not None:
            self._use_berth(body.robot, body.berth)
        return self._dispatcher.begin_trip(body, now)


def robot_address(header: Header) -> str:
    """The address to which a robot wants its grants: its own, or else the one to which it wants its answers."""
    return header.sender if header.sender != ANONYMOUS else header.reply_to


def only_reads(event: Input) -> bool:
    """Whether the input is a question that changes nothing and is answered on its connection; such inputs need no journal entry."""
    match event:
        case Received(Message(header=header, body=ReadTraffic() | ReadRoadmap())):
            return header.reply_to == ANONYMOUS
    return False


SCHEMA = Schema(
    component="traffic",
    version=2,
    state=TrafficState,
    timers=Timer,
    questions=PlanQuestion,
    tasks=PlanTraffic,
    answers=TrafficPlan | ErrorAnswer,
    notices=Notice,
    relocatable=True,
    is_read_only=only_reads,
    restore=Traffic.restored,
)
"""The types in the journal of traffic."""
