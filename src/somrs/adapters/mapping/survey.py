"""What a robot has seen of a floor, and where it looks next. It neither drives nor reports, and reads no clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from somrs.adapters.mapping.doors import DrivenDoor
from somrs.adapters.mapping.evidence import Evidence
from somrs.adapters.mapping.ways import Frontier, View, Ways, covered_cells, frontiers_of, longest_worthwhile
from somrs.devices.simulator.link.commands import Scan, Sighting
from somrs.ontology.types import Value
from somrs.sites.occupancy.grid import Cell, OccupancyGrid
from somrs.sites.plan import Box, Point

MARGIN = 0.08
"""How far a robot keeps from what it has seen, besides its radius, m."""
FARTHEST_VIEW = 4.0
"""A frontier is looked at from at most so far, m."""
_FIRST_REACH, _LONGEST_REACH = 6.0, 60.0
"""Views are looked for at the ends of ways of at most these lengths at first, and at last before all are looked at, m."""
SAME_FRONTIER = 0.4
"""A frontier that is so near to one that was looked at before is the same, m."""
_TRIES = 5
"""A frontier that was looked at so often, each time from elsewhere, cannot be seen better."""
SAME_PIECE = 0.4
"""Two sightings of one type that are so near are of one piece of furniture, m."""
BERTH = 0.25
"""How far a robot keeps from another one, besides the radii of both, m."""
LEAST_SIGHTINGS = 2
"""A piece of furniture counts when it has been seen so often."""
_DOORWAY = 0.1
"""How far beside a door its leaf is seen, m."""
_SWING_MARGIN = 0.1
"""How far a robot keeps from where the leaf of a door may swing, m."""


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
        self._looked_at: list[tuple[Point, Point]] = []
        """The middles of the frontiers to which the robot has driven, each time, and from where it looked."""
        self._tried_doors: set[str] = set()
        """The doors that the robot has had opened, or has tried to."""
        self._open_doors: list[DrivenDoor] = []
        self._closed_doors: list[Box] = []
        """Those that were opened for the robot, and are open or shut again."""

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
                self.pieces.append(_piece(sighting))
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
        """What is known now. Doorways that the robot has seen open are free, also when the doors are shut again."""
        grid = self.evidence.grid()
        for box in self._closed_doors:
            grid.states[covered_cells(box, grid)] = Cell.FREE
        return grid

    def _ways(self, position: Point) -> Ways:
        return self._ways_without((), position)

    def _ways_without(self, doors: Sequence[DrivenDoor], position: Point, reach: float = math.inf) -> Ways:
        """The ways up to a length of `reach`, m, if these doors were shut."""
        shut_doors = [*self._closed_doors, *(door.box for door in doors)]
        doorways = [_extended(door.box, self.radius + 2 * MARGIN) for door in self._open_doors]
        clearance, berth = self.radius + MARGIN, 2 * self.radius + BERTH
        return Ways(self.grid(), position, clearance, self.robots, berth, shut_doors, doorways, self.radius, reach)

    def next_view(self, position: Point) -> View | None:
        """From where to look next; None if there is nothing left that can be looked at."""
        frontiers = [frontier for frontier in self._with_tried_stands(frontiers_of(self.grid())) if len(frontier.tried_stands) < _TRIES]
        if not frontiers:
            return None
        reach = _FIRST_REACH
        while True:
            view = self._ways_without((), position, reach).best_view(frontiers)
            worthwhile = longest_worthwhile(frontiers, position, view.value) if view is not None else 3 * reach
            if worthwhile <= reach or math.isinf(reach):
                return view
            reach = worthwhile if worthwhile < _LONGEST_REACH else math.inf

    def _with_tried_stands(self, frontiers: Sequence[Frontier]) -> list[Frontier]:
        """The frontiers, with the places from which the robot has looked at each."""
        middles = np.array([frontier.middle for frontier in frontiers]).reshape(-1, 2)
        earlier_middles = np.array([middle for middle, _ in self._looked_at]).reshape(-1, 2)
        is_same = np.hypot(*(middles[:, None] - earlier_middles).transpose(2, 0, 1)) <= SAME_FRONTIER
        return [
            replace(frontier, reach=FARTHEST_VIEW, tried_stands=tuple(self._looked_at[number][1] for number in np.flatnonzero(row)))
            for frontier, row in zip(frontiers, is_same, strict=True)
        ]

    def next_door(self, position: Point, shut_doors: Sequence[DrivenDoor]) -> tuple[DrivenDoor, View] | None:
        """Which of the doors that are shut is to be opened next, and from where it is looked at, outside the swing of its leaf; None if
        there is none whose front the robot has seen and that it has not tried."""
        ways = self._ways(position)
        views: list[tuple[DrivenDoor, View]] = []
        for door in shut_doors:
            if door.name not in self._tried_doors and (view := self._view_of(door, ways, self._swing(door.box))) is not None:
                views.append((door, view))
        return min(views, key=lambda pair: pair[1].distance, default=None)

    def look_through(self, door: DrivenDoor, position: Point) -> View | None:
        """From where the robot looks straight through a door that is open; None if it cannot come there."""
        return self._view_of(door, self._ways(position), 0.0)

    def _swing(self, box: Box) -> float:
        """How far from a door the robot is out of the way of its leaf, m."""
        return max(box.width, box.depth) + self.radius + _SWING_MARGIN

    def _front_distance(self, box: Box) -> float:
        """How far from the middle of a door a robot stands close in front of it, m."""
        return min(box.width, box.depth) / 2 + self.radius + 2 * MARGIN

    def _view_of(self, door: DrivenDoor, ways: Ways, least: float) -> View | None:
        """From where the floor in front of a door is seen that is nearest to it, at least `least` from there, m."""
        box, front = door.box, self._front_distance(door.box)
        sides = [box.world((0.0, side * front) if box.width >= box.depth else (side * front, 0.0)) for side in (1.0, -1.0)]
        views = [view for middle in sides if (view := ways.view_of(middle, least, least + 1.5)) is not None]
        return min(views, key=lambda view: view.distance, default=None)

    def note_tried(self, door: DrivenDoor) -> None:
        """The robot has this door opened."""
        self._tried_doors.add(door.name)

    def note_open(self, door: DrivenDoor) -> None:
        """A door has opened: what was seen of its leaf is over."""
        self.evidence.forget(covered_cells(_extended(door.box, _DOORWAY), self.evidence.grid()))
        self._open_doors.append(door)

    def note_closed(self, door: DrivenDoor) -> None:
        """A door that was opened for the robot shuts."""
        self._open_doors.remove(door)
        self._closed_doors.append(door.box)

    def closable_doors(self, position: Point, ahead: Point | None) -> list[DrivenDoor]:
        """The doors opened for the robot that it does not need on its way to where it looks next. `ahead`: None if it looks nowhere."""
        closable: list[DrivenDoor] = []
        for door in self._open_doors:
            if ahead is None or (
                door.box.gap(position) > self._swing(door.box) and self._ways_without([*closable, door], position).is_reachable(ahead)
            ):
                closable.append(door)
        return closable

    def stand_beside(self, door: DrivenDoor, position: Point) -> View | None:
        """Where the robot is out of the way of a door; None if it is now, or cannot come there."""
        return self._view_of(door, self._ways(position), self._swing(door.box)) if door.box.gap(position) < self._swing(door.box) else None

    def note_looked_at(self, view: View) -> None:
        """The robot has driven to where it looks, or could not."""
        self._looked_at += [(frontier.middle, view.stand) for frontier in view.frontiers]


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


def _extended(door: Box, length: float) -> Box:
    """The rectangle of a door, and the floor in front of it and behind, up to this distance, m."""
    if door.width >= door.depth:
        return replace(door, depth=door.depth + 2 * length)
    return replace(door, width=door.width + 2 * length)
