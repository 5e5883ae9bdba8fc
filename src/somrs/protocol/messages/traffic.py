"""The bodies of the traffic protocol: robots enter, ask for trips, drive where they are granted places, and say where they are; lifts and
doors are called for them, and say when they are open.

A robot has a *fence*, a number that grows each time it enters: a message with an earlier one comes from before, and is refused. A roadmap
has an *edition*, a number that grows each time it is made: names of places are those of one edition.
"""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.protocol.messages.body import MessageBody


class Mobility(StrEnum):
    """Whether a robot can make room for others."""

    FREE = "free"
    """It drives where it is granted places, with and without a trip."""
    BUSY = "busy"
    """It works where it is, and will be free again: others wait, or take another way."""
    IMMOBILE = "immobile"
    """It cannot move, until somebody mends it: what it stands in is closed."""


class Berth(Struct, frozen=True, kw_only=True):
    """A point beside the roadmap at which a robot stands, such as one from which it reaches a table. It is a place for this robot alone.

    `name`: begins with the name of the robot and `/`, and stands for one point as long as the berth is used. `x`, `y`, in metres on the
    map. `radius`: that of the robot, in metres. `places`: the places of the roadmap from which the robot drives there in a straight line,
    and back; none of them is farther away than the spacing of the roadmap.
    """

    name: str
    x: float
    y: float
    radius: float
    places: tuple[str, ...]


class EnterTraffic(MessageBody, frozen=True, kw_only=True, tag=True):
    """The robot is at a place of the roadmap, and takes part. It renews its lease with each report, within `lease` seconds.

    `towards`: the next place, if the robot is on its way there. `berths`: those of the two that are beside the roadmap. A robot that enters
    again, after a restart, gives back all other places. `edition`: that of the roadmap which the robot has read; it is refused if there is
    another one. Sent by the robot, which is the sender.
    """

    robot: str
    place: str
    towards: str | None = None
    berths: tuple[Berth, ...] = ()
    lease: float
    mobility: Mobility = Mobility.FREE
    edition: int | None = None


class TrafficEntered(MessageBody, frozen=True, kw_only=True, tag=True):
    """The robot holds its place. `until`: the end of its lease, on the clock of traffic; report at least every `renew_within` seconds.

    For one that has not moved since its last report and wants to, `passage`: the lift or the door that is not open for it; `waits_for`:
    the robots that go first.
    """

    robot: str
    fence: int
    until: float
    renew_within: float
    passage: str | None = None
    waits_for: tuple[str, ...] = ()


class ReportPlace(MessageBody, frozen=True, kw_only=True, tag=True):
    """The robot is at this place, the last one that it has come to, or `between` it and the next one. It gives back the places before it,
    and, if it is not free, those that it does not need. The answer is TrafficEntered.

    `number` grows with each report and each request of the robot, because messages may overtake each other. `grant`: the number of the last
    grant that the robot has; it gives back no places of later ones. `progress`: how many places the robot has come to since it entered.
    """

    robot: str
    fence: int
    number: int
    grant: int
    progress: int
    place: str
    between: bool = False
    mobility: Mobility = Mobility.FREE


class RequestTrip(MessageBody, frozen=True, kw_only=True, tag=True):
    """Bring the robot to this place. A new trip replaces the one before. The answer is TripBegun, and TripEnded follows.

    `number` grows with each report and each request of the robot. `berth`: the destination, if it is beside the roadmap.
    """

    robot: str
    fence: int
    number: int
    trip: str
    destination: str
    berth: Berth | None = None


class TripBegun(MessageBody, frozen=True, kw_only=True, tag=True):
    """`length`: the seconds that the robot would take if nobody were in its way."""

    trip: str
    length: float


class CancelTrip(MessageBody, frozen=True, kw_only=True, tag=True):
    """The robot does not want to go there any more. Nothing is answered; the places that it holds stay granted."""

    robot: str
    fence: int
    trip: str


class TripResult(StrEnum):
    """How a trip ended."""

    ARRIVED = "arrived"
    CLOSED = "closed"
    """Robots that cannot move stand in all ways, or where others would have to make room; or a passage is out of order."""
    NO_ROOM = "no room"
    """The robots that stand in the way have no room to let this one pass, wherever they and the others go."""
    IMMOBILE = "immobile"
    """The robot itself cannot move."""


class TripEnded(MessageBody, frozen=True, kw_only=True, tag=True):
    """The trip is over. `robots`: those that are in the way; `passages`: the lifts and doors on the way that are out of order;
    `zones`: the no-go zones on it."""

    robot: str
    trip: str
    result: TripResult
    robots: tuple[str, ...] = ()
    passages: tuple[str, ...] = ()
    zones: tuple[str, ...] = ()


class Granted(MessageBody, frozen=True, kw_only=True, tag=True):
    """The robot may drive along this way, up to its last place. A later grant, with a higher number, replaces it. Robots without a trip are
    granted ways, too, to make room for others.

    The first place is where the robot was by its last report; `progress` is that of this report, so that the place at which it is now is
    found even if a way leads to it twice.

    `gated`: the places of `way` before which a lift or automatic doors have to be open, by their numbers, where 1 is the place after the
    first: the robot waits for PassageOpen before it departs to them.

    `planned`: the places to which it will be sent after these, as the plan is now; that may change, and it may not drive there yet.
    """

    robot: str
    fence: int
    number: int
    progress: int
    way: tuple[str, ...]
    gated: tuple[int, ...] = ()
    planned: tuple[str, ...] = ()


class PassageOpen(MessageBody, frozen=True, kw_only=True, tag=True):
    """The cabin of the lift `passage` is there with open doors, or the automatic door `passage` is open: the robot may come to `place`, the
    next one of its way. It stays open until the robot has reported that place, and so on.

    Sent for each place that is `gated` in Granted; after a ride, the robot is at `place` without having moved. `progress`: how many places
    the robot had come to by its last report, and `report` the number of that report. A robot that gives its way back forgets it, and
    ignores one whose `report` is an earlier one than that with which it gave its way back: it was sent before.
    """

    robot: str
    fence: int
    progress: int
    passage: str
    place: str
    report: int = 0


class PassageClosed(MessageBody, frozen=True, kw_only=True, tag=True):
    """Nobody enters `passage` now, through which the way leads to `place`, the next one of the robot's way: a robot that has not departed
    gives its way back. It is out of order, or its program does not answer. `progress`: as in PassageOpen."""

    robot: str
    fence: int
    progress: int
    passage: str
    place: str


class EnterPassage(MessageBody, frozen=True, kw_only=True, tag=True):
    """The program of a lift or of an automatic door, which is its sender, moves it for robots. It renews its lease with each report, within
    `lease` seconds. `passage`: the name on the map. The answer is PassageEntered."""

    passage: str
    lease: float


class PassageEntered(MessageBody, frozen=True, kw_only=True, tag=True):
    """Traffic calls the passage when robots need it. `fence`: grows each time it enters; `until`, `renew_within`: as in TrafficEntered."""

    passage: str
    fence: int
    until: float
    renew_within: float


class ReportPassage(MessageBody, frozen=True, kw_only=True, tag=True):
    """How the passage is now: whenever something of it changes, and to renew the lease. The answer is PassageEntered.

    `number` grows with each report. `call`: the number of the last CallPassage or ReleasePassage that the program follows. `level`: the
    height of the floor at which the cabin of a lift stands, none while it moves. `open`: robots can drive through its doors there; they
    stay open until the next call or release. `working`: it has no fault and is in service. `shared`: people or other systems use it now, so
    that robots wait.
    """

    passage: str
    fence: int
    number: int
    call: int
    level: float | None = None
    open: bool = False
    working: bool = True
    shared: bool = False


class CallPassage(MessageBody, frozen=True, kw_only=True, tag=True):
    """Robots need the passage: a door is to be open; a lift is to take its cabin to the floor of the height `level`, and to keep its doors
    open there. It stays so until the next call, or ReleasePassage.

    `robots`: those of a lift. `destination`: the height of the floor to which their ride leads, as far as it is known. `number` grows with
    each call and each release; the last one counts.
    """

    passage: str
    fence: int
    number: int
    level: float | None = None
    destination: float | None = None
    robots: tuple[str, ...] = ()


class ReleasePassage(MessageBody, frozen=True, kw_only=True, tag=True):
    """No robot needs the passage any more: it may shut its doors, and others may use it. `number`: as in CallPassage."""

    passage: str
    fence: int
    number: int


class LeaveTraffic(MessageBody, frozen=True, kw_only=True, tag=True):
    """The robot was taken away: it is at no place of the roadmap any more. The answer is TrafficLeft."""

    robot: str


class TrafficLeft(MessageBody, frozen=True, kw_only=True, tag=True):
    robot: str


class ReadRoadmap(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the places and lanes, page by page. `after`: `next` of the page before."""

    after: int = 0


class RoadmapLane(Struct, frozen=True, kw_only=True):
    """A lane to the place `end`. `seconds`: how long a robot is taken to need. `closed`: nobody is sent there now. `passages`: the lift,
    and the automatic doors, that have to be open: the robot waits for PassageOpen before it departs. `speed_limit`: the highest speed
    there, in metres per second. `travel`: Forward or Backward, if the robot may not choose how it drives."""

    end: str
    seconds: float
    closed: bool = False
    passages: tuple[str, ...] = ()
    speed_limit: float | None = None
    travel: str | None = None


class RoadmapPlace(Struct, frozen=True, kw_only=True):
    """A place, with its coordinates on the map in metres, and the lanes that begin there.

    `level`: the height of its floor. `radius`: of the largest robots for which it is. `zone`: the lift, or other area for one robot at a
    time, of which it is a part. A lane to a place on another level is a ride in that lift. `closed`: nobody is sent there now. `graph`: of
    the robots for which it is, those that keep to the lanes of this navigation graph; without one, those that drive where there is room.
    `passthrough`: robots with nothing to do go on from there.
    """

    name: str
    x: float
    y: float
    level: float = 0.0
    radius: float = 0.0
    zone: str | None = None
    lanes: tuple[RoadmapLane, ...] = ()
    closed: bool = False
    graph: str | None = None
    passthrough: bool = False


class RoadmapPage(MessageBody, frozen=True, kw_only=True, tag=True):
    """A part of the roadmap of this edition. If another page has another edition, the roadmap was made anew meanwhile: begin again."""

    edition: int
    places: tuple[RoadmapPlace, ...] = ()
    next: int = 0
    more: bool = False


class RoadmapReplaced(MessageBody, frozen=True, kw_only=True, tag=True):
    """The building has changed, and there is a new roadmap: the robot takes part no more, until it enters anew. It may drive to the end of
    the way that it was granted before, where others keep away from it. Sent to each robot that took part."""

    robot: str
    fence: int
    edition: int


class ReadTraffic(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read where all robots are, what they hold, and whom they wait for."""


class RobotInTraffic(Struct, frozen=True, kw_only=True):
    """A robot: the places that it holds (the first is where it is), those planned after them, and the robots that have to go first: by the
    plan, or because they stand in its way and none is planned.

    `silent`: its lease has ended, and nobody knows where on its way it is. `passage`: the lift or the door that it waits for, or the lift
    in which it is (`inside`).
    """

    robot: str
    held: tuple[str, ...]
    planned: tuple[str, ...] = ()
    waits_for: tuple[str, ...] = ()
    mobility: Mobility = Mobility.FREE
    silent: bool = False
    trip: str | None = None
    destination: str | None = None
    passage: str | None = None
    inside: bool = False


class PassageInTraffic(Struct, frozen=True, kw_only=True):
    """A lift or an automatic door, as its program has reported it. `usable`: robots are let in. `silent`: its program does not answer, or
    has not entered. `robots`: those for which it is called."""

    passage: str
    usable: bool
    silent: bool
    level: float | None = None
    open: bool = False
    shared: bool = False
    robots: tuple[str, ...] = ()


class TrafficView(MessageBody, frozen=True, kw_only=True, tag=True):
    robots: tuple[RobotInTraffic, ...]
    berths: tuple[Berth, ...] = ()
    """The points beside the roadmap that have names in it."""
    passages: tuple[PassageInTraffic, ...] = ()
    """The lifts and automatic doors of the roadmap."""
    hold: str = ""
    """Why nobody is granted a way; empty if traffic is not held."""
    edition: int = 0
    """That of the roadmap."""
    roadmap: int = 0
    """Another number after each change of the roadmap, and of what of it is closed."""
