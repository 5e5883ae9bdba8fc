"""The roadmap of a building: places where a robot can stand, and lanes between them."""

from __future__ import annotations

import math
from collections.abc import Iterator

from msgspec import Struct

from somrs.errors import UsageError
from somrs.traffic.planning.graph import Graph


class Place(Struct, frozen=True, kw_only=True):
    """A place, with its coordinates on the map in metres. `level`: the height of its floor."""

    name: str
    x: float
    y: float
    level: float = 0.0


class Lane(Struct, frozen=True, kw_only=True):
    """A lane, in one direction. `seconds`: how long a robot takes for it."""

    start: str
    end: str
    seconds: float


class Roadmap(Struct, frozen=True, kw_only=True):
    """Places and lanes. Robots at two places touch each other if these are nearer to each other than `spacing`, in metres."""

    places: tuple[Place, ...]
    lanes: tuple[Lane, ...]
    spacing: float = 0.0

    def check(self) -> None:
        """Raises UsageError for a roadmap that cannot be used."""
        names = [place.name for place in self.places]
        if len(set(names)) < len(names):
            raise UsageError(f"{next(name for name in names if names.count(name) > 1)} is the name of two places")
        for lane in self.lanes:
            for end in (lane.start, lane.end):
                if end not in set(names):
                    raise UsageError(f"a lane leads from {lane.start} to {lane.end}, and there is no place {end}")
            if not lane.seconds > 0:
                raise UsageError(f"the lane from {lane.start} to {lane.end} takes {lane.seconds} s; a lane takes more than 0 s")


class NumberedRoadmap:
    """A roadmap with numbers in place of names, for the planner."""

    def __init__(self, roadmap: Roadmap) -> None:
        roadmap.check()
        self.roadmap = roadmap
        self.names = tuple(place.name for place in roadmap.places)
        self.numbers = {name: number for number, name in enumerate(self.names)}
        lanes = ((self.numbers[lane.start], self.numbers[lane.end], lane.seconds) for lane in roadmap.lanes)
        self.graph = Graph(len(self.names), lanes, _conflicts(roadmap))

    def number(self, place: str) -> int:
        """Raises UsageError for a place that is not on the roadmap."""
        if place not in self.numbers:
            raise UsageError(f"there is no place {place} on the roadmap")
        return self.numbers[place]


def _conflicts(roadmap: Roadmap) -> Iterator[tuple[int, int]]:
    """The pairs of places of one level that are too near to each other, found in a grid of cells of the size of the spacing."""
    spacing = roadmap.spacing
    if spacing <= 0:
        return
    cells: dict[tuple[int, int], list[int]] = {}
    for number, place in enumerate(roadmap.places):
        column, row = math.floor(place.x / spacing), math.floor(place.y / spacing)
        for neighbour in ((column + i, row + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
            for earlier in cells.get(neighbour, ()):
                near = roadmap.places[earlier]
                if near.level == place.level and math.dist((near.x, near.y), (place.x, place.y)) < spacing:
                    yield earlier, number
        cells.setdefault((column, row), []).append(number)
