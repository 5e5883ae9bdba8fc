"""The roadmap of a building: places where a robot can stand, and lanes between them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from somrs.errors import UsageError
from somrs.protocol.messages.traffic import Berth
from somrs.space.solids import Point, Solid
from somrs.space.squares import Squares, box_around
from somrs.traffic.planning.graph import Graph

GAP = 0.06
"""The least distance between two robots on their lanes, in metres: what they keep, and as much again for corners that they cut."""
ROUNDING = 1e-9
"""The share by which computed distances may differ."""


class RobotKind(NamedTuple):
    """Robots up to a `radius`, in metres, that use the lanes of a navigation graph; without one, they drive where there is room. A radius
    of 0 is for robots of any size."""

    radius: float = 0.0
    graph: str | None = None


class Place(Struct, frozen=True, kw_only=True):
    """A place, with its coordinates on the map in metres. `level`: the height of its floor. `zone`: the lift or area of which
    it is a part, in which only one robot may be at a time, on whatever floor; so for each of its `mutexes`. `radius`, `graph`: for which
    robots it is. `spacing`: no lane from there is longer, in metres; without one, that of the roadmap counts. `passthrough`: robots do not
    stay there when they have nothing to do."""

    name: str
    x: float
    y: float
    level: float = 0.0
    zone: str | None = None
    radius: float = 0.0
    spacing: float | None = None
    graph: str | None = None
    mutexes: tuple[str, ...] = ()
    passthrough: bool = False

    @property
    def kind(self) -> RobotKind:
        """The robots for which it is."""
        return RobotKind(self.radius, self.graph)


def spacing_for(radius: float) -> float:
    """The least spacing of places for robots of this radius, in metres."""
    return (2 * radius + GAP) * 2 / math.sqrt(3)


def least_distance(spacing: float, near_spacing: float) -> float:
    """The distance from which on robots at two places, and on the lanes from there, do not touch each other, in metres.

    Lanes are at most as long as the spacing. The middle of a lane comes nearest to a place that is equally far from its ends, and the
    robots need half of what each of their spacings leaves between two of them.
    """
    return math.hypot((spacing + near_spacing) * math.sqrt(3) / 4, max(spacing, near_spacing) / 2)


class Lane(Struct, frozen=True, kw_only=True):
    """A lane, in one direction. `seconds`: how long a robot takes for it. `speed_limit`: in metres per second. `travel`: Forward or
    Backward, if a robot may not choose."""

    start: str
    end: str
    seconds: float
    speed_limit: float | None = None
    travel: str | None = None


class Roadmap(Struct, frozen=True, kw_only=True):
    """Places and lanes. Robots at two places touch each other if these are nearer to each other than `spacing`, in metres, and on one
    floor. A lane between two floors is a ride in a lift. Places for robots of a certain size have a spacing of their own. `lifts`, which
    are zones, and `doors`, which are automatic, have programs: nobody is sent through them while these take no part. `graphs`: the
    navigation graphs of which the building has lanes."""

    places: tuple[Place, ...]
    lanes: tuple[Lane, ...]
    spacing: float = 0.0
    lifts: tuple[str, ...] = ()
    doors: tuple[Solid, ...] = ()
    graphs: tuple[str, ...] = ()

    def check(self) -> None:
        """Raises UsageError for a roadmap that cannot be used."""
        names = [place.name for place in self.places]
        known = set(names)
        if len(known) < len(names):
            raise UsageError(f"{next(name for name in names if names.count(name) > 1)} is the name of two places")
        for lane in self.lanes:
            for end in (lane.start, lane.end):
                if end not in known:
                    raise UsageError(f"a lane leads from {lane.start} to {lane.end}, and there is no place {end}")
            if not lane.seconds > 0:
                raise UsageError(f"the lane from {lane.start} to {lane.end} takes {lane.seconds} s; a lane takes more than 0 s")


class UsedBerth(Struct, frozen=True, kw_only=True):
    """A berth of a robot. `lanes`: the numbers of the places from which it drives there, with the seconds that it takes."""

    robot: str
    berth: Berth
    level: float
    lanes: tuple[tuple[int, float], ...]


@lru_cache(maxsize=2)
def numbered(roadmap: Roadmap) -> NumberedRoadmap:
    """The numbered roadmap, which all share that use the same roadmap. Raises UsageError for one that cannot be used."""
    return NumberedRoadmap(roadmap)


@dataclass(frozen=True, slots=True)
class Layer:
    """The places on a floor for robots of a kind: their numbers, their points, and their spacing in metres, which is how far robots look
    for one of them."""

    numbers: NDArray[np.int64]
    tree: cKDTree
    spacing: float

    def near(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The pairs of points (n, 2) and of places that are at most the spacing away: the indices of the points, and the numbers of the
        places."""
        near = self.tree.query_ball_point(points, self.spacing) if len(self.numbers) and len(points) else []
        counts = [len(places) for places in near]
        chosen = np.fromiter(chain.from_iterable(near), dtype=int, count=sum(counts))
        return np.repeat(np.arange(len(counts)), counts), self.numbers[chosen]


class NumberedRoadmap:
    """A roadmap with numbers in place of names, for the planner."""

    def __init__(self, roadmap: Roadmap) -> None:
        roadmap.check()
        self.roadmap = roadmap
        self.names = tuple(place.name for place in roadmap.places)
        self.numbers = {name: number for number, name in enumerate(self.names)}
        self.rules: dict[tuple[int, int], Lane] = {}
        """The lanes on which there are rules for driving, by their ends."""
        for lane in roadmap.lanes:
            if lane.speed_limit is not None or lane.travel is not None:
                self.rules[self.numbers[lane.start], self.numbers[lane.end]] = lane
        lanes = ((self.numbers[lane.start], self.numbers[lane.end], lane.seconds) for lane in roadmap.lanes)
        self.kinds = sorted({place.kind for place in roadmap.places}, key=lambda kind: kind.radius)
        """Those for which there are places, the smallest robots first."""
        self._spacings = [roadmap.spacing if place.spacing is None else place.spacing for place in roadmap.places]
        self.widest = max(self._spacings, default=roadmap.spacing)
        """The largest spacing, m."""
        self._squares = Squares[int](self.widest or 1.0)
        self.zones: dict[str, list[int]] = {}
        """The places of each zone."""
        self.passthrough = frozenset(number for number, place in enumerate(roadmap.places) if place.passthrough)
        """The places where robots do not stay when they have nothing to do."""
        self._mutexes: dict[str, list[int]] = {}
        """The places of each mutex."""
        for number, place in enumerate(roadmap.places):
            if place.zone is not None:
                self.zones.setdefault(place.zone, []).append(number)
            for mutex in place.mutexes:
                self._mutexes.setdefault(mutex, []).append(number)
        self.points = np.array([(place.x, place.y) for place in roadmap.places], dtype=float).reshape(-1, 2)
        """Of the places, m."""
        self._layers: dict[tuple[float, RobotKind], Layer] = {}
        """By level and kind of robots."""
        self.graph = Graph(len(self.names), lanes, self._conflicts())

    def number(self, place: str) -> int:
        """Raises UsageError for a place that is not on the roadmap."""
        if place not in self.numbers:
            raise UsageError(f"there is no place {place} on the roadmap")
        return self.numbers[place]

    def kind_for(self, kind: RobotKind) -> RobotKind:
        """The kind whose places a robot of this kind uses: of those with the same lanes, the smallest ones that are large enough."""
        graph = kind.graph if kind.graph in self.roadmap.graphs else None
        candidates = [candidate for candidate in self.kinds if candidate.graph == graph] or self.kinds
        return next(
            (candidate for candidate in candidates if candidate.radius >= kind.radius), candidates[-1] if candidates else RobotKind()
        )

    def layer(self, level: float, kind: RobotKind) -> Layer:
        """The places on a floor for robots of a kind."""
        key = level, self.kind_for(kind)
        if key not in self._layers:
            of_kind = [number for number, place in enumerate(self.roadmap.places) if (place.level, place.kind) == key]
            numbers = np.array(of_kind, dtype=int)
            self._layers[key] = Layer(numbers, cKDTree(self.points[numbers]), self.spacing(of_kind[0]) if of_kind else 0.0)
        return self._layers[key]

    def spacing(self, number: int) -> float:
        """The spacing of a place, m: no lane from there is longer."""
        return self._spacings[number]

    def near(self, point: Point, level: float) -> Iterator[int]:
        """The places of a level within the largest spacing around a point, and some that are farther away."""
        near = self._squares.near(box_around(point, self.widest))
        return (number for number in near if self.roadmap.places[number].level == level)

    def _conflicts(self) -> Iterator[tuple[int, int]]:
        """The pairs of places of one level that are too near to each other, and those of one zone or mutex."""
        for members in (*self.zones.values(), *self._mutexes.values()):
            yield from combinations(members, 2)
        for number, place in enumerate(self.roadmap.places):
            for earlier in self.near((place.x, place.y), place.level):
                near = self.roadmap.places[earlier]
                is_known = place.zone is not None and near.zone == place.zone
                least = least_distance(self.spacing(number), self.spacing(earlier)) * (1 - ROUNDING)
                if not is_known and math.dist((near.x, near.y), (place.x, place.y)) < least:
                    yield earlier, number
            self._squares.add(number, box_around((place.x, place.y), 0.0))
