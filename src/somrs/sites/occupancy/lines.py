"""Finds straight lines in an occupancy grid: a Hough transform whose votes are withdrawn line by line.

Coordinates are the grid's own, in metres; angles in radians. A line is a `Box`: its width is the length of the line, its depth the
thickness of what is there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from somrs.sites.occupancy.grid import Cell, OccupancyGrid, Points
from somrs.sites.plan import Box

SHORTEST = 0.4
"""Length of the shortest line, m."""
_ANGLES = np.radians(np.arange(180))
"""The directions of the normals of lines that are tried."""
_MAIN_WEIGHT = 1.3
"""Weight of votes for lines in the main directions of a building: the diagonal of a short piece of wall is longer than its sides."""
_GAP = 0.3
"""The longest gap in a line, m; `joined` bridges longer ones that may be hidden."""
_THICKEST = 0.35
"""The greatest distance between the two faces of a wall, m."""
_ALONG_LINE = 0.5
"""Share of a row of cells that has to be occupied for it to belong to the line."""
_ASLANT = math.radians(8)
"""A line that is more turned against the main direction is not along it, rad."""
_HIDDEN = 0.9
"""Share of cells that must not be free where a wall goes on without having been seen."""

Floats = npt.NDArray[np.float64]


class _Votes:
    """The votes of occupied cells for lines, by angle and by distance from the origin."""

    def __init__(self, points: Points, step: float) -> None:
        self.points, self.step = points, step
        self.normals = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
        self._offset = float(np.hypot(*np.abs(points).max(axis=0))) + 2 * step
        self._bins = math.ceil(2 * self._offset / step) + 2
        self.is_alive = np.ones(len(points), dtype=bool)
        self._counts = np.zeros((len(_ANGLES), self._bins), dtype=np.int32)
        self._is_dead = np.zeros((len(_ANGLES), self._bins - 1), dtype=bool)
        self._add(points, 1)
        energy = (self._counts.astype(float) ** 2).sum(axis=1)
        main = int((energy + np.roll(energy, 90)).argmax())
        differences = (np.arange(180) - main + 45) % 90 - 45
        self._weights = np.where(np.abs(differences) <= 2, _MAIN_WEIGHT, 1.0)[:, None]
        self._renew_scores()

    def _add(self, points: Points, weight: int) -> None:
        for row, normal in enumerate(self.normals):
            bins = ((points @ normal + self._offset) / self.step).astype(int)
            self._counts[row] += weight * np.bincount(bins, minlength=self._bins).astype(np.int32)

    def remove(self, is_removed: npt.NDArray[np.bool_]) -> None:
        is_removed = is_removed & self.is_alive
        self.is_alive &= ~is_removed
        self._add(self.points[is_removed], -1)
        self._renew_scores()

    def _renew_scores(self) -> None:
        pairs = self._counts[:, :-1] + self._counts[:, 1:]  # a line that is not along the cells is spread over two
        self._scores = np.where(self._is_dead, 0.0, pairs * self._weights)

    def best(self) -> tuple[float, int, int]:
        """The score of the best line, its angle and its place, each as an index."""
        angle, place = np.unravel_index(int(self._scores.argmax()), self._scores.shape)
        return float(self._scores[angle, place]), int(angle), int(place)

    def discard(self, angle: int, place: int) -> None:
        """Try this line no more, nor those beside it, which have no more votes and go through nearly the same cells."""
        beside = (angle - 1) % len(_ANGLES), (angle + 1) % len(_ANGLES)
        for scores, value in ((self._is_dead, True), (self._scores, 0.0)):
            scores[angle, max(place - 1, 0) : place + 2] = value
            scores[[*beside], place] = value

    def candidates(self, angle: int, place: int) -> npt.NDArray[np.intp]:
        """The indexes of the points near a line, in their order along it."""
        normal, distance = self.normals[angle], (place + 1) * self.step - self._offset
        indexes = np.flatnonzero(self.is_alive & (np.abs(self.points @ normal - distance) <= 1.2 * self.step))
        u_offset = self.points[indexes] @ (-normal[1], normal[0])
        order: npt.NDArray[np.intp] = indexes[np.argsort(u_offset, kind="stable")]
        return order


def find_lines(grid: OccupancyGrid) -> list[Box]:
    """The lines of occupied cells, the longest first as far as they do not overlap."""
    points = grid.centres(grid.mask(Cell.OCCUPIED))
    if not len(points):
        return []
    votes, lines = _Votes(points, grid.resolution), list[Box]()
    least_votes = max(3, round(0.6 * SHORTEST / grid.resolution))
    while True:
        score, angle, place = votes.best()
        if score < least_votes:
            return lines
        run = _longest_run(points, votes.candidates(angle, place), votes.normals[angle])
        if len(run) < least_votes:
            votes.discard(angle, place)
            continue
        line = _thickened(_fitted(points[run], grid.resolution), grid)
        lines.append(line)
        is_covered = _is_inside(line, points, grid.resolution)
        is_covered[run] = True
        votes.remove(is_covered)


def _longest_run(points: Points, order: npt.NDArray[np.intp], normal: Floats) -> npt.NDArray[np.intp]:
    """Of points along a line, those of its longest part without a gap."""
    if not len(order):
        return order
    u_offset = points[order] @ (-normal[1], normal[0])
    starts = np.concatenate([[0], np.flatnonzero(np.diff(u_offset) > _GAP) + 1, [len(order)]])
    lengths = u_offset[starts[1:] - 1] - u_offset[starts[:-1]]
    longest = int(lengths.argmax())
    return order[starts[longest] : starts[longest + 1]] if lengths[longest] >= SHORTEST else order[:0]


def _fitted(points: Points, resolution: float) -> Box:
    """The line through points by total least squares, one cell thick."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    (ux, uy) = axes[0]
    u_offset = (points - middle) @ axes[0]
    low, high = float(u_offset.min()) - resolution / 2, float(u_offset.max()) + resolution / 2
    centre = middle + axes[0] * (low + high) / 2
    return Box(float(centre[0]), float(centre[1]), high - low, resolution, math.atan2(uy, ux))


def _rows_beside(line: Box, grid: OccupancyGrid, side: int, reach: float) -> Iterator[tuple[float, float, float]]:
    """Distances from the line's edge to a side, with the shares of occupied and of free cells there."""
    count = max(3, round(line.width / grid.resolution))
    u_offset = ((np.arange(count) + 0.5) / count - 0.5) * line.width
    (ux, uy), (vx, vy) = line.axes
    for number in range(1, math.ceil(2 * reach / grid.resolution)):
        distance = (number - 0.5) * grid.resolution / 2
        v_offset = side * (line.depth / 2 + distance)
        states = grid.state_at(np.column_stack([line.x + u_offset * ux + v_offset * vx, line.y + u_offset * uy + v_offset * vy]))
        yield distance, float(np.mean(states == Cell.OCCUPIED)), float(np.mean(states == Cell.FREE))


def _thickened(line: Box, grid: OccupancyGrid) -> Box:
    """The line with all that is occupied along it, and with the other face of a wall if nothing between them is free."""
    for side in (-1, 1):
        extent = 0.0
        for distance, occupied, free in _rows_beside(line, grid, side, _THICKEST):
            if occupied >= _ALONG_LINE:
                extent = distance + grid.resolution / 4
            elif free > 1 - _HIDDEN:
                break
        line = widened(line, side, extent)
    return line


def widened(line: Box, side: int, extent: float) -> Box:
    """The line, thicker by `extent` to a side: 1 is to the left of its direction, -1 to the right."""
    vx, vy = line.axes[1]
    half = side * extent / 2
    return Box(line.x + half * vx, line.y + half * vy, line.width, line.depth + extent, line.yaw)


def free_share(line: Box, grid: OccupancyGrid, side: int) -> float:
    """The share of free cells right beside the line."""
    return next((free for _, _, free in _rows_beside(line, grid, side, 1.6 * grid.resolution)), 0.0)


def _is_inside(box: Box, points: Points, margin: float) -> npt.NDArray[np.bool_]:
    (ux, uy), (vx, vy) = box.axes
    shifted = points - (box.x, box.y)
    is_within_box: npt.NDArray[np.bool_] = (np.abs(shifted @ (ux, uy)) <= box.width / 2 + margin) & (
        np.abs(shifted @ (vx, vy)) <= box.depth / 2 + margin
    )
    return is_within_box


def main_direction(lines: Iterable[Box]) -> float:
    """The angle, from 0 to 90°, along or across which most of the lines are."""
    angles = [(line.yaw % (math.pi / 2), line.width) for line in lines]
    if not angles:
        return 0.0

    def support(angle: float) -> float:
        return sum(width for yaw, width in angles if abs(math.remainder(yaw - angle, math.pi / 2)) < math.radians(3))

    best = max((angle for angle, _ in angles), key=support)
    differences = [(math.remainder(yaw - best, math.pi / 2), width**3) for yaw, width in angles]  # the variance falls with the length cubed
    differences = [(difference, weight) for difference, weight in differences if abs(difference) < math.radians(3)]
    return best + sum(difference * weight for difference, weight in differences) / sum(weight for _, weight in differences)


def aligned(line: Box, direction: float, displacement: float) -> Box:
    """The line turned into the main direction, if its ends move at most by `displacement`."""
    difference = math.remainder(line.yaw - direction, math.pi / 2)
    if abs(math.sin(difference)) * line.width / 2 > displacement or abs(difference) > _ASLANT:
        return line
    return Box(line.x, line.y, line.width, line.depth, line.yaw - difference)


def joined(lines: list[Box], grid: OccupancyGrid, longest_gap: float) -> list[Box]:
    """The lines, with those as one that go on in the same direction, where what is between them may be hidden: where it is not free."""
    remaining, result = sorted(lines, key=lambda line: -line.width), list[Box]()
    while remaining:
        line = remaining.pop(0)
        while (
            partner := next((candidate for candidate in remaining if _is_continued(line, candidate, grid, longest_gap)), None)
        ) is not None:
            remaining.remove(partner)
            line = _united(line, partner)
        result.append(line)
    return result


def _is_continued(line: Box, continuation: Box, grid: OccupancyGrid, longest_gap: float) -> bool:
    unsure = math.atan(grid.resolution / min(line.width, continuation.width))
    if abs(math.remainder(line.yaw - continuation.yaw, math.pi)) > math.radians(4) + unsure:
        return False
    u_offset, v_offset = line.local((continuation.x, continuation.y))
    if abs(v_offset) > max(2.1 * grid.resolution, (line.depth + continuation.depth) / 2):
        return False
    gap = abs(u_offset) - (line.width + continuation.width) / 2
    if gap <= 0:
        return True
    if gap > longest_gap:
        return False
    start = math.copysign(line.width / 2, u_offset)
    offsets = start + math.copysign(1, u_offset) * np.arange(grid.resolution / 2, gap, grid.resolution / 2)
    hidden_points = [line.world((float(offset), v_offset / 2)) for offset in offsets]
    return not hidden_points or float(np.mean(grid.state_at(np.array(hidden_points)) == Cell.FREE)) <= 1 - _HIDDEN


def _united(line: Box, continuation: Box) -> Box:
    """The line as long as both. It is as thick as the longer one, which is `line`."""
    u_offset, v_offset = line.local((continuation.x, continuation.y))
    low, high = min(-line.width / 2, u_offset - continuation.width / 2), max(line.width / 2, u_offset + continuation.width / 2)
    shift = v_offset * continuation.width / (line.width + continuation.width) if abs(v_offset) > line.depth / 2 else 0.0
    x, y = line.world(((low + high) / 2, shift))
    return Box(x, y, high - low, max(line.depth, continuation.depth), line.yaw)
