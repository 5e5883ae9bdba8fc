"""The robot's side of the traffic protocol: what a robot says, and what it is granted. For programs that drive robots."""

from __future__ import annotations

from somrs.protocol.messages.traffic import (
    Berth,
    CancelTrip,
    EnterTraffic,
    Granted,
    Mobility,
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
        self._message_count = self._grant = self._progress = 0

    def enter(self, lease: float, berths: tuple[Berth, ...] = (), mobility: Mobility = Mobility.FREE) -> EnterTraffic:
        """Take part, from where the robot is. `lease`: in seconds."""
        return EnterTraffic(robot=self.robot, place=self.place, towards=self.towards, berths=berths, lease=lease, mobility=mobility)

    def entered(self, answer: TrafficEntered) -> bool:
        """Note an answer to a message of this participant. Returns whether it is the first one to an entry.

        One to a program of the robot that has ended must not be passed on: its fence is an earlier one.
        """
        if answer.fence <= self.fence:
            return False
        self.fence, self.way, self._grant, self._progress = answer.fence, (), 0, 0
        return True

    def granted(self, grant: Granted) -> bool:
        """Note a grant. Returns whether it is new."""
        if grant.fence != self.fence or grant.number <= self._grant:
            return False
        self._grant = grant.number
        self.way = grant.way[self._progress - grant.progress + (self.towards is not None) + 1 :]
        return True

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
        """Say where the robot is: after each arrival, when its mobility changes, and to renew its lease."""
        return ReportPlace(
            robot=self.robot,
            fence=self.fence,
            number=self._number(),
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
