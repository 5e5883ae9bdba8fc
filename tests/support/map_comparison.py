"""Compares the map that a robot has made with the building as it is, in figures and as a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.sites.occupancy.grid import Cell, OccupancyGrid
from somrs.sites.plan import Box
from somrs.space.solids import Role, Solid, solid_of
from tests.support.floor_plans import points_along, share_within

WALL_TOLERANCE, PLACE_TOLERANCE = 0.1, 0.1
"""How far a wall, and a piece of furniture or a thing, may be from where it is, m."""
_SCALE = 60
"""Pixels per metre of the picture."""
_COLOURS = {Role.SUPPORT: "#2255cc", Role.STATIC: "#2255cc", Role.THING: "#aa22aa", Role.WALL: "red", Role.DOOR: "orange"}


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """`walls`: the share of the length of the true walls that the made map has within the tolerance; `invented`: the share of the length of
    its walls that are no true ones. The others are numbers of those that the made map has, and of those that are there."""

    walls: float
    invented: float
    rooms: tuple[int, int]
    furniture: tuple[int, int]
    things: tuple[int, int]

    def __str__(self) -> str:
        parts = [f"walls within 10 cm: {self.walls:.1%} of their length", f"walls that are none: {self.invented:.1%}"]
        parts += [f"{name}: {found} of {all}" for name, (found, all) in zip(("rooms", "furniture", "things"), self._counts, strict=True)]
        return "; ".join(parts)

    @property
    def _counts(self) -> tuple[tuple[int, int], ...]:
        return self.rooms, self.furniture, self.things


def compare(made: Map, true: Map, ontology: Ontology) -> Comparison:
    """Compare a map with the true one."""
    made_walls, true_walls = boxes(made, ontology, Role.WALL), boxes(true, ontology, Role.WALL)
    return Comparison(
        walls=share_within(np.vstack([points_along(wall) for wall in true_walls]), made_walls, WALL_TOLERANCE),
        invented=1 - share_within(np.vstack([points_along(wall) for wall in made_walls]), true_walls, WALL_TOLERANCE),
        rooms=(len(_of_type(made, ontology, "Room")), len(_of_type(true, ontology, "Room"))),
        furniture=_recognised(made, true, ontology, (Role.SUPPORT, Role.STATIC)),
        things=_recognised(made, true, ontology, (Role.THING,)),
    )


def _of_type(map: Map, ontology: Ontology, kind: str) -> list[str]:
    return [name for name, object in map.objects.items() if ontology.is_subtype(object.type, kind)]


def _solids(map: Map, ontology: Ontology, *roles: Role) -> list[Solid]:
    solids = (solid_of(object, ontology) for object in map.objects.values())
    return [solid for solid in solids if solid is not None and solid.role in roles]


def boxes(map: Map, ontology: Ontology, *roles: Role) -> list[Box]:
    """The rectangles of the objects with these roles."""
    solids = _solids(map, ontology, *roles)
    return [Box(s.x, s.y, s.width or 2 * s.radius, s.depth or 2 * s.radius, s.yaw) for s in solids]


def _recognised(made: Map, true: Map, ontology: Ontology, roles: tuple[Role, ...]) -> tuple[int, int]:
    """How many objects the made map has, with their types and in their places, and how many there are."""
    made_solids, true_solids = _solids(made, ontology, *roles), _solids(true, ontology, *roles)
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
