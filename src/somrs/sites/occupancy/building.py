"""A building made of an occupancy grid: walls, rooms, the doors between them, and what stands in the rooms.

Coordinates are those of the map, in metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from somrs.sites.occupancy.grid import Cell, Mask, OccupancyGrid, Points
from somrs.sites.occupancy.openings import find_openings, rooms_beside, without_wide
from somrs.sites.occupancy.rooms import NARROWEST_DOOR, WIDEST_DOOR, Doorway, Labels, Rooms, find_rooms, outline_of
from somrs.sites.occupancy.walls import WALL_THICKNESS, Structure, find_structure
from somrs.sites.plan import Box, Point

_IN_LINE = 0.3
"""The greatest distance of the middle of a doorway from the middle of the wall in which it is, m."""
_BESIDE_DOOR = 0.5
"""An opening that is so near to a known door is its own, m."""
_AT_WALL = 0.45
"""How far the side of a door is from a wall at most, m: a shorter piece of wall between them is not found."""
_NARROWEST = 0.4
"""Free floor that is narrower is no part of a room, m."""
_LARGEST_SPOT = 1.0
"""Area of the largest unknown spot that is taken as a part of the room around it, m²."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """A room. `outline`: the edge of its floor, which reaches under its walls, m. `middle`: the point that is farthest from its edge, m.
    `cells`: how many cells of the grid are in it.
    """

    outline: list[Point]
    middle: Point
    cells: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Door:
    """A door, in the gap of its wall. `rooms`: the indexes of those that it joins."""

    box: Box
    rooms: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Building:
    """What an occupancy grid shows of a floor. The rooms are in the order of their size, the largest first."""

    walls: list[Box]
    obstacles: list[Box]
    rooms: list[Room]
    doors: list[Door]


def building_of(grid: OccupancyGrid, furniture: Sequence[Box] = (), doors: Sequence[Box] = ()) -> Building:
    """The building that the grid shows. `furniture`: what is known to stand there, and is no part of the building; `doors`: those that are
    known, as wide as they may be."""
    furniture = [_moved(box, grid.to_local([(box.x, box.y)]), -grid.yaw) for box in furniture]
    doors = [_moved(box, grid.to_local([(box.x, box.y)]), -grid.yaw) for box in doors]
    grid = _without(furniture, grid)
    structure = find_structure(grid)
    cells = room_cells(grid, structure, furniture)
    openings = [box for box in find_openings(structure.walls, grid) if all(door.gap((box.x, box.y)) > _BESIDE_DOOR for door in doors)]
    rooms = find_rooms(_parted(cells, [*doors, *openings], grid), grid.resolution)
    rooms, openings = without_wide(rooms, openings, grid)
    rooms, doorways = _between_walls(rooms, structure, grid)
    doorways += [(pair, box) for box in (*doors, *openings) if (pair := rooms_beside(box, rooms, grid)) is not None]
    doorways = [(pair, box) for pair, box in doorways if box.width >= NARROWEST_DOOR]
    labels = _cut_at_doors(cells, rooms, [*doors, *(box for _, box in doorways)], grid)
    counts, places = np.bincount(labels.ravel()), ndimage.find_objects(labels)
    order = sorted(rooms.numbers, key=lambda number: (-int(counts[number]), number))
    return Building(
        walls=[_on_map(wall, grid) for wall in structure.walls],
        obstacles=[_on_map(obstacle, grid) for obstacle in structure.obstacles],
        rooms=[_room(labels, number, places[number - 1], grid) for number in order],
        doors=[Door(box=_on_map(box, grid), rooms=(order.index(first), order.index(second))) for (first, second), box in doorways],
    )


def _between_walls(rooms: Rooms, structure: Structure, grid: OccupancyGrid) -> tuple[Rooms, list[tuple[tuple[int, int], Box]]]:
    """The rooms, with those as one that touch only beside furniture, or what was not seen; and the doors between the others."""
    boxes = {doorway.middle: _door_box(doorway, structure, grid) for doorway in rooms.doorways}
    in_walls = {middle for middle, box in boxes.items() if all(_is_at_wall(box, side, structure) for side in (-1, 1))}
    while True:
        pairs = {doorway.rooms for doorway in rooms.doorways if doorway.middle in in_walls}
        touching = next((doorway.rooms for doorway in rooms.doorways if doorway.rooms not in pairs), None)
        if touching is None:
            return rooms, [(doorway.rooms, boxes[doorway.middle]) for doorway in rooms.doorways if doorway.middle in in_walls]
        rooms = rooms.united(*touching)


def _is_at_wall(door: Box, side: int, structure: Structure) -> bool:
    jamb = door.world((side * door.width / 2, 0.0))
    return any(wall.gap(jamb) <= _AT_WALL for wall in structure.walls)


def _parted(cells: Mask, partitions: Sequence[Box], grid: OccupancyGrid) -> Mask:
    """The cells without those in these rectangles."""
    cells = cells.copy()
    for partition in partitions:
        place, is_covered = covered_part(partition, grid, 0.75 * grid.resolution)
        cells[place] &= ~is_covered
    return cells


def _cut_at_doors(cells: Mask, rooms: Rooms, doors: Sequence[Box], grid: OccupancyGrid) -> Labels:
    """The numbers of the rooms of cells: a room ends at the line of its wall, and not where its doorway is narrowest."""
    parts, count = ndimage.label(_parted(cells, doors, grid))
    number_of_part = np.zeros(count + 1, dtype=np.int32)
    for part, place in enumerate(ndimage.find_objects(parts), 1):
        number_of_part[part] = int(np.bincount(rooms.labels[place][parts[place] == part]).argmax())
    labels: Labels = number_of_part[parts]
    missing = [number for number in rooms.numbers if not (labels == number).any()]
    for number in missing:  # no door has cut it off, so that it stays as it is
        labels[rooms.labels == number] = number
    return labels


def _without(furniture: Sequence[Box], grid: OccupancyGrid) -> OccupancyGrid:
    """The grid without what is seen of the furniture: nobody knows what is there besides."""
    states = grid.states.copy()
    for box in furniture:
        place, is_covered = covered_part(box, grid, 1.5 * grid.resolution)
        states[place][is_covered & (states[place] == Cell.OCCUPIED)] = Cell.UNKNOWN
    return replace(grid, states=states)


def room_cells(grid: OccupancyGrid, structure: Structure, furniture: Sequence[Box] = ()) -> Mask:
    """The cells that are in rooms: what is free, with small unknown spots and what stands there, and without walls."""
    cells = grid.mask(Cell.FREE)
    spots, count = ndimage.label(grid.mask(Cell.UNKNOWN))
    sizes = np.bincount(spots.ravel(), minlength=count + 1) * grid.resolution**2
    is_small = sizes <= _LARGEST_SPOT
    is_small[0] = False
    surrounded = ndimage.binary_fill_holes(cells)
    cells = cells | (is_small[spots] & surrounded)
    for obstacle in (*structure.obstacles, *furniture):
        place, is_covered = covered_part(obstacle, grid, 1.5 * grid.resolution)
        cells[place] |= is_covered
    for wall in structure.walls:
        place, is_covered = covered_part(wall, grid, 0.0)
        cells[place] &= ~is_covered
    cells = _where_something_fits(cells, grid.resolution)
    parts, _ = ndimage.label(cells)
    rooms: Mask = cells & np.isin(parts, np.unique(parts[cells & grid.mask(Cell.FREE)]))
    return rooms


def _where_something_fits(cells: Mask, resolution: float) -> Mask:
    """The cells without what is too narrow to be a part of a room: rays that have gone through gaps and windows."""
    distances = ndimage.distance_transform_edt(np.pad(cells, 1))[1:-1, 1:-1] * resolution
    is_core = distances >= _NARROWEST / 2
    if not is_core.any():
        return cells
    is_near: Mask = ndimage.distance_transform_edt(~is_core) * resolution <= _NARROWEST / 2 + 2 * resolution
    return cells & is_near


def cells_of(box: Box, grid: OccupancyGrid, margin: float) -> Mask:
    """The cells whose middles are in a rectangle, in local coordinates, or at most `margin` beside it, m."""
    mask = np.zeros(grid.shape, dtype=bool)
    place, is_covered = covered_part(box, grid, margin)
    mask[place] = is_covered
    return mask


def covered_part(box: Box, grid: OccupancyGrid, margin: float) -> tuple[tuple[slice, slice], Mask]:
    """The same as a part of the grid around the rectangle: its place, and which of its cells."""
    reach = box.reach + 2 * margin
    low, high = (np.floor((np.array([box.y, box.x]) + sign * reach) / grid.resolution).astype(int) for sign in (-1, 1))
    (end_row, end_column), (first_row, first_column) = np.clip(high + 1, 0, grid.shape).tolist(), np.clip(low, 0, grid.shape).tolist()
    ys, xs = ((np.arange(start, end) + 0.5) * grid.resolution for start, end in ((first_row, end_row), (first_column, end_column)))
    (ux, uy), (vx, vy) = box.axes
    dx, dy = xs[None, :] - box.x, ys[:, None] - box.y
    mask: Mask = (np.abs(dx * ux + dy * uy) <= box.width / 2 + margin) & (np.abs(dx * vx + dy * vy) <= box.depth / 2 + margin)
    return (slice(first_row, end_row), slice(first_column, end_column)), mask


def _door_box(doorway: Doorway, structure: Structure, grid: OccupancyGrid) -> Box:
    """The rectangle of a door: in the line of its wall, from one side of the gap to the other."""
    wall = min(
        (wall for wall in structure.walls if _is_beside(wall, doorway)),
        key=lambda wall: (not structure.is_along(wall), abs(wall.local(doorway.middle)[0]) - wall.width / 2),
        default=None,
    )
    if wall is None:
        difference = math.remainder(doorway.yaw - structure.direction, math.pi / 2)
        yaw = doorway.yaw - difference if abs(difference) < math.radians(30) else doorway.yaw
        middle, depth = doorway.middle, WALL_THICKNESS
    else:
        u_offset, _ = wall.local(doorway.middle)
        middle, depth, yaw = wall.world((u_offset, 0.0)), wall.depth, wall.yaw
    box = Box(*middle, doorway.width, depth, yaw)
    near_walls = [wall for wall in structure.walls if wall.gap(middle) <= WIDEST_DOOR]
    right, left = (_reach(box, sign, near_walls, grid) for sign in (1, -1))
    x, y = box.world(((right - left) / 2, 0.0))
    return Box(x, y, right + left, depth, yaw)


def _is_beside(wall: Box, doorway: Doorway) -> bool:
    """Whether the doorway is in the line of the wall, right after one of its ends."""
    u_offset, v_offset = wall.local(doorway.middle)
    turned = abs(math.remainder(wall.yaw - doorway.yaw, math.pi)) > math.radians(60)
    return not turned and abs(v_offset) <= wall.depth / 2 + _IN_LINE and -0.1 <= abs(u_offset) - wall.width / 2 <= WIDEST_DOOR


def _reach(box: Box, sign: int, walls: Sequence[Box], grid: OccupancyGrid) -> float:
    """The distance from the middle of a door to the end of the gap on a side, m."""
    for distance in np.arange(grid.resolution / 2, WIDEST_DOOR, grid.resolution / 2):
        point = box.world((sign * float(distance), 0.0))
        if any(wall.gap(point) <= 0 for wall in walls) or grid.state_at(np.array([point]))[0] != Cell.FREE:
            return float(distance) - grid.resolution / 4
    return box.width / 2


def _room(labels: Labels, number: int, place: tuple[slice, slice], grid: OccupancyGrid) -> Room:
    """The room of the cells with this number, which are in this part of the grid.

    Its floor reaches under the walls, so that it meets the floors of the rooms beside it.
    """
    steps = max(1, round(WALL_THICKNESS / grid.resolution))
    margin = steps + 1
    cells = np.pad(labels[place] == number, margin)
    local_corners = outline_of(ndimage.binary_dilation(cells, np.ones((3, 3)), iterations=steps), grid.resolution, 1.5 * grid.resolution)
    shift = np.array([place[1].start - margin, place[0].start - margin]) * grid.resolution
    outline = [(round(x, 3), round(y, 3)) for x, y in grid.to_map(np.array(local_corners) + shift).tolist()]
    distances = ndimage.distance_transform_edt(cells)
    row, column = np.unravel_index(int(distances.argmax()), distances.shape)
    ((x, y),) = grid.to_map(np.array([(column + 0.5, row + 0.5)]) * grid.resolution + shift).tolist()
    return Room(outline=outline, middle=(x, y), cells=int(np.count_nonzero(cells)))


def _on_map(box: Box, grid: OccupancyGrid) -> Box:
    return _moved(box, grid.to_map([(box.x, box.y)]), grid.yaw)


def _moved(box: Box, middle: Points, turn: float) -> Box:
    """The rectangle with another middle, turned."""
    ((x, y),) = middle.tolist()
    return replace(box, x=x, y=y, yaw=math.remainder(box.yaw + turn, math.tau))
