"""What is in a simulated world, made from a map: its solids by name, and where leaves came to rest. It has no motion and no physics.

There is no scene file: only objects on the map are in the world (paper, "Simulation").
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from somrs.errors import SimulationError
from somrs.ontology.objects import Map, Object
from somrs.ontology.types import Ontology
from somrs.space.leaves import leaf_obstacles, leaves_of
from somrs.space.solids import Role, Solid, solid_of

_STATICS = (Role.WALL, Role.DOOR, Role.SUPPORT, Role.STATIC)
_MOVING = (Role.THING, Role.ROBOT)
SQUARE = 4.0
"""Size of the squares by which solids near a place are found, m."""
MOST_SQUARES = 400
"""Largest number of squares for a solid; a larger one counts as near everything."""

Box = tuple[float, float, float, float]
"""A rectangle on the map: left, bottom, right, top."""


class Layout:
    """The solids by name. `positions`: those of the leaves of doors and containers when they came to rest, by name."""

    def __init__(self, ontology: Ontology) -> None:
        self.ontology = ontology
        self.solids: dict[str, Solid] = {}
        self.positions: dict[str, float] = {}
        self._squares: dict[tuple[int, int], dict[str, int]] | None = None
        """The numbers of the solids that stand still, by their names, by the squares in which they may be; None if not known."""
        self._large: dict[str, int] = {}

    def fill(self, map: Map) -> None:
        """Add the objects of a map. Raises SimulationError if none of them takes up space."""
        for object in map.objects.values():
            self.add(object)
        if not self.solids:
            raise SimulationError("the map has no physical object with a position and a shape; there is no world to simulate")

    def by_role(self, *roles: Role) -> list[Solid]:
        return [solid for solid in self.solids.values() if solid.role in roles]

    def standing_near(self, box: Box) -> list[Solid]:
        """The solids that stand still, with their leaves, and may reach into a rectangle, in the order in which they were added."""
        if self._squares is None:
            self._squares = self._find_squares()
        numbers = dict(self._large)
        for square in squares(box):
            numbers |= self._squares.get(square, {})
        return [self.solids[name] for name in sorted(numbers, key=numbers.__getitem__)]

    def _find_squares(self) -> dict[tuple[int, int], dict[str, int]]:
        found_squares: dict[tuple[int, int], dict[str, int]] = {}
        self._large = {}
        for number, solid in enumerate(self.solids.values()):
            if solid.role in _MOVING:
                continue
            span = solid.extent + (solid.depth if solid.container else 0.0)  # the leaves of a container open in front of it
            if (2 * span / SQUARE + 1) ** 2 > MOST_SQUARES:
                self._large[solid.name] = number
                continue
            for square in squares((solid.x - span, solid.y - span, solid.x + span, solid.y + span)):
                found_squares.setdefault(square, {})[solid.name] = number
        return found_squares

    def blocks_near(self, box: Box) -> list[Solid]:
        """The static obstacles that may reach into a rectangle, with the leaves of open containers, and without open doors."""
        solids = self.standing_near(box)
        leaves = [
            leaf for solid in solids if solid.role is Role.SUPPORT and solid.container for leaf in leaf_obstacles(solid, self.positions)
        ]
        return [*(solid for solid in solids if solid.role in _STATICS and not (solid.role is Role.DOOR and solid.open)), *leaves]

    def add(self, object: Object) -> Solid | None:
        """Add an object. Returns None if it takes up no space. Raises SimulationError if it exists already."""
        solid = solid_of(object, self.ontology)
        if solid is None:
            return None
        if object.name in self.solids:
            raise SimulationError(f"{object.name} is in the simulated world already; remove it first")
        self.solids[solid.name] = solid
        if solid.role not in _MOVING:
            self._squares = None
        return solid

    def set_weight(self, thing: str, weight: float) -> None:
        """Set the weight of a thing, kg."""
        self.solids[thing] = replace(self.solids[thing], weight=weight)

    def remove(self, name: str) -> Solid:
        """Remove an object, and return it."""
        solid = self.solids.pop(name)
        if solid.role not in _MOVING:
            self._squares = None
        for leaf in leaves_of(solid):
            self.positions.pop(leaf.name, None)
        return solid


def squares(box: Box) -> Iterator[tuple[int, int]]:
    """The squares that a rectangle meets."""
    left, bottom, right, top = (math.floor(value / SQUARE) for value in box)
    return ((column, row) for column in range(left, right + 1) for row in range(bottom, top + 1))
