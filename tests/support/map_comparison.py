"""Compares the map that a robot has made with the building as it is, in figures and as a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage

from somrs.adapters.mapping.ways import covered_cells
from somrs.ontology.map import Map
from somrs.ontology.types import PART_OF, Ontology
from somrs.sites.occupancy.grid import Cell, OccupancyGrid
from somrs.sites.plan import Box, Point, is_in_polygon
from somrs.space.solids import Role, Solid, solid_of
from tests.support.floor_plans import points_along, share_within

WALL_TOLERANCE, PLACE_TOLERANCE = 0.1, 0.1
"""How far a wall, and a piece of furniture or a thing, may be from where it is, m."""
_FACE = 0.3
"""A wall can be seen if the robot can come so near to its middle line, m: not the robot, but its eye."""
_CELL = 0.1
_SCALE = 60
"""Pixels per metre of the picture."""
_COLOURS = {Role.SUPPORT: "#2255cc", Role.STATIC: "#2255cc", Role.THING: "#aa22aa", Role.WALL: "red", Role.DOOR: "orange"}


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """`walls`: the share of the length of the true walls that the made map has within the tolerance; `seen_walls`: the same of those that
    can be seen from where a robot can come; `invented`: the share of the length of its walls that are no true ones. The others are numbers
    of those that the made map has, and of those that are there and can be reached."""

    walls: float
    seen_walls: float
    invented: float
    rooms: tuple[int, int]
    furniture: tuple[int, int]
    things: tuple[int, int]

    def __str__(self) -> str:
        parts = [
            f"walls within 10 cm: {self.walls:.1%} of their length, {self.seen_walls:.1%} of what can be seen",
            f"walls that are none: {self.invented:.1%}",
        ]
        parts += [f"{name}: {found} of {all}" for name, (found, all) in zip(("rooms", "furniture", "things"), self._counts, strict=True)]
        return "; ".join(parts)

    @property
    def _counts(self) -> tuple[tuple[int, int], ...]:
        return self.rooms, self.furniture, self.things


def compare(made: Map, true: Map, ontology: Ontology, start: Point | None = None, rooms: Sequence[Point] | None = None) -> Comparison:
    """Compare a map with the true one. `start`: from where the robot has come, None: it can come everywhere; `rooms`: a point in each of
    the rooms that can be reached, None: in each that the true map has."""
    reach = Reach(true, ontology, start) if start is not None else None
    made_walls, true_walls = boxes(made, ontology, Role.WALL), boxes(true, ontology, Role.WALL)
    points = np.vstack([points_along(wall) for wall in true_walls])
    seen_points = points if reach is None else points[reach.contains(points, _FACE)]
    if rooms is None:
        rooms = [(solid.x, solid.y) for solid in _floors_of_rooms(true, ontology)]
    return Comparison(
        walls=share_within(points, made_walls, WALL_TOLERANCE),
        seen_walls=share_within(seen_points, made_walls, WALL_TOLERANCE),
        invented=1 - share_within(np.vstack([points_along(wall) for wall in made_walls]), true_walls, WALL_TOLERANCE),
        rooms=_rooms_found(made, ontology, rooms),
        furniture=_recognised(made, true, ontology, (Role.SUPPORT, Role.STATIC), reach),
        things=_recognised(made, true, ontology, (Role.THING,), reach),
    )


class Reach:
    """Where a robot can come from a point, on cells of 10 cm: through all doors, but not out of the building."""

    def __init__(self, true: Map, ontology: Ontology, start: Point) -> None:
        walls, doors = boxes(true, ontology, Role.WALL), boxes(true, ontology, Role.DOOR)
        corners = [corner for box in walls for corner in box.corners()]
        (self._x, self._y), (high_x, high_y) = np.min(corners, axis=0) - 1.0, np.max(corners, axis=0) + 1.0
        shape = math.ceil((high_y - self._y) / _CELL), math.ceil((high_x - self._x) / _CELL)
        grid = OccupancyGrid(states=np.zeros(shape, dtype=np.int8), resolution=_CELL, x=float(self._x), y=float(self._y))
        is_wall, is_door = (
            np.logical_or.reduce([np.zeros(shape, dtype=bool), *(covered_cells(box, grid, 0.5 * _CELL) for box in group)])
            for group in (walls, doors)
        )
        parts, _ = ndimage.label(~is_wall & ~is_door)
        parts, _ = ndimage.label(~is_wall & (parts != parts[0, 0]))
        row, column = self._cells(np.array([start]))[0]
        self._distances: np.ndarray = ndimage.distance_transform_edt(parts != parts[row, column]) * _CELL

    def _cells(self, points: np.ndarray) -> np.ndarray:
        cells: np.ndarray = np.floor((points - (self._x, self._y)) / _CELL).astype(int)
        return cells[:, ::-1]

    def contains(self, points: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """Whether points (n × 2, m) are there, or at most `margin` beside, m."""
        rows, columns = np.clip(self._cells(points), 0, np.array(self._distances.shape) - 1).T
        is_there: np.ndarray = self._distances[rows, columns] <= margin
        return is_there


def _floors_of_rooms(map: Map, ontology: Ontology) -> list[Solid]:
    names = {fact.arguments[0] for fact in map.facts(PART_OF) if ontology.is_subtype(map.objects[fact.arguments[1]].type, "Room")}
    return [solid for solid in _solids(map, ontology, Role.FLOOR) if solid.name in names]


def _rooms_found(made: Map, ontology: Ontology, middles: Sequence[Point]) -> tuple[int, int]:
    """How many of the rooms with these points are a room of the map, each with one of the points in it."""
    floors = [[floor.world(*corner) for corner in floor.corners()] for floor in _floors_of_rooms(made, ontology)]
    counts = [sum(is_in_polygon(middle, floor) for middle in middles) for floor in floors]
    return counts.count(1), len(middles)


def _solids(map: Map, ontology: Ontology, *roles: Role) -> list[Solid]:
    solids = (solid_of(object, ontology) for object in map.objects.values())
    return [solid for solid in solids if solid is not None and solid.role in roles]


def boxes(map: Map, ontology: Ontology, *roles: Role) -> list[Box]:
    """The rectangles of the objects with these roles."""
    solids = _solids(map, ontology, *roles)
    return [Box(s.x, s.y, s.width or 2 * s.radius, s.depth or 2 * s.radius, s.yaw) for s in solids]


def _recognised(made: Map, true: Map, ontology: Ontology, roles: tuple[Role, ...], reach: Reach | None) -> tuple[int, int]:
    """How many objects the made map has, with their types and in their places, and how many there are."""
    made_solids, true_solids = _solids(made, ontology, *roles), _solids(true, ontology, *roles)
    if reach is not None:
        true_solids = [solid for solid in true_solids if reach.contains(np.array([(solid.x, solid.y)]))[0]]
    matches = [any(_is_same(solid, candidate) for candidate in made_solids) for solid in true_solids]
    return sum(matches), len(true_solids)


def _is_same(first: Solid, second: Solid) -> bool:
    return first.type == second.type and math.dist((first.x, first.y, first.z), (second.x, second.y, second.z)) <= PLACE_TOLERANCE


def draw(grid: OccupancyGrid, made: Map, true: Map, ontology: Ontology, path: Path) -> None:
    """Draw the true walls and furniture in grey, what the scanner saw in black, and the made map in colours: walls red, doors orange, rooms
    green, furniture blue."""
    everything = [corner for box in boxes(true, ontology, Role.WALL, Role.SUPPORT, Role.STATIC) for corner in box.corners()]
    (low_x, low_y), (high_x, high_y) = np.min(everything, axis=0) - 0.5, np.max(everything, axis=0) + 0.5
    picture = Image.new("RGB", (round((high_x - low_x) * _SCALE), round((high_y - low_y) * _SCALE)), "white")
    pencil = ImageDraw.Draw(picture)

    def pixel(point: tuple[float, float]) -> tuple[float, float]:
        return (point[0] - low_x) * _SCALE, (high_y - point[1]) * _SCALE

    for box in boxes(true, ontology, Role.WALL, Role.SUPPORT, Role.STATIC):
        pencil.polygon([pixel(corner) for corner in box.corners()], fill="#cccccc")
    for point in grid.to_map(grid.centres(grid.mask(Cell.OCCUPIED))).tolist():
        x, y = pixel((point[0], point[1]))
        pencil.rectangle([x - 1, y - 1, x + 1, y + 1], fill="black")
    for floor in _solids(made, ontology, Role.FLOOR):
        pencil.polygon([pixel(floor.world(*corner)) for corner in floor.corners()], outline="#2a9d4a", width=2)
    for role, colour in _COLOURS.items():
        for box in boxes(made, ontology, role):
            pencil.polygon([pixel(corner) for corner in box.corners()], outline=colour, width=2)
    picture.save(path)
