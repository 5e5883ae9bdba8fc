"""What traffic learns from its own program, and from nobody else: the roadmap, what of it is closed, and whether traffic is held.

These are notices and no messages, because the sender of a message is whoever it says it is.
"""

from __future__ import annotations

from msgspec import Struct

from somrs.traffic.roadmap import Roadmap


class ClosedLane(Struct, frozen=True, kw_only=True):
    """A lane, in one direction, by the places at which it begins and ends."""

    start: str
    end: str


class ClosedPassage(Struct, frozen=True, kw_only=True):
    """A lift or a door that is out of order, or a no-go zone (`zone`), with the places and lanes to which nobody comes because of it."""

    name: str
    zone: bool = False
    places: tuple[str, ...] = ()
    lanes: tuple[ClosedLane, ...] = ()


class CloseWays(Struct, frozen=True, kw_only=True, tag=True):
    """These places and lanes are closed from now on, and all others are open: doors are shut, or things stand in the way; or they are ways
    through `passages` that are out of order, or into no-go zones. Robots that are there may leave."""

    places: tuple[str, ...] = ()
    lanes: tuple[ClosedLane, ...] = ()
    passages: tuple[ClosedPassage, ...] = ()


class HoldTraffic(Struct, frozen=True, kw_only=True, tag=True):
    """Nobody is granted a way from now on, such as in a fire. Robots stay where their granted ways end; their trips go on afterwards.
    Only those in zones, such as the cabin of a lift, are still granted their way out, and others make room for them if need be.

    `reason`: why, for users, such as `fire alarm in Building1`; without one, traffic goes on."""

    reason: str = ""


class RoadmapExpected(Struct, frozen=True, tag=True):
    """Whether the program is about to replace the roadmap. Meanwhile nobody is granted anything, so that robots are no farther than
    known."""

    is_expected: bool


class RoadmapMade(Struct, frozen=True, kw_only=True, tag=True):
    """The program has made a new roadmap, because the building has changed; `closing` is closed on it."""

    roadmap: Roadmap
    closing: CloseWays


Notice = RoadmapExpected | RoadmapMade | CloseWays | HoldTraffic
