"""What the program of a robot in traffic asks its hardware for, and what it is notified of."""

from __future__ import annotations

from msgspec import Struct

from somrs.protocol.messages.traffic import Berth, Mobility, RoadmapPlace, TripEnded

# What the program asks the hardware for


class RoadmapRead(Struct, frozen=True):
    """The places and lanes of an edition of the roadmap."""

    edition: int
    places: tuple[RoadmapPlace, ...]


class Locate(Struct, frozen=True):
    """Find out where the robot stands on the roadmap; answered by Standing, as soon as it stands."""

    roadmap: RoadmapRead


class Standing(Struct, frozen=True, kw_only=True):
    """Where a robot is: at a place or a berth, or on its way from there to the next one. `halts`: as of `Follow`."""

    place: str
    towards: str | None = None
    berths: tuple[Berth, ...] = ()
    halts: int = 0


class WayPlace(Struct, frozen=True):
    """A place on the way, with its number. `released`: the robot may drive there."""

    number: int
    name: str
    released: bool


class Follow(Struct, frozen=True):
    """Drive along these places, of which the first is where the robot is or was last; answered at once.

    `halts`: how often the robot has been told to stand still, as far as the program knows. A way from before the last time is not
    followed: the robot gives it back.
    """

    way: tuple[WayPlace, ...]
    halts: int = 0


class TripOver(Struct, frozen=True):
    """A trip has ended, or was refused for a reason."""

    trip: str
    ended: TripEnded | None = None
    refusal: str = ""


class HeldUp(Struct, frozen=True):
    """What keeps the robot from going on: a lift or a door that is not open for it (`passage`), or the robots that go first; nothing, if
    it can."""

    passage: str | None = None
    robots: tuple[str, ...] = ()

    @property
    def reason(self) -> str | None:
        """Why the robot waits, for people; None if it does not."""
        if self.passage is not None:
            return f"{self.passage} is not open yet"
        return "; ".join(f"{robot} goes first" for robot in self.robots) or None


class Complaint(Struct, frozen=True):
    """Traffic does not take the robot, for this reason."""

    text: str


# What the hardware notifies the program of


class TripWanted(Struct, frozen=True):
    """The robot wants to go to a place, or to a berth of its own."""

    trip: str
    stop: Berth | str


class TripGivenUp(Struct, frozen=True):
    """The robot does not want to go on with its trip, and stands. `halts`: as of `Follow`."""

    halts: int = 0


class PlacePassed(Struct, frozen=True):
    """The robot has come to the place of this number, or past it. `mobility`: whether it can make room from now on; None: as it was."""

    number: int
    mobility: Mobility | None = None


class MobilityChanged(Struct, frozen=True):
    """Whether the robot can make room."""

    mobility: Mobility


class SilenceChanged(Struct, frozen=True):
    """Whether nothing is heard of the robot: then nobody says where it is, and traffic takes it to be silent when its lease ends."""

    is_silent: bool


class Astray(Struct, frozen=True):
    """The robot is not where traffic has it, or cannot drive on from there: it enters anew."""
