"""Tells the walls of an occupancy grid from what stands in the rooms.

Coordinates are the grid's own, in metres.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from somrs.sites.occupancy.corners import with_corners
from somrs.sites.occupancy.grid import Cell, Mask, OccupancyGrid, Points
from somrs.sites.occupancy.lines import aligned, find_lines, free_share, joined, main_direction, widened
from somrs.sites.plan import Box, cleared

WALL_THICKNESS = 0.1
"""Thickness of a wall of which only one face was seen, m."""
_WIDEST_OBSTACLE = 3.0
"""What stands by itself in a room and is longer is a part of the building, m."""
_PARTITION = (0.8, 0.4)
"""What stands by itself and is at least so long, and at most so thick, is a wall, m."""
_DEEPEST, _WIDEST_BY_WALL = 1.0, 2.5
"""The greatest depth and width of furniture that stands against a wall, m."""
_SHALLOWEST = 0.15
_LONGEST_HIDDEN = 4.0
"""The longest part of a wall that something may hide, m."""
_COMPACT = 0.55
"""Share of the rectangle around an obstacle that it fills."""
_SMALL = 0.6
"""What stands by itself and is not longer is an obstacle, however little of its rectangle it fills, m."""
_TOGETHER = 0.15
"""Occupied cells so near are of one obstacle, m: legs, and what a scanner saw of the same thing at different times."""
_NOISE, _NOISE_FROM_WALL, _NOISY_WALL = (0.25, 0.1), 0.3, 1.0
"""What is not longer and not thicker, and so near to a wall of at least this length, is noise of the wall, m."""
_FARTHEST_MOVE = 0.25
"""An obstacle is moved at most so far out of a wall, m."""
_FEWEST_CELLS = 3
"""An obstacle has so many occupied cells; fewer are noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """What is built, and what stands there, as rectangles. `direction`: along or across which most walls are, rad."""

    walls: list[Box]
    obstacles: list[Box]
    direction: float

    def is_along(self, box: Box) -> bool:
        """Whether a rectangle is along or across the main direction, nearly."""
        return abs(math.remainder(box.yaw - self.direction, math.pi / 2)) < math.radians(3)


def find_structure(grid: OccupancyGrid) -> Structure:
    """The walls and the obstacles of a grid."""
    lines = find_lines(grid)
    direction = main_direction(lines)
    lines = joined([aligned(line, direction, 1.5 * grid.resolution) for line in lines], grid, _LONGEST_HIDDEN)
    obstacles = [box for island in _islands(grid, lines) if (box := _obstacle(island, grid, direction)) is not None]
    lines = [line for line in lines if not any(obstacle.gap((line.x, line.y)) < grid.resolution for obstacle in obstacles)]
    fronts = list(_against_walls(lines, grid))
    lines = [line for line in lines if not any(_belongs_to(line, front, grid.resolution) for front in fronts)]
    walls = with_corners(joined([_as_thick_as_walls(line, grid) for line in lines], grid, _LONGEST_HIDDEN), grid)
    standing = [box for obstacle in (*obstacles, *fronts) if (box := beside_walls(obstacle, walls, _FARTHEST_MOVE)) is not None]
    return Structure(walls=walls, obstacles=standing, direction=direction)


def beside_walls(obstacle: Box, walls: Sequence[Box], farthest: float) -> Box | None:
    """The obstacle, moved out of walls into which it reaches a little; None if that is farther than `farthest`, m: then it is a part of the
    wall."""
    moved = cleared(obstacle, [wall for wall in walls if wall.gap((obstacle.x, obstacle.y)) < obstacle.reach], 0.001)
    return moved if moved is not None and math.dist((moved.x, moved.y), (obstacle.x, obstacle.y)) <= farthest else None


def _islands(grid: OccupancyGrid, lines: Sequence[Box]) -> Iterator[Points]:
    """The cells of each part of what is not free that has free cells all around it, and is not only unknown, in local coordinates. Small
    parts that are close together are one; what is noise of a wall is left out."""
    is_taken = np.pad(~grid.mask(Cell.FREE), 1, constant_values=True)
    labels, _ = ndimage.label(is_taken, structure=np.ones((3, 3)))
    outside, labels = labels[0, 0], labels[1:-1, 1:-1]
    occupied, small = grid.mask(Cell.OCCUPIED), np.zeros(grid.shape, dtype=bool)
    walls = [line for line in lines if line.width >= _NOISY_WALL]
    for number, place in enumerate(ndimage.find_objects(labels), 1):
        if number == outside or place is None:
            continue
        is_part: Mask = labels[place] == number
        if not (is_part & occupied[place]).any():
            continue
        size = (place[0].stop - place[0].start) * grid.resolution, (place[1].stop - place[1].start) * grid.resolution
        if max(size) > _SMALL:
            yield _centres(is_part, place, grid)
        elif not _is_noise(size, ((place[1].start * grid.resolution + size[1] / 2), place[0].start * grid.resolution + size[0] / 2), walls):
            small[place] |= is_part
    reach = max(1, round(_TOGETHER / 2 / grid.resolution))
    groups, _ = ndimage.label(ndimage.binary_dilation(small, np.ones((3, 3)), iterations=reach), structure=np.ones((3, 3)))
    for number, place in enumerate(ndimage.find_objects(groups), 1):
        is_part = (groups[place] == number) & small[place]
        if np.count_nonzero(is_part & occupied[place]) >= _FEWEST_CELLS:
            yield _centres(is_part, place, grid)


def _centres(cells: Mask, place: tuple[slice, ...], grid: OccupancyGrid) -> Points:
    """The middles of cells of a part of the grid."""
    return grid.centres(cells) + np.array([place[1].start, place[0].start]) * grid.resolution


def _is_noise(size: tuple[float, float], middle: tuple[float, float], walls: Sequence[Box]) -> bool:
    is_speck = max(size) <= _NOISE[0] and min(size) <= _NOISE[1]
    return is_speck and any(wall.gap(middle) <= _NOISE_FROM_WALL for wall in walls)


def _obstacle(cells: Points, grid: OccupancyGrid, direction: float) -> Box | None:
    """The obstacle that these cells are; None for walls or another part of the building."""
    box = smallest_box(cells, grid.resolution, direction)
    long, thin = max(box.width, box.depth), min(box.width, box.depth)
    is_wall = long >= _PARTITION[0] and thin <= _PARTITION[1]
    is_compact = long <= _SMALL or len(cells) * grid.resolution**2 >= _COMPACT * box.width * box.depth  # walls that cross are not
    return box if is_compact and not is_wall and long <= _WIDEST_OBSTACLE else None


def smallest_box(cells: Points, resolution: float, direction: float) -> Box:
    """The rectangle around cells with the least area; the main direction counts as a little smaller."""
    best: tuple[float, Box] | None = None
    for turn in np.radians(np.arange(0, 90, 2)):
        axes = np.array(
            [[math.cos(direction + turn), math.sin(direction + turn)], [-math.sin(direction + turn), math.cos(direction + turn)]]
        )
        turned = cells @ axes.T
        low, high = turned.min(axis=0) - resolution / 2, turned.max(axis=0) + resolution / 2
        width, depth = (high - low).tolist()
        area = width * depth * (1.0 if turn else 0.85)
        if best is None or area < best[0]:
            x, y = ((low + high) / 2 @ axes).tolist()
            best = area, Box(x, y, width, depth, math.remainder(direction + float(turn), math.tau))
    assert best is not None, "there is an angle"
    return best[1]


def _against_walls(lines: Sequence[Box], grid: OccupancyGrid) -> Iterator[Box]:
    """What stands against walls: from each short line that is the front of something to the longer line behind it."""
    for front in lines:
        if front.width > _WIDEST_BY_WALL:
            continue
        for wall in lines:
            if wall.width <= front.width * 1.5 or abs(math.remainder(front.yaw - wall.yaw, math.pi)) > math.radians(5):
                continue
            u_offset, v_offset = wall.local((front.x, front.y))
            depth = abs(v_offset) + front.depth / 2 - wall.depth / 2
            is_behind = abs(u_offset) <= (wall.width - front.width) / 2 + 0.2
            if _SHALLOWEST <= depth <= _DEEPEST and is_behind and _is_taken(front, wall, u_offset, v_offset, grid):
                middle = math.copysign(wall.depth / 2 + depth / 2, v_offset)
                x, y = wall.world((u_offset, middle))
                yield Box(x, y, front.width, depth, wall.yaw)
                break


def _is_taken(front: Box, wall: Box, u_offset: float, v_offset: float, grid: OccupancyGrid) -> bool:
    """Whether nearly nothing between a line and the wall behind it is free."""
    xs = np.linspace(u_offset - 0.4 * front.width, u_offset + 0.4 * front.width, 9)
    low, high = wall.depth / 2 + grid.resolution, abs(v_offset) - front.depth / 2 - grid.resolution / 2
    ys = np.linspace(low, max(high, low), 7) * math.copysign(1, v_offset)
    points = np.array([wall.world((float(x), float(y))) for x in xs for y in ys])
    return float(np.mean(grid.state_at(points) == Cell.FREE)) <= 0.1


def _belongs_to(line: Box, obstacle: Box, margin: float) -> bool:
    """Whether a line is a side of the obstacle: whether it is inside of it."""
    ends = [line.world((sign * line.width / 2 * 0.8, 0.0)) for sign in (-1, 1)]
    return line.width <= 1.2 * max(obstacle.width, obstacle.depth) and all(obstacle.gap(end) <= margin for end in ends)


def _as_thick_as_walls(line: Box, grid: OccupancyGrid) -> Box:
    """The line with the thickness of a wall, if only one face of it was seen: it grows away from what is free."""
    missing = WALL_THICKNESS - line.depth
    if missing <= 0:
        return line
    left_share, right_share = free_share(line, grid, 1), free_share(line, grid, -1)
    return widened(line, 1 if left_share < right_share else -1, missing) if min(left_share, right_share) < 0.5 else line
