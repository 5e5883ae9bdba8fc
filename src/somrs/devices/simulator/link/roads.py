"""What an operator sees of traffic: the roadmap, and where robots may drive and whom they wait for. Plain values, in lines of the link."""

from __future__ import annotations

from collections.abc import Callable, Collection

from msgspec import Struct

from somrs.protocol.messages.traffic import Mobility
from somrs.protocol.messages.traffic import RobotInTraffic as RobotView

DIGITS = 2
"""Decimal digits of points: a way is drawn to a centimetre."""

RoadPoint = tuple[float, float, float]
"""x, y, and the height of the floor, m."""

PointOf = Callable[[str], RoadPoint]
"""Where the place or berth of a name is."""


class Roadmap(Struct, frozen=True, kw_only=True):
    """The roadmap, and what of it is closed now.

    `number` is another one after each change of the roadmap or of what is closed. `lanes`: each once, by the positions of its ends in
    `places`, counted from 0, whether it leads in one direction or in both. `one_way`: those of one direction, from the place where they
    begin. `closed_places`, `closed_lanes`: the positions, in these, of those that nobody uses.
    """

    number: int
    places: tuple[RoadPoint, ...]
    lanes: tuple[tuple[int, int], ...]
    one_way: tuple[tuple[int, int], ...] = ()
    closed_places: tuple[int, ...] = ()
    closed_lanes: tuple[int, ...] = ()


class RobotInTraffic(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A robot that takes part in traffic, or cannot (`refusal`).

    `granted`: the way along which it may drive, from the place where it is; `planned`: on from there, as far as it is planned;
    `destination`: the end of its trip, if it has one. `waits_for`: the robots that go before it, if it was granted nothing; `lift`: the
    lift or the door that it waits for, or the lift that it is in. `command`: what it carries out, and `object`: with what; `paused`: an
    operator has stopped it.
    """

    granted: tuple[RoadPoint, ...] = ()
    planned: tuple[RoadPoint, ...] = ()
    destination: RoadPoint | None = None
    waits_for: tuple[str, ...] = ()
    lift: str | None = None
    riding: bool = False
    """Whether it is in the lift."""
    mobility: Mobility = Mobility.FREE
    silent: bool = False
    paused: bool = False
    command: str | None = None
    object: str | None = None
    refusal: str = ""


class TrafficState(Struct, frozen=True, kw_only=True):
    """Traffic now: the number of the `roadmap`, the robots by name, why nobody is granted a way (`hold`), the lifts and automatic doors
    that nobody may enter, and those that people or other systems use."""

    roadmap: int
    robots: dict[str, RobotInTraffic]
    hold: str = ""
    closed_lifts: tuple[str, ...] = ()
    shared_lifts: tuple[str, ...] = ()


def undirected(directed: Collection[tuple[int, int]]) -> tuple[tuple[tuple[int, int], ...], tuple[tuple[int, int], ...]]:
    """The `lanes` and the `one_way` of a roadmap with these directed lanes."""
    lanes = sorted({(min(lane), max(lane)) for lane in directed})
    return tuple(lanes), tuple(sorted(lane for lane in directed if lane[::-1] not in directed))


def road_point(x: float, y: float, level: float) -> RoadPoint:
    """A point, for people."""
    return round(x, DIGITS), round(y, DIGITS), round(level, DIGITS)


def driving(view: RobotView, point: PointOf) -> RobotInTraffic:
    """What traffic knows of a robot."""
    return RobotInTraffic(
        granted=tuple(map(point, view.held)),
        planned=tuple(map(point, view.planned)),
        destination=point(view.destination) if view.destination is not None else None,
        waits_for=view.waits_for if len(view.held) == 1 else (),
        lift=view.passage,
        riding=view.inside,
        mobility=view.mobility,
        silent=view.silent,
    )
