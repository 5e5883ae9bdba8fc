"""The places of a storey.

The places lie on a lattice of equal triangles, as far apart as the spacing: six ways lead on from each, and no two places of the lattice
exclude each other. Where walls and furniture leave no room for the lattice, places are added until every free point sees one.

If all lanes are at most as long as the spacing s, two robots that hold places which do not exclude each other, and drive on the lanes
between their own, stay at least s·√3/2 apart: the farthest that a lane comes towards a place at distance s from both its ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.spatial import cKDTree

from somrs.space.free_space import FreeSpace
from somrs.space.solids import Point
from somrs.space.squares import Squares, box_around
from somrs.traffic.bays import find_bays
from somrs.traffic.coverage import UNSEEN, Coverage, Crossings, Mask, Points
from somrs.traffic.lane_layout import AreClear, LaneLayout

PLACES = 4000
"""About how many places a floor has at most; on larger floors they are farther apart."""
WIDEST = 2.0
"""The largest spacing of places, in metres."""
SMALLEST = 0.3
"""Free areas smaller than this are left out, in square metres."""
HOPS = 4
"""Places that are next to each other on the ground are at most so many lanes apart; a power of two."""


class StoreyLayout:
    """The free space of a storey. `radius`: the clearance that robots need; `spacing`: the least spacing of places for them, in metres;
    `middles`: the points of cabins and passages, which get a place."""

    def __init__(self, free_space: FreeSpace, radius: float, spacing: float, middles: Sequence[Point]) -> None:
        self._middles = middles
        self._free_space, self._grid, self._radius = free_space, free_space.grid, radius
        labels, count = ndimage.label(free_space.field >= radius, structure=np.ones((3, 3)))
        sizes = np.bincount(labels.ravel(), minlength=count + 1) * self._grid.size**2
        sizes[0] = 0.0
        self._free = (sizes >= SMALLEST)[labels]
        area = np.count_nonzero(self._free) * self._grid.size**2
        self.spacing = max(spacing, min(math.sqrt(area / PLACES * 2 / math.sqrt(3)), WIDEST))
        self._coverage = Coverage(free_space, self._free, radius, self.spacing - self._grid.size)

    @property
    def are_clear(self) -> AreClear:
        return self._coverage.are_clear

    def snap(self, point: Point) -> Point | None:
        """The point, or the nearest one within the spacing where the robot has room; None if there is none."""
        if self._is_free(point):
            return point
        centres, tree = self._free_cells
        distance, number = tree.query(point) if len(centres) else (math.inf, 0)
        if distance > self.spacing:
            return None
        x, y = centres[number].tolist()
        return x, y

    @cached_property
    def _free_cells(self) -> tuple[Points, cKDTree]:
        """The centres of the cells where the robot has room."""
        centres = self._grid.centres(np.argwhere(self._free))
        return centres, cKDTree(centres)

    def lay_out(self, network: LaneLayout) -> tuple[Points, list[tuple[int, int]]]:
        """The points, those of the lanes first, and the pairs of them that a straight lane joins."""
        points, coverage = self._free_layout if not network.points else self._with_lanes(network)
        crossings = coverage.crossings()
        while len(joints := self._joints(points, crossings)):
            points = np.vstack([points, joints])
        bays = find_bays(self._free_space, self._free, points, self._pairs(points), self.spacing, self._coverage.are_clear)
        points = np.vstack([points, bays])
        return points, self._pairs(points)

    @cached_property
    def _free_layout(self) -> tuple[Points, Coverage]:
        """Points from which all of the free space is seen."""
        points = self._spread([*filter(self._is_free, self._middles), *self._lattice()])
        return self._filled(points, self._coverage), self._coverage

    def _with_lanes(self, network: LaneLayout) -> tuple[Points, Coverage]:
        """The points of lanes and beside them, and those from which the rest of the free space is seen.

        Who stands so near to a lane that nobody passes, and gets away only over the lane, may wait for a robot there that waits for it. So
        there are such points only where free space is seen from no others.
        """
        (points, coverage), on_lanes, apart = self._free_layout, np.array(network.points), self.spacing * (1 - 1e-9)
        sidings = self._spread([*filter(self._is_free, network.sidings())])
        sidings = sidings[_far_from(sidings, on_lanes, apart)]
        lane_points = np.vstack([on_lanes, sidings])
        remaining = _far_from(points, on_lanes, apart) & _far_from(points, sidings, self.spacing / 2)
        numbers = np.where(remaining, np.cumsum(remaining) - 1 + len(lane_points), UNSEEN)
        points, coverage = np.vstack([lane_points, points[remaining]]), coverage.renumbered(numbers)
        return self._filled(points, coverage), coverage

    def _lattice(self) -> Iterator[Point]:
        grid, step = self._grid, self.spacing * (1 + 1e-9)
        rows = math.ceil(grid.rows * grid.size / (step * math.sqrt(3) / 2))
        columns = math.ceil(grid.columns * grid.size / step) + 1
        for row in range(rows):
            for column in range(columns):
                point = grid.x + (column + row % 2 / 2) * step, grid.y + row * step * math.sqrt(3) / 2
                if self._is_free(point):
                    yield point

    def _is_free(self, point: Point) -> bool:
        cell = self._grid.cell(point)
        return cell is not None and bool(self._free[cell]) and self._free_space.free(point, self._radius)

    def _spread(self, points: Sequence[Point]) -> Points:
        """The points without those that are nearer to an earlier one than half of the spacing."""
        kept: list[Point] = []
        least = self.spacing / 2
        squares = Squares[Point](least)
        for point in points:
            if all(abs(point[0] - x) + abs(point[1] - y) >= least for x, y in squares.near(box_around(point, least))):
                kept.append(point)
                squares.add(point, box_around(point, 0.0))
        return np.array(kept, dtype=float).reshape(-1, 2)

    # Places for what the lattice leaves out

    def _filled(self, points: Points, coverage: Coverage) -> Points:
        """The points, and more of them, so that every free cell sees one."""
        for number, point in enumerate(points):
            coverage.note(point, number)
        further_points: list[Point] = []
        for row, column in coverage.unseen().tolist():
            if coverage.seen[row, column] == UNSEEN:
                further_points.append(self._grid.centre((row, column)))
                coverage.note(further_points[-1], len(points) + len(further_points) - 1)
        return np.vstack([points, *further_points]) if further_points else points

    def _pairs(self, points: Points) -> list[tuple[int, int]]:
        if len(points) < 2:
            return []
        pairs = cKDTree(points).query_pairs(self.spacing * (1 + 1e-6), output_type="ndarray")
        clear = self._coverage.are_clear(points[pairs[:, 0]], points[pairs[:, 1]]) if len(pairs) else np.zeros(0, dtype=bool)
        return [(int(start), int(end)) for start, end in pairs[clear]]

    def _joints(self, points: Points, crossings: Crossings) -> Points:
        """Further points that join places which are near each other on the floor, as a crossing leads from what sees the one to what sees
        the other, but not on the roadmap."""
        is_near = self._near_each_other(points)
        apart = ~np.asarray(is_near[crossings.low, crossings.high]).ravel() if len(crossings.low) else np.zeros(0, dtype=bool)
        return self._far_from_each_other(np.stack([crossings.starts[apart], crossings.ends[apart]], axis=1))

    def _far_from_each_other(self, joints: Iterable[Points]) -> Points:
        """The joints without those near an earlier one: with that, they may not be needed."""
        chosen: list[Points] = []
        for joint in joints:
            if all(np.abs(joint - earlier).max() > self.spacing for earlier in chosen):
                chosen.append(joint)
        return np.vstack(chosen) if chosen else np.zeros((0, 2))

    def _near_each_other(self, points: Points) -> csr_array:
        """Which pairs of points are at most `HOPS` lanes apart."""
        pairs, size = np.array(self._pairs(points), dtype=int).reshape(-1, 2), len(points)
        matrix = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(size, size)).tocsr()
        matrix = matrix + matrix.T + eye_array(size, dtype=bool, format="csr")
        for _ in range(round(math.log2(HOPS))):
            matrix = matrix @ matrix
        return matrix


def _far_from(points: Points, others: Points, least: float) -> Mask:
    """Which of the points are at least so far from all others."""
    if not len(points) or not len(others):
        return np.ones(len(points), dtype=bool)
    distances, _ = cKDTree(others).query(points)
    return np.asarray(distances >= least)
