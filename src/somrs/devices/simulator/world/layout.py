"""What is in a simulated world, made from a map: its solids by name, and where leaves came to rest. It has no motion and no physics.

There is no scene file: only objects on the map are in the world (paper, "Simulation").
"""

from __future__ import annotations

from dataclasses import replace

from somrs.errors import SimulationError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology
from somrs.space.leaves import leaf_obstacles, leaves_of
from somrs.space.solids import Role, Solid, solid_of
from somrs.space.squares import Box, Squares, box_around

_STATICS = (Role.WALL, Role.DOOR, Role.SUPPORT, Role.STATIC)
_MOVING = (Role.THING, Role.ROBOT)
SQUARE = 4.0
"""Size of the squares by which solids near a place are found, m."""
MOST_SQUARES = 400
"""Largest number of squares for a solid; a larger one counts as near everything."""


class Layout:
    """The solids by name. `positions`: those of the leaves of doors and containers when they came to rest, by name."""

    def __init__(self, ontology: Ontology) -> None:
        self.ontology = ontology
        self.solids: dict[str, Solid] = {}
        self.positions: dict[str, float] = {}
        self._standing: Squares[tuple[int, str]] | None = None
        """The numbers and names of the solids that stand still; None if not known."""
        self._large: list[tuple[int, str]] = []

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
        if self._standing is None:
            self._standing = self._find_standing()
        near = dict([*self._large, *self._standing.near(box)])
        return [self.solids[near[number]] for number in sorted(near)]

    def _find_standing(self) -> Squares[tuple[int, str]]:
        standing = Squares[tuple[int, str]](SQUARE)
        self._large = []
        for number, solid in enumerate(self.solids.values()):
            if solid.role in _MOVING:
                continue
            span = solid.extent + (solid.depth if solid.container else 0.0)  # the leaves of a container open in front of it
            box = box_around((solid.x, solid.y), span)
            if standing.count(box) > MOST_SQUARES:
                self._large.append((number, solid.name))
            else:
                standing.add((number, solid.name), box)
        return standing

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
            self._standing = None
        return solid

    def set_weight(self, thing: str, weight: float) -> None:
        """Set the weight of a thing, kg."""
        self.solids[thing] = replace(self.solids[thing], weight=weight)

    def raise_object(self, name: str, z: float) -> Solid:
        """Set the height of an object. Returns it as it is then."""
        self.solids[name] = solid = replace(self.solids[name], z=z)
        return solid

    def remove(self, name: str) -> Solid:
        """Remove an object, and return it."""
        solid = self.solids.pop(name)
        if solid.role not in _MOVING:
            self._standing = None
        for leaf in leaves_of(solid):
            self.positions.pop(leaf.name, None)
        return solid
