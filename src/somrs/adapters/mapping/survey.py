"""What a robot has seen of a floor, and where it looks next. It neither drives nor reports, and reads no clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from somrs.adapters.mapping.evidence import Evidence
from somrs.adapters.mapping.ways import Frontier, Ways
from somrs.devices.simulator.link.commands import Scan, Sighting
from somrs.ontology.types import Value
from somrs.sites.occupancy.grid import OccupancyGrid
from somrs.sites.plan import Box, Point

LEG = 1.5
"""The longest way that a robot drives without a scan, m."""
MARGIN = 0.08
"""How far a robot keeps from what it has seen, besides its radius, m."""
SAME_FRONTIER = 0.4
"""A frontier that is so near to one that was looked at in vain is not looked at again, m."""
SAME_PIECE = 0.4
"""Two sightings of one type that are so near are of one piece of furniture, m."""
BERTH = 0.25
"""How far a robot keeps from another one, besides the radii of both, m."""
LEAST_SIGHTINGS = 2
"""A piece of furniture counts when it has been seen so often."""
_TRIES = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A piece of furniture as the camera has recognised it: its type, its looks, and the middle of its underside, m and rad.

    `count`: of the sightings, of which the pose is the mean."""

    type: str
    values: dict[str, Value] = field(default_factory=dict)
    x: float
    y: float
    z: float
    yaw: float
    count: int = 1

    @property
    def box(self) -> Box:
        """The rectangle that it covers."""

        def size(path: str) -> float:
            value = self.values.get(path)
            return float(value) if isinstance(value, int | float) else 0.0

        radius = size("Shape.Radius")
        return Box(self.x, self.y, size("Shape.Width") or 2 * radius, size("Shape.Depth") or 2 * radius, self.yaw)

    @property
    def top(self) -> float:
        """The height of its top, m."""
        height = self.values.get("Shape.Height")
        return self.z + (float(height) if isinstance(height, int | float) else 0.0)


class Survey:
    """The survey of a floor by a robot of this radius, m."""

    def __init__(self, radius: float) -> None:
        self.radius = radius
        self.evidence = Evidence()
        self.pieces: list[Piece] = []
        self.robots: list[Point] = []
        """Where other robots stood when the camera saw them last."""
        self._looked_at: list[Point] = []
        """The middles of the frontiers to which the robot has driven, each time."""

    def add_scan(self, x: float, y: float, yaw: float, scan: Scan, ranges: Sequence[float | None]) -> None:
        """Add a scan from a pose."""
        angles = yaw - scan.view / 2 + (np.arange(len(ranges)) + 0.5) * scan.view / scan.rays
        self.evidence.add_scan(x, y, angles, ranges, scan.range)
        self.evidence.add_free_disc(x, y, self.radius)

    def add_furniture(self, sightings: Sequence[Sighting]) -> None:
        """Add pieces of furniture that the camera has recognised."""
        for sighting in sightings:
            known_index = next(
                (
                    index
                    for index, piece in enumerate(self.pieces)
                    if piece.type == sighting.type and math.dist((piece.x, piece.y), (sighting.x, sighting.y)) <= SAME_PIECE
                ),
                None,
            )
            if known_index is None:
                self.pieces.append(
                    Piece(type=sighting.type, values=sighting.values, x=sighting.x, y=sighting.y, z=sighting.z, yaw=sighting.yaw)
                )
            else:
                self.pieces[known_index] = _averaged(self.pieces[known_index], sighting)

    def add_robots(self, points: Sequence[Point]) -> None:
        """Note where other robots stand: each in place of one that was seen near there."""
        for point in points:
            self.robots = [robot for robot in self.robots if math.dist(robot, point) > SAME_PIECE]
            self.robots.append(point)

    def furniture(self) -> list[Box]:
        """The rectangles of the furniture, as far as it was seen more than once."""
        return [piece.box for piece in self.pieces if piece.count >= LEAST_SIGHTINGS]

    def grid(self) -> OccupancyGrid:
        """What is known now."""
        return self.evidence.grid()

    def next_frontier(self, position: Point) -> Frontier | None:
        """Where to look next; None if there is nothing left that can be looked at."""
        frontiers = Ways(self.grid(), position, self.radius + MARGIN, self.robots, 2 * self.radius + BERTH).frontiers()
        return min(
            (frontier for frontier in frontiers if not self._is_vain(frontier)),
            key=lambda frontier: frontier.distance - 0.5 * min(frontier.length, 3.0),
            default=None,
        )

    def _is_vain(self, frontier: Frontier) -> bool:
        return sum(math.dist(frontier.middle, middle) <= SAME_FRONTIER for middle in self._looked_at) >= _TRIES

    def note_looked_at(self, frontier: Frontier) -> None:
        """The robot has driven to where it looks at this frontier, or could not."""
        self._looked_at.append(frontier.middle)


def _piece(sighting: Sighting) -> Piece:
    return Piece(type=sighting.type, values=sighting.values, x=sighting.x, y=sighting.y, z=sighting.z, yaw=sighting.yaw)


def _averaged(piece: Piece, sighting: Sighting) -> Piece:
    share = 1 / (piece.count + 1)
    return replace(
        piece,
        x=piece.x + share * (sighting.x - piece.x),
        y=piece.y + share * (sighting.y - piece.y),
        z=piece.z + share * (sighting.z - piece.z),
        yaw=piece.yaw + share * math.remainder(sighting.yaw - piece.yaw, math.tau),
        count=piece.count + 1,
    )


def legs_of(way: Sequence[Point]) -> list[Point]:
    """The ends of the legs of a way, of which none is longer than `LEG`."""
    ends: list[Point] = []
    for start, end in pairwise(way):
        count = max(1, math.ceil(math.dist(start, end) / LEG))
        ends += [
            (start[0] + (end[0] - start[0]) * part / count, start[1] + (end[1] - start[1]) * part / count) for part in range(1, count + 1)
        ]
    return ends
