"""The part in traffic of a robot of any make, without its hardware: it takes part, asks for trips, has the robot follow the ways that are
granted, and reports where it is.

What the robot is told and tells is in places with numbers, which grow by one from place to place for as long as the program runs.
"""

from __future__ import annotations

from msgspec import Struct, structs

from somrs.kernel.component import (
    Answered,
    Ask,
    DeliveryFailed,
    Effect,
    Effects,
    Input,
    Notified,
    Received,
    Send,
    SetTimer,
    Started,
    TimerFired,
    Withdraw,
)
from somrs.kernel.not_understood import refuse_request
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.traffic import (
    EnterTraffic,
    Granted,
    Mobility,
    PassageClosed,
    PassageOpen,
    ReadRoadmap,
    ReportPlace,
    RequestTrip,
    RoadmapPage,
    RoadmapReplaced,
    TrafficEntered,
    TripBegun,
    TripEnded,
)
from somrs.traffic.participant import Participant
from somrs.traffic.roadmap_reading import RoadmapReading
from somrs.traffic.robot_tasks import (
    Astray,
    Complaint,
    Follow,
    HeldUp,
    Locate,
    MobilityChanged,
    PlacePassed,
    SilenceChanged,
    Standing,
    TripGivenUp,
    TripOver,
    TripWanted,
    WayPlace,
)

LEASE = 30.0
"""The lease of a robot's places, in seconds."""
MOST_UNANSWERED = 50
"""How many requests it remembers whose answers have not come."""
PAUSE = 2.0
"""The time after which something is tried again that was refused or failed, in seconds."""


class _Due(Struct, frozen=True, tag=True):
    """Something is to be tried again, or the lease to be renewed."""


class _Question(Struct, frozen=True, tag=True):
    """A question to the hardware. The numbers tell one from another."""

    number: int


class RobotProgram:
    """The program of one robot. `life`: another one for each start."""

    def __init__(self, robot: str, address: str, traffic: str, life: str) -> None:
        self._robot, self._address, self._traffic, self._life = robot, address, traffic, life
        self._reading = RoadmapReading()
        self._participant: Participant | None = None
        """Its part, from when it was located."""
        self._number = 0
        """That of the place at which it is, or was last."""
        self._mobility = Mobility.FREE
        self._is_silent = False
        self._returning = 0
        """The number of its report with which it gave its way back; 0 after the answer."""
        self._trip: TripWanted | None = None
        self._is_requested = False
        self._told: tuple[WayPlace, ...] = ()
        self._halts = 0
        """How often the robot has been told to stand still."""
        self._held_up = HeldUp()
        """What the robot was told that it waits for."""
        self._locating: _Question | None = None
        self._is_entering, self._entry_time = False, 0.0
        """Whether its entry has not been answered, and when it was sent."""
        self._refusals = 0
        """How often traffic has refused it since it took part last."""
        self._sent: dict[str, Body] = {}
        """The requests that are not answered."""
        self._message_count = self._question_count = 0

    def handle(self, event: Input, now: float) -> list[Effect]:
        return [*self._effects(event, now)]

    def _effects(self, event: Input, now: float) -> Effects:
        match event:
            case Started():
                yield self._read_roadmap(now)
                yield SetTimer(_Due(), now + PAUSE)
            case TimerFired(_Due()):
                yield from self._try_again(now)
            case Received(message):
                yield from self._receive(message, now)
            case Notified(notice):
                yield from self._notice(notice, now)
            case Answered(question=question, value=value) if question == self._locating:
                self._locating = None
                yield from self._enter(value, now)
            case DeliveryFailed(message=Message(header=header)):
                match self._sent.pop(header.message_id, None):
                    case EnterTraffic():
                        self._entry_time = -LEASE
                    case ReadRoadmap():
                        self._reading.failed()
                yield SetTimer(_Due(), now + PAUSE)

    # Messages

    def _receive(self, message: Message, now: float) -> Effects:
        request = self._sent.pop(message.header.relates_to or "", None)
        match message.body:
            case RoadmapPage() as page if isinstance(request, ReadRoadmap):
                yield from self._read_page(page, request, now)
            case TrafficEntered() as answer if isinstance(request, EnterTraffic | ReportPlace):
                yield from self._take_part(answer, request, now)
            case TripBegun():
                pass
            case Fault() as fault if request is not None:
                yield from self._refused(fault, request, now)
            case Granted() | PassageOpen() | PassageClosed() | TripEnded() | RoadmapReplaced() as body:
                yield from self._follow_traffic(body, now)
            case _ if request is None:
                yield from refuse_request(message, "traffic tells a robot where it may drive")

    def _follow_traffic(self, body: Body, now: float) -> Effects:
        participant = self._participant
        if participant is None or not participant.fence:
            return
        match body:
            case Granted() as grant if participant.granted(grant):
                if participant.way and self._mobility is not Mobility.FREE:
                    yield self._report()  # it was granted before the robot had said that it works: it is given back
                yield from self._go_on()
            case PassageOpen() as notice:
                participant.opened(notice)
                yield from self._go_on()
            case PassageClosed() as notice if participant.is_refused(notice):
                yield from self._give_way_back()
            case TripEnded(trip=trip) if self._trip is not None and trip == self._trip.trip:
                self._trip = None
                yield from self._note_held_up(HeldUp())
                yield self._ask(TripOver(trip, ended=body))
            case RoadmapReplaced(fence=fence) if fence == participant.fence:
                self._participant = None
                yield self._read_roadmap(now)

    def _refused(self, fault: Fault, request: Body, now: float) -> Effects:
        match request:
            case RequestTrip(trip=trip) if self._trip is not None and trip == self._trip.trip:
                self._trip = None
                yield self._ask(TripOver(trip, refusal=fault.text))
            case ReportPlace() if self._participant is not None and request.fence == self._participant.fence:
                yield from self._locate(now)
            case EnterTraffic():
                self._is_entering = False
                self._refusals += 1
                if self._refusals == 1:
                    yield self._ask(Complaint(fault.text))
                self._participant = None
                yield SetTimer(_Due(), now + PAUSE)
            case ReadRoadmap():
                self._reading.failed()
                yield SetTimer(_Due(), now + PAUSE)

    # Entering

    def _read_roadmap(self, now: float) -> Send:
        """Read the roadmap anew."""
        return self._send(self._reading.begin(now))

    def _read_page(self, page: RoadmapPage, request: ReadRoadmap, now: float) -> Effects:
        if not self._reading.is_under_way:
            return
        following = self._reading.take(page, request, now)
        if following is not None:
            yield self._send(following)
        elif not self._reading.is_under_way:
            yield from self._locate(now)

    def _locate(self, now: float) -> Effects:
        """Find out where the robot is, and enter there; as soon as the roadmap is known."""
        if self._locating is not None:
            yield Withdraw(self._locating)
        self._participant = self._locating = None
        if self._reading.roadmap is None:
            if not self._reading.is_under_way:
                yield self._read_roadmap(now)
            return
        if not self._reading.roadmap.places:
            yield SetTimer(_Due(), now + PAUSE)  # nobody has said yet that there are robots
            return
        self._question_count += 1
        self._locating = _Question(self._question_count)
        yield Ask(self._locating, Locate(self._reading.roadmap))

    def _enter(self, value: object, now: float) -> Effects:
        if not isinstance(value, Standing):
            yield SetTimer(_Due(), now + PAUSE)
            return
        roadmap = self._reading.roadmap
        assert roadmap is not None, "it was located by one"
        self._participant = Participant(self._robot, value.place, value.towards)
        self._halts = max(self._halts, value.halts)
        self._is_requested = False
        entry = self._participant.enter(LEASE, value.berths, self._mobility)
        self._is_entering, self._entry_time = True, now
        yield self._send(structs.replace(entry, edition=roadmap.edition))

    def _take_part(self, answer: TrafficEntered, request: EnterTraffic | ReportPlace, now: float) -> Effects:
        participant = self._participant
        if participant is None:
            return
        yield SetTimer(_Due(), now + (PAUSE if self._waits else answer.renew_within / 2))
        if isinstance(request, EnterTraffic) and participant.entered(answer):
            self._refusals = self._returning = 0
            self._is_entering = False
            self._number += 1
            self._told = ()
            yield from self._go_on()
        elif isinstance(request, ReportPlace) and request.number == self._returning:
            self._returning = 0
            yield self._report()
        yield from self._request_trip()
        yield from self._note_held_up(HeldUp(answer.passage, answer.waits_for) if self._waits else HeldUp())

    def _try_again(self, now: float) -> Effects:
        participant = self._participant
        yield SetTimer(_Due(), now + PAUSE)
        if participant is not None and participant.fence:
            if not self._is_silent:
                yield self._report()
            yield SetTimer(_Due(), now + LEASE / 3)
        elif self._locating is not None or (self._is_entering and now < self._entry_time + LEASE):
            pass  # it is about to enter
        elif self._reading.is_under_way:
            request = self._reading.continued(now)
            if request is not None:
                yield self._send(request)
        elif self._is_entering or self._refusals % 2:
            yield from self._locate(now)
        else:
            yield self._read_roadmap(now)

    # Trips

    def _notice(self, notice: object, now: float) -> Effects:
        match notice:
            case TripWanted():
                self._trip, self._is_requested = notice, False
                yield from self._request_trip()
                yield SetTimer(_Due(), now + PAUSE)
            case TripGivenUp(halts):
                self._halts, self._told = max(self._halts, halts), ()
                yield from self._give_up()
            case PlacePassed(number, mobility):
                self._mobility = mobility or self._mobility  # in the same report: nobody has the robot leave where it is to work
                yield from self._pass(number)
            case MobilityChanged(mobility) if mobility is not self._mobility:
                self._mobility = mobility
                if self._participant is not None and self._participant.fence:
                    yield self._report()
                    yield from self._go_on()
            case SilenceChanged(is_silent):
                self._is_silent = is_silent
                if not is_silent and self._participant is not None and self._participant.fence:
                    yield self._report()
            case Astray():
                yield from self._locate(now)

    def _request_trip(self) -> Effects:
        participant, trip = self._participant, self._trip
        if participant is not None and participant.fence and trip is not None and not self._is_requested:
            self._is_requested = True
            yield self._send(participant.request(trip.trip, trip.stop))

    def _give_up(self) -> Effects:
        participant, trip = self._participant, self._trip
        self._trip = None
        if participant is None or not participant.fence:
            return
        if trip is not None and self._is_requested:
            yield self._send(participant.cancel(trip.trip), is_answered=False)
        yield from self._give_way_back()
        yield from self._go_on()

    def _give_way_back(self) -> Effects:
        """Give back the way to which the robot has not departed: busy, and free again after the answer."""
        if self._participant is not None and self._mobility is Mobility.FREE:
            report = self._participant.report(Mobility.BUSY)
            self._returning = report.number
            yield self._send(report)
            yield from self._go_on()

    # Driving

    @property
    def _waits(self) -> bool:
        """Whether the robot has a trip, and stands where it may not go on yet."""
        return self._trip is not None and self._participant is not None and self._participant.towards is None

    def _note_held_up(self, held_up: HeldUp) -> Effects:
        if held_up != self._held_up:
            self._held_up = held_up
            yield self._ask(held_up)

    def _pass(self, number: int) -> Effects:
        participant, has_moved = self._participant, False
        while participant is not None and participant.fence and self._number < number:
            if participant.towards is None and not (participant.may_depart and participant.depart()):
                break  # farther than it may drive: it is believed when it was granted
            participant.arrive()
            self._number += 1
            has_moved = True
        if has_moved:
            yield self._report()
            yield from self._go_on()

    def _go_on(self) -> Effects:
        """Have the robot follow its way, if that has changed."""
        participant = self._participant
        if participant is None or not participant.fence:
            return
        if participant.may_depart and self._mobility is Mobility.FREE:
            participant.depart()
        released = [participant.place, *([participant.towards] if participant.towards is not None else []), *participant.open_way]
        names = [*released, *participant.way[len(participant.open_way) :], *participant.planned]
        way = tuple(WayPlace(self._number + index, name, index < len(released)) for index, name in enumerate(names))
        if way != self._told:
            self._told = way
            yield self._ask(Follow(way, self._halts))
        if not self._waits:
            yield from self._note_held_up(HeldUp())

    def _report(self) -> Send:
        assert self._participant is not None, "only who takes part reports"
        mobility = Mobility.BUSY if self._returning else self._mobility
        return self._send(self._participant.report(mobility))

    def _ask(self, task: object) -> Ask:
        self._question_count += 1
        return Ask(_Question(self._question_count), task)

    def _send(self, body: Body, *, is_answered: bool = True) -> Send:
        self._message_count += 1
        id = f"urn:robot:{self._life}:{self._message_count}"
        if is_answered:
            self._sent = {**dict([*self._sent.items()][-MOST_UNANSWERED:]), id: body}
        header = Header(sender=self._address, recipient=self._traffic, message_id=id, reply_to=self._address)
        return Send(Message(header=header, body=body))
