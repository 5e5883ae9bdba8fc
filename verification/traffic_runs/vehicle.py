"""A robot that takes part in traffic: where it truly is, and the program that drives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from msgspec import Struct

from somrs.kernel.component import DeliveryFailed, Effect, Effects, Input, Received, Send, SetTimer, Started, TimerFired
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.traffic import (
    Berth,
    Granted,
    Mobility,
    PassageClosed,
    PassageOpen,
    RequestTrip,
    TrafficEntered,
    TripBegun,
    TripEnded,
    TripResult,
)
from somrs.traffic.participant import Participant

LEASE = 6.0
"""The lease of a robot, in seconds."""
PAUSE = 3.0
"""The time after which a robot asks again, for a trip that it could not make or for its way into traffic, in seconds."""


MOST_REFUSALS = 3
"""How often a robot asks for a trip for which there is no room, before it leaves it out."""


class Arrives(Struct, frozen=True):
    """The robot arrives at the place to which it is on its way."""


class ReportDue(Struct, frozen=True):
    """The lease is to be renewed, or the robot is to enter again."""


class WorkDone(Struct, frozen=True):
    """The work at the goal is finished."""


class TripDue(Struct, frozen=True):
    """The next trip is to be requested."""


@dataclass(slots=True, kw_only=True)
class Robot:
    """The robot itself, which is there whether or not its program runs. `towards`: the place to which it is on its way.

    `berths`: points beside the roadmap, by the names that the robot has for them.
    """

    name: str
    place: str
    trips: list[str]
    """The places where it still has to go."""
    berths: dict[str, Berth]
    towards: str | None = None
    broken: bool = False
    lives: int = 0
    """How often its program was started."""
    endings: list[TripEnded] = field(default_factory=list)


class Vehicle:
    """The program of a robot. `seconds`: how long it takes from one place to another. `work`: how long it works where it has arrived.
    `works`: it works from the start on, without end."""

    def __init__(
        self,
        robot: Robot,
        traffic: str,
        seconds: Callable[[str, str], float],
        work: float,
        *,
        works: bool = False,
    ) -> None:
        self.robot, self._traffic, self._seconds, self._work = robot, traffic, seconds, work
        self._address = ""
        self._sent = 1
        self._requests: set[str] = set()
        """The ids of its messages."""
        self._participant = Participant(robot.name, robot.place, robot.towards)
        self._works = works
        self._trip: str | None = None
        self._begun: str | None = None
        """The last trip that was not refused."""
        self._refusals = 0
        self._returning: str | None = None
        """The report by which it gives its way back, until that is answered."""
        robot.lives += 1

    def handle(self, event: Input, now: float) -> list[Effect]:
        effects = [*self._effects(event, now)]
        self.robot.place, self.robot.towards = self._participant.place, self._participant.towards
        return effects

    def _effects(self, event: Input, now: float) -> Effects:
        participant = self._participant
        match event:
            case Started(address):
                self._address = address
                yield from self._enter(now)
            case Received(Message(body=TrafficEntered() | Fault(), header=Header(relates_to=request))) if request not in self._requests:
                pass  # to an earlier life of this program, which was somewhere else
            case Received(Message(body=TrafficEntered() as entered, header=header)) if entered.fence >= participant.fence:
                if participant.entered(entered):
                    if participant.towards is not None:
                        yield SetTimer(Arrives(), now + self._seconds(participant.place, participant.towards))
                    yield SetTimer(TripDue(), now)
                yield SetTimer(ReportDue(), now + entered.renew_within)
                if self._returning is not None and header.relates_to == self._returning:
                    self._returning = None  # a later report must not overtake the one by which it gives its way back
                    yield self._report()
            case Received(Message(body=Granted() as granted)) if participant.granted(granted):
                yield from self._go_on(now)
                if self._mobility is not Mobility.FREE and len(granted.way) > 1:
                    yield self._report()  # it gives back what it cannot use
            case Received(Message(body=PassageOpen() as opened)) if participant.opened(opened):
                yield from self._go_on(now)
            case Received(Message(body=PassageClosed() as closed)) if participant.is_refused(closed):
                refusal = self._send(participant.report(Mobility.BUSY))
                self._returning = refusal.message.header.message_id
                yield refusal
            case Received(Message(body=PassageOpen() | PassageClosed())):
                pass
            case Received(Message(body=TripEnded() as ended)) if ended.trip == self._trip:
                yield from self._end(ended, now)
            case Received(Message(body=TripBegun(trip=trip))):
                self._begun = trip
            case DeliveryFailed(Message(body=RequestTrip())):
                yield SetTimer(TripDue(), now)
            case DeliveryFailed() if not participant.fence:
                yield SetTimer(ReportDue(), now)
            case Received(Message(body=Fault())):
                yield SetTimer(ReportDue(), now + PAUSE)
                if self._trip != self._begun:  # a closed passage may be the only way
                    yield SetTimer(TripDue(), now + PAUSE)
            case TimerFired(Arrives()) if participant.towards is not None and not self.robot.broken:
                participant.arrive()
                yield self._report()
                yield from self._go_on(now)
            case TimerFired(ReportDue()):
                yield from ([self._report()] if participant.fence else self._enter(now))
                yield SetTimer(ReportDue(), now + LEASE / 3)
            case TimerFired(WorkDone()):
                self._works = False
                yield self._report()
                yield SetTimer(TripDue(), now)
            case TimerFired(TripDue()) if self.robot.trips and not self._works:
                yield from self._request(now)

    def _enter(self, now: float) -> Effects:
        berths = (self.robot.berths[name] for name in (self.robot.place, self.robot.towards) if name in self.robot.berths)
        yield self._send(self._participant.enter(LEASE, tuple(berths), self._mobility))
        yield SetTimer(ReportDue(), now + PAUSE)

    @property
    def _mobility(self) -> Mobility:
        if self.robot.broken:
            return Mobility.IMMOBILE
        return Mobility.BUSY if self._works or self._returning is not None else Mobility.FREE

    def _report(self) -> Send:
        return self._send(self._participant.report(self._mobility))

    def _request(self, now: float) -> Effects:
        if self.robot.broken:
            yield SetTimer(TripDue(), now + PAUSE)
            return
        self._trip = f"{self.robot.name}/{self.robot.lives}/{self._sent}"
        destination = self.robot.trips[0]
        yield self._send(self._participant.request(self._trip, self.robot.berths.get(destination, destination)))

    def _end(self, ended: TripEnded, now: float) -> Effects:
        self._trip = None
        self.robot.endings.append(ended)
        if ended.result is TripResult.NO_ROOM:
            self._refusals += 1
        if ended.result is not TripResult.ARRIVED and self._refusals < MOST_REFUSALS:
            yield SetTimer(TripDue(), now + PAUSE)
            return
        self._refusals = 0
        self.robot.trips.pop(0)
        if self._work and self.robot.trips and self._participant.towards is None:
            self._works, self._participant.way = True, ()
            yield self._report()
            yield SetTimer(WorkDone(), now + self._work)
        else:
            yield SetTimer(TripDue(), now)

    def _go_on(self, now: float) -> Effects:
        """Drive to the next place, if it is granted."""
        if self.robot.broken or self._works or not self._participant.fence:
            return
        if self._participant.may_depart and (following := self._participant.depart()) is not None:
            yield SetTimer(Arrives(), now + self._seconds(self._participant.place, following))

    def _send(self, body: Body) -> Send:
        self._sent += 1
        header = Header(
            sender=self._address,
            recipient=self._traffic,
            message_id=message_id(self._address, self.robot.lives, self._sent),
            reply_to=self._address,
        )
        self._requests.add(header.message_id)
        return Send(Message(header=header, body=body))
