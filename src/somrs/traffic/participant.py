"""The other side of the traffic protocol: what robots and passages say, and what they are told. For programs that drive them."""

from __future__ import annotations

from somrs.protocol.messages.traffic import (
    Berth,
    CallPassage,
    CancelTrip,
    EnterPassage,
    EnterTraffic,
    Granted,
    Mobility,
    PassageClosed,
    PassageEntered,
    PassageOpen,
    ReleasePassage,
    ReportPassage,
    ReportPlace,
    RequestTrip,
    TrafficEntered,
)


class Participant:
    """A robot in traffic. `place`: the last one that it has come to; `towards`: the next one, if it is on its way there.

    The caller sends the messages that the methods return, passes on those that are received, and says when the robot departs and arrives.
    """

    def __init__(self, robot: str, place: str, towards: str | None = None) -> None:
        self.robot, self.place, self.towards = robot, place, towards
        self.fence = 0
        """The number of its entry; 0 before the first."""
        self.way: tuple[str, ...] = ()
        """The places up to which it may drive, after the one to which it is on its way."""
        self.planned: tuple[str, ...] = ()
        """The places after its way to which it will be sent, as the last grant says."""
        self._message_count = self._grant = self._progress = 0
        self._gated: frozenset[int] = frozenset()
        """The places of the way before which passages have to be open, by the progress with which it comes to them."""
        self._let_in: tuple[int, str] | None = None
        """To which place it may come through a passage, with the progress of that time."""
        self._returned = 0
        """The number of the report with which it gave its way back last."""

    def enter(self, lease: float, berths: tuple[Berth, ...] = (), mobility: Mobility = Mobility.FREE) -> EnterTraffic:
        """Take part, from where the robot is. `lease`: in seconds."""
        return EnterTraffic(robot=self.robot, place=self.place, towards=self.towards, berths=berths, lease=lease, mobility=mobility)

    def entered(self, answer: TrafficEntered) -> bool:
        """Note an answer to a message of this participant. Returns whether it is the first one to an entry.

        One to a program of the robot that has ended must not be passed on: its fence is an earlier one.
        """
        if answer.fence <= self.fence:
            return False
        self.fence, self.way, self._grant, self._progress, self._let_in, self._returned = answer.fence, (), 0, 0, None, 0
        return True

    def granted(self, grant: Granted) -> bool:
        """Note a grant. Returns whether it is new."""
        if grant.fence != self.fence or grant.number <= self._grant:
            return False
        self._grant = grant.number
        self.way = grant.way[self._progress - grant.progress + (self.towards is not None) + 1 :]
        self._gated = frozenset(grant.progress + number for number in grant.gated)
        self.planned = grant.planned
        return True

    def opened(self, notice: PassageOpen) -> bool:
        """Note that a passage is open. Returns whether the robot may depart."""
        if notice.fence == self.fence and notice.report >= self._returned:
            self._let_in = notice.progress, notice.place
        return self.may_depart

    def is_refused(self, notice: PassageClosed) -> bool:
        """Whether the way leads through a passage that is closed: then report busy, which gives the way back, and free after the answer."""
        is_next = self.towards is None and self.way[:1] == (notice.place,)
        return notice.fence == self.fence and notice.progress == self._progress and is_next

    @property
    def may_depart(self) -> bool:
        """Whether the robot was granted another place, and the passages before it are open."""
        if self.towards is not None or not self.way:
            return False
        return self._progress + 1 not in self._gated or self._let_in == (self._progress, self.way[0])

    @property
    def open_way(self) -> tuple[str, ...]:
        """The part of its way to which it may come without another message: up to the first passage for which it has to wait."""
        first = self._progress + (self.towards is not None) + 1
        closed = (index for index in range(len(self.way)) if first + index in self._gated)
        gate = next((index for index in closed if index or not self.may_depart), len(self.way))
        return self.way[:gate]

    def depart(self) -> str | None:
        """Drive to the next place that was granted, and return it; None if there is none."""
        if self.towards is None and self.way:
            self.towards, self.way = self.way[0], self.way[1:]
            return self.towards
        return None

    def arrive(self) -> None:
        """The robot has come to the place to which it was on its way."""
        assert self.towards is not None, "a robot departs first"
        self.place, self.towards = self.towards, None
        self._progress += 1

    def report(self, mobility: Mobility = Mobility.FREE) -> ReportPlace:
        """Say where the robot is: after each arrival, when its mobility changes, and to renew its lease. One that is not free gives back
        what it was granted."""
        number = self._number()
        if mobility is not Mobility.FREE:
            self.way, self.planned, self._let_in, self._returned = (), (), None, number
        return ReportPlace(
            robot=self.robot,
            fence=self.fence,
            number=number,
            grant=self._grant,
            progress=self._progress,
            place=self.place,
            between=self.towards is not None,
            mobility=mobility,
        )

    def request(self, trip: str, destination: str | Berth) -> RequestTrip:
        """Ask for a trip to a place of the roadmap, or to a berth."""
        berth = destination if isinstance(destination, Berth) else None
        name = destination.name if isinstance(destination, Berth) else destination
        return RequestTrip(robot=self.robot, fence=self.fence, number=self._number(), trip=trip, destination=name, berth=berth)

    def cancel(self, trip: str) -> CancelTrip:
        """Give a trip up."""
        return CancelTrip(robot=self.robot, fence=self.fence, trip=trip)

    def _number(self) -> int:
        self._message_count += 1
        return self._message_count


class PassageParticipant:
    """A lift or an automatic door in traffic. The caller sends the messages that the methods return, and passes on those that are
    received."""

    def __init__(self, passage: str) -> None:
        self.passage = passage
        self.fence = 0
        """The number of its entry; 0 before the first."""
        self.call: CallPassage | None = None
        """What it is called for; None if nobody needs it."""
        self.call_number = 0
        """That of the last call or release."""
        self._report_count = 0

    def enter(self, lease: float) -> EnterPassage:
        """Take part. `lease`: in seconds."""
        return EnterPassage(passage=self.passage, lease=lease)

    def entered(self, answer: PassageEntered) -> bool:
        """Note an answer to a message of this program. Returns whether it is the first one to an entry, after which traffic says what the
        passage is called for."""
        if answer.fence <= self.fence:
            return False
        self.fence, self.call, self.call_number = answer.fence, None, 0
        return True

    def called(self, body: CallPassage | ReleasePassage) -> bool:
        """Note a call or a release. Returns whether it is new."""
        if body.fence != self.fence or body.number <= self.call_number:
            return False
        self.call_number, self.call = body.number, body if isinstance(body, CallPassage) else None
        return True

    def report(self, *, is_open: bool, level: float | None = None, working: bool = True, shared: bool = False) -> ReportPassage:
        """Say how the passage is: whenever that changes, and to renew the lease. `is_open`: as the last call wants it, until the next
        one."""
        self._report_count += 1
        return ReportPassage(
            passage=self.passage,
            fence=self.fence,
            number=self._report_count,
            call=self.call_number,
            level=level,
            open=is_open,
            working=working,
            shared=shared,
        )
