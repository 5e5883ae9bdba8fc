"""The programs of lifts and automatic doors in traffic: they are called for the robots that hold places in their ways, and say when
robots can come.

The lease of a robot is the session. What a passage is called for follows from the places that robots hold, at any time and after any
restart; that a robot has boarded, or has left, follows from what it reports.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from somrs.entish.parse import nearest
from somrs.errors import UsageError
from somrs.kernel.component import Effects, Send
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.leases import grant_lease
from somrs.protocol.messages.traffic import (
    CallPassage,
    EnterPassage,
    PassageClosed,
    PassageEntered,
    PassageInTraffic,
    PassageOpen,
    ReleasePassage,
    ReportPassage,
)
from somrs.traffic.berths import Berths
from somrs.traffic.passage_call import PassageCall
from somrs.traffic.passages import Passages
from somrs.traffic.schedule import Schedule
from somrs.traffic.state import OutOfOrder, PassageNotice, PassageRecord, TrafficState

AT_FLOOR = 0.1
"""Difference in height up to which a cabin is at a floor, in metres: programs may round what the map states."""

SendTo = Callable[[str, Body], Send]
"""Makes the effect that sends a body to an address."""


class Drives:
    """The passages of the roadmap, and what of them the robots need."""

    def __init__(self, state: TrafficState, schedule: Schedule, berths: Berths, passages: Passages, send: SendTo) -> None:
        self._state, self._schedule, self._berths, self._send = state, schedule, berths, send
        self.passages = passages
        self._closings: dict[str, OutOfOrder] = {}
        self._doors: dict[str, frozenset[str]] = {}
        """By robot: the doors in its way."""
        self._lifts: dict[str, str] = {}
        """By lift: the robot that has it."""
        self._rides: dict[str, tuple[object, PassageCall]] = {}
        """By lift: what it was wanted for last, with what that follows from."""
        self._awaited: dict[str, tuple[str, ...]] = {}
        """By robot: the passages that have to be open before it comes to the next place of its way."""
        self._astray = {name: self.passages.doors_along(positions) for name, positions in state.astray.items()}
        """By robot that has not entered anew: the doors in its way."""

    # What programs say

    def enter(self, body: EnterPassage, address: str, now: float) -> PassageEntered:
        """The program of a passage takes part, maybe anew. Raises UsageError if there is no such passage."""
        if not self.passages.may_be(body.passage):
            hint = nearest(body.passage, self.passages.names) or f"there are {', '.join(self.passages.names) or 'none'}"
            raise UsageError(f"{body.passage} is no lift or automatic door on the map where robots drive; {hint}")
        state, lease = self._state, grant_lease(body.lease)
        state.fences += 1
        record = PassageRecord(address=address, fence=state.fences, lease=lease, expires_at=now + lease)
        if (earlier := state.passages.get(body.passage)) is not None:
            # The passage itself is as it was: robots may wait for it, or be in it.
            record.call, record.calls, record.level = earlier.call, earlier.calls, earlier.level
            record.working, record.shared, record.silent = earlier.working, earlier.shared, earlier.silent
        record.calls += 1
        record.since = record.calls
        state.passages[body.passage] = record
        return self.entered(body.passage)

    def entered(self, name: str) -> PassageEntered:
        """What a program is told of its lease."""
        record = self._state.passages[name]
        return PassageEntered(passage=name, fence=record.fence, until=record.expires_at, renew_within=record.lease / 3)

    def report(self, body: ReportPassage, now: float) -> PassageEntered:
        """Note how a passage is. Raises UsageError if its program does not take part."""
        record = self._state.passages.get(body.passage)
        if record is None:
            raise UsageError(f"the program of {body.passage} does not take part in traffic: let it enter first")
        if record.fence != body.fence:
            raise UsageError(
                f"a program of {body.passage} has entered traffic anew since: {body.fence} is an earlier fence than {record.fence}"
            )
        if body.number > record.reported:  # a later report may have overtaken it
            record.reported, record.followed, record.level = body.number, body.call, body.level
            record.open, record.working, record.shared = body.open, body.working, body.shared
            record.silent, record.expires_at = False, now + record.lease
        return self.entered(body.passage)

    def called(self, name: str) -> Send:
        """Tell a program what its passage is called for."""
        record, call = self._state.passages[name], self._state.passages[name].call
        body: Body = ReleasePassage(passage=name, fence=record.fence, number=record.calls)
        if call is not None:
            body = CallPassage(
                passage=name,
                fence=record.fence,
                number=record.calls,
                level=call.level,
                destination=call.destination,
                robots=call.robots,
            )
        return self._send(record.address, body)

    def is_outdated(self, body: ReportPassage) -> bool:
        """Whether the program does not know yet what it was told last: that may have come before the answer to its entry."""
        return body.call < self._state.passages[body.passage].calls

    def note_silent(self, now: float) -> None:
        """Note whose leases have ended."""
        for record in self._state.passages.values():
            record.silent |= record.expires_at <= now

    @property
    def ends(self) -> Iterator[float]:
        """When leases end."""
        return (record.expires_at for record in self._state.passages.values() if not record.silent)

    # What is closed

    @property
    def idle(self) -> tuple[OutOfOrder, ...]:
        """The passages that nobody enters, because their programs do not take part, do not answer, or say that they do not work."""
        return tuple(self._closing_of(name) for name in self.passages.names if not self._is_usable(name))

    def _closing_of(self, name: str) -> OutOfOrder:
        if name not in self._closings:
            self._closings[name] = self.passages.closing(name)
        return self._closings[name]

    @property
    def _closed_names(self) -> set[str]:
        return {passage.name for passage in (*self._state.closed.passages, *self._state.idle)}

    def _is_usable(self, name: str) -> bool:
        """Whether the program of a passage answers, and says that it works."""
        record = self._state.passages.get(name)
        return record is not None and record.working and not record.silent

    # What robots need

    def follow(self) -> Effects:
        """Call the passages that robots need now, release those that they need no more, and tell robots what is open."""
        if not self.passages.names:
            return
        for robot in self._schedule.moved:
            self._note_needs(robot)
        self._schedule.moved.clear()
        for name, record in self._state.passages.items():
            if name in self.passages.names and (call := self._wanted(name, record)) != record.call:
                record.calls += 1
                if call is None or record.call is None or (call.level, call.robots) != (record.call.level, record.call.robots):
                    record.since = record.calls
                record.call = call
                yield self.called(name)
        for robot, passages in self._awaited.items():
            yield from self._tell(robot, passages)

    def _note_needs(self, robot: str) -> None:
        self._doors.pop(robot, None)
        self._lifts = {lift: holder for lift, holder in self._lifts.items() if holder != robot}
        held = self._state.held.get(robot)
        passages = self.passages.entered(*held[:2]) if held is not None and len(held) > 1 else ()
        if passages:
            self._awaited[robot] = passages
        else:
            self._awaited.pop(robot, None)
            if robot in self._state.robots:
                self._state.robots[robot].told = None
        if held is not None:
            self._astray.pop(robot, None)
            self._lifts |= dict.fromkeys(self.passages.lifts_on(held), robot)
            if doors := self.passages.doors_on(held):
                self._doors[robot] = doors

    def _wanted(self, name: str, record: PassageRecord) -> PassageCall | None:
        """What a passage is to be called for; None if nobody needs it."""
        if name not in self.passages.lifts:
            is_needed = any(name in doors for needs in (self._doors, self._astray) for doors in needs.values())
            return PassageCall() if is_needed else None
        robot = self._lifts.get(name)
        if robot is None:
            is_astray = any(position.zone == name for way in self._state.astray.values() for position in way)
            return record.call if is_astray else None
        held, trip = self._state.held[robot], self._state.robots[robot].trip
        goal = trip.destination if trip is not None else None
        ground = robot, tuple(held), goal, self._schedule.graph.public
        if name not in self._rides or self._rides[name][0] != ground:
            destination = self.passages.destination(name, robot, held, goal)
            self._rides[name] = ground, PassageCall(level=self.passages.level(name, held), destination=destination, robots=(robot,))
        return self._rides[name][1]

    def _tell(self, robot: str, passages: tuple[str, ...]) -> Effects:
        """Tell a robot that the passages before the next place of its way are open; or which one is closed, if that is so."""
        record, place = self._state.robots[robot], self._state.held[robot][1]
        closed = next((name for name in passages if self._is_closed_to(name, robot)), None)
        if closed is None and not all(self._is_open_for(name, robot) for name in passages):
            return
        notice = PassageNotice(record.progress, place, closed is None)
        if record.told != notice:
            record.told = notice
            name, fence, progress = self._berths.name(place), record.fence, record.progress
            if closed is None:
                opened = PassageOpen(robot=robot, fence=fence, progress=progress, passage=passages[0], place=name, report=record.reported)
                yield self._send(record.address, opened)
            else:
                yield self._send(record.address, PassageClosed(robot=robot, fence=fence, progress=progress, passage=closed, place=name))

    def _is_closed_to(self, name: str, robot: str) -> bool:
        """Whether nobody is let in, and the robot is not inside."""
        return name in self._closed_names and not (name in self.passages.lifts and self.passages.is_inside(self._state.held[robot][0]))

    def _is_open_for(self, name: str, robot: str) -> bool:
        """Whether the program has said so since the passage was called for this robot."""
        record = self._state.passages.get(name)
        if record is None or record.call is None or record.silent or record.shared or not record.open or record.followed < record.since:
            return False
        if name not in self.passages.lifts:
            return True
        level = record.call.level
        return level is not None and record.level is not None and abs(record.level - level) < AT_FLOOR and robot in record.call.robots

    # What is to be seen

    def awaited_by(self, robot: str) -> tuple[str | None, bool]:
        """The lift in which a robot is, and True; or the lift or door for which it waits, and False."""
        held = self._state.held[robot]
        if self.passages.is_inside(held[0]):
            return next(iter(self.passages.lifts_on(held[:1])), None), True
        record, passages = self._state.robots[robot], self._awaited.get(robot, ())
        is_let_in = record.told == PassageNotice(record.progress, held[1], True) if passages else True
        return (None if is_let_in else next((name for name in passages if not self._is_open_for(name, robot)), passages[0])), False

    def view(self) -> Iterator[PassageInTraffic]:
        """All passages of the roadmap."""
        for name in self.passages.names:
            record = self._state.passages.get(name)
            if record is None:
                yield PassageInTraffic(passage=name, usable=False, silent=True)
                continue
            robots = record.call.robots if record.call is not None else ()
            if name not in self.passages.lifts:
                robots = tuple(robot for robot, doors in self._doors.items() if name in doors)
            yield PassageInTraffic(
                passage=name,
                usable=name not in self._closed_names,
                silent=record.silent,
                level=record.level,
                open=record.open,
                shared=record.shared,
                robots=robots,
            )
