"""The state of traffic, as one tree of data; its timers, and the work that its program does for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import chain

from msgspec import Struct, field, structs

from somrs.protocol.messages.traffic import Mobility
from somrs.traffic.notices import ClosedLane, CloseWays
from somrs.traffic.passage_call import PassageCall
from somrs.traffic.roadmap import Roadmap, UsedBerth

MOST_CLOSINGS = 2**20
"""With editions that are seconds, numbers of roadmaps stay smaller than 2**53, which other programs read exactly."""


class LeasesDue(Struct, frozen=True, tag=True):
    """The next lease expires."""


class PlanDue(Struct, frozen=True, tag=True):
    """Time has passed since the last plan, so that the next one may be asked for."""


Timer = LeasesDue | PlanDue


class Trip(Struct, kw_only=True):
    """A robot's trip to the place of this number. `nearest`: the least distance at which its granted ways have ended, in seconds;
    `progressed_at`: since when that is so."""

    id: str
    destination: int
    since: float
    nearest: float
    progressed_at: float


class RobotRecord(Struct, kw_only=True):
    """A robot that takes part.

    `silent`: its lease has ended. `grants`: how often it was granted places. `progress`: how many places it has come to since it entered;
    `moved_at`: when it came to the last one. `reported`, `requested`: the numbers of its last report and of its last request. `told`: what
    it was told last of the passage on its way.
    """

    address: str
    fence: int
    lease: float
    expires_at: float
    mobility: Mobility
    silent: bool = False
    trip: Trip | None = None
    grants: int = 0
    progress: int = 0
    moved_at: float = 0.0
    reported: int = 0
    requested: int = 0
    told: PassageNotice | None = None

    @property
    def is_fixed(self) -> bool:
        """Whether it cannot move, or does not say that it can."""
        return self.silent or self.mobility is Mobility.IMMOBILE


class PassageNotice(Struct, frozen=True, array_like=True):
    """A robot was told that the passage before the next place of its way is open, or that it is closed. `progress`: how many places it had
    come to."""

    progress: int
    place: int
    is_open: bool


class PassageRecord(Struct, kw_only=True):
    """A lift or an automatic door whose program takes part.

    `silent`: its lease has ended. `calls`: the number of the last message to it; `call`: what it is called for, None if it is released;
    `since`: the number from which on it has been called for this floor and this robot. `reported`: the number of its last report, the
    other values of which follow; `followed`: the number of the call that it follows.
    """

    address: str
    fence: int
    lease: float
    expires_at: float
    silent: bool = False
    calls: int = 0
    call: PassageCall | None = None
    since: int = 0
    reported: int = 0
    followed: int = 0
    level: float | None = None
    open: bool = False
    working: bool = False
    shared: bool = False


class PlanQuestion(Struct, frozen=True, tag=True):
    """Which plan is asked for."""

    serial: int


class PlannedRobot(Struct, frozen=True, array_like=True):
    """A robot in a problem. The meaning is that of `Traveller`."""

    name: str
    place: int
    goal: int | None
    waiting: float
    nearest: float
    movable: bool
    busy: bool
    held_up: bool = False
    stalled: bool = False
    begins: bool = False


class OutOfOrder(Struct, frozen=True, array_like=True):
    """A lift or a door that nobody enters, or a no-go zone (`is_zone`), with its places and lanes."""

    name: str
    places: tuple[int, ...]
    lanes: tuple[tuple[int, int], ...]
    is_zone: bool = False


def names_of(passages: Iterable[OutOfOrder]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names of the lifts and doors, and those of the zones."""
    closed_passages = [*passages]
    return tuple(passage.name for passage in closed_passages if not passage.is_zone), tuple(
        passage.name for passage in closed_passages if passage.is_zone
    )


class Closed(Struct, frozen=True, array_like=True):
    """Places and lanes that are closed: because of what stands there, and through passages that are out of order."""

    places: tuple[int, ...] = ()
    lanes: tuple[tuple[int, int], ...] = ()
    passages: tuple[OutOfOrder, ...] = ()

    @property
    def all_places(self) -> set[int]:
        return {*self.places, *(place for passage in self.passages for place in passage.places)}

    @property
    def all_lanes(self) -> set[tuple[int, int]]:
        return {*self.lanes, *(lane for passage in self.passages for lane in passage.lanes)}


def closed_by(body: CloseWays, number: Callable[[str], int]) -> Closed:
    """What is closed by a notice. `number`: that of the place of a name."""

    def lanes(closed: tuple[ClosedLane, ...]) -> tuple[tuple[int, int], ...]:
        return tuple((number(lane.start), number(lane.end)) for lane in closed)

    passages = (OutOfOrder(entry.name, tuple(map(number, entry.places)), lanes(entry.lanes), entry.zone) for entry in body.passages)
    return Closed(tuple(map(number, body.places)), lanes(body.lanes), tuple(passages))


class PlannedBerth(Struct, frozen=True, array_like=True):
    """A berth in a problem. The meaning is that of `PrivatePlace`."""

    robot: str
    lanes: tuple[tuple[int, float], ...]
    exclusions: tuple[int, ...]


class PlanTraffic(Struct, frozen=True, kw_only=True):
    """The next steps of all robots are to be planned. `blocked`: places held by robots
    that cannot move. `private`: the berths."""

    serial: int
    robots: tuple[PlannedRobot, ...]
    closed: Closed
    blocked: tuple[int, ...]
    private: tuple[PlannedBerth | None, ...]
    steps: int
    effort: int
    searches: bool


class Obstacle(Struct, frozen=True, kw_only=True):
    """What keeps a robot from its goal. The meaning is that of `Barrier`."""

    goal: int | None
    robots: tuple[str, ...]
    places: tuple[int, ...] = ()


class TrafficPlan(Struct, frozen=True, kw_only=True, tag=True):
    """The place of each robot at each step. `whole` and `stuck` are those of `Course`."""

    ways: dict[str, tuple[int, ...]]
    whole: bool = False
    stuck: dict[str, Obstacle] = field(default_factory=dict)


class Position(Struct, frozen=True, kw_only=True):
    """A point at which a robot may be, on the map, in metres. `level`: the height of its floor; `radius`: of the largest robot there;
    `zone`: the lift in which it is, or in whose doors."""

    x: float
    y: float
    level: float
    radius: float
    zone: str | None = None


class TrafficState(Struct, kw_only=True):
    """The state of traffic on a roadmap.

    `held` and `planned` belong to the schedule, `berths` to `Berths`. `serial` is that of the last plan that was asked for; `is_planning`:
    its answer is awaited. `changed`: robots, their trips or their mobility are others than in the last plan that was asked for. `whole`:
    what is planned is to be followed to its end. `hold`: why nobody is granted a way, if that is so. `edition`: that of the
    roadmap; `closings`: how often other places and lanes were closed on it; `is_roadmap_expected`: another one is about to
    come. `astray`: the robots that took part on the roadmap before and not on this one yet, with the points of the places that they held,
    in the order of their ways. `closed`: what follows from the map; `idle`: the passages that are closed because their programs do not take
    part, do not answer, or say that they do not work. `planned_at`: when the last plan was asked for; `granted_at`: when somebody was
    granted a place of one last. `failures`: how many of the last plans moved nobody.
    `searched_at`: when ways were searched for last because a robot had not come nearer to its goal; `searches`: how often that was.
    """

    address: str
    roadmap: Roadmap
    robots: dict[str, RobotRecord] = field(default_factory=dict)
    held: dict[str, list[int]] = field(default_factory=dict)
    planned: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    berths: list[UsedBerth | None] = field(default_factory=list)
    closed: Closed = Closed()
    idle: tuple[OutOfOrder, ...] = ()
    passages: dict[str, PassageRecord] = field(default_factory=dict)
    """The lifts and automatic doors whose programs take part, or have taken part."""
    entered: dict[str, int] = field(default_factory=dict)
    """The fences that were given, by the ids of the messages that asked for them, oldest first."""
    fences: int = 0
    sent: int = 0
    serial: int = 0
    is_planning: bool = False
    changed: bool = False
    whole: bool = False
    hold: str = ""
    edition: int = 0
    closings: int = 0
    is_roadmap_expected: bool = False
    astray: dict[str, tuple[Position, ...]] = field(default_factory=dict)
    planned_at: float = 0.0
    granted_at: float = 0.0
    failures: int = 0
    searched_at: float = 0.0
    searches: int = 0

    def extend_leases(self, now: float) -> None:
        """Traffic was started: while it was away, nobody could report."""
        records: tuple[RobotRecord | PassageRecord, ...] = (*self.robots.values(), *self.passages.values())
        for record in records:
            if not record.silent:
                record.expires_at = max(record.expires_at, now + record.lease)

    @property
    def used_places(self) -> set[int]:
        """The places that robots hold, or where they are to go."""
        goals = (record.trip.destination for record in self.robots.values() if record.trip is not None)
        planned = (place for places in self.planned.values() for _, place in places)
        return {*goals, *chain.from_iterable(self.held.values()), *planned}

    @property
    def all_closed(self) -> Closed:
        """What nobody is sent to, for whatever reason."""
        named = {passage.name for passage in self.closed.passages}
        idle = (passage for passage in self.idle if passage.name not in named)
        return structs.replace(self.closed, passages=(*self.closed.passages, *idle))

    @property
    def roadmap_number(self) -> int:
        """Another number after each change of the roadmap, and of what of it is closed."""
        return self.edition * MOST_CLOSINGS + self.closings % MOST_CLOSINGS
