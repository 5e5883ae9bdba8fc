"""What is in a simulated world, made from a map: its solids by name, and where leaves came to rest. It has no motion and no physics.

There is no scene file: only objects on the map are in the world (paper, "Simulation").
"""

from __future__ import annotations

from dataclasses import replace

from somrs.errors import SimulationError
from somrs.ontology.objects import Map, Object
from somrs.ontology.types import Ontology
from somrs.space.leaves import leaf_obstacles, leaves_of
from somrs.space.solids import Role, Solid, solid_of

_STATICS = (Role.WALL, Role.DOOR, Role.SUPPORT, Role.STATIC)


class Layout:
    """The solids by name. `positions`: those of the leaves of doors and containers when they came to rest, by name."""

    def __init__(self, ontology: Ontology) -> None:
        self.ontology = ontology
        self.solids: dict[str, Solid] = {}
        self.positions: dict[str, float] = {}

    def fill(self, map: Map) -> None:
        """Add the objects of a map. Raises SimulationError if none of them takes up space."""
        for object in map.objects.values():
            self.add(object)
        if not self.solids:
            raise SimulationError("the map has no physical object with a position and a shape; there is no world to simulate")

    def by_role(self, *roles: Role) -> list[Solid]:
        return [solid for solid in self.solids.values() if solid.role in roles]

    def blocks(self) -> list[Solid]:
        """The static obstacles, with the leaves of open containers, and without open doors."""
        solids = [solid for solid in self.by_role(*_STATICS) if not (solid.role is Role.DOOR and solid.open)]
        return [*solids, *self.leaf_obstacles()]

    def leaf_obstacles(self) -> list[Solid]:
        """The leaves of containers that are not shut."""
        containers = (solid for solid in self.by_role(Role.SUPPORT) if solid.container)
        return [leaf for solid in containers for leaf in leaf_obstacles(solid, self.positions)]

    def add(self, object: Object) -> Solid | None:
        """Add an object. Returns None if it takes up no space. Raises SimulationError if it exists already."""
        solid = solid_of(object, self.ontology)
        if solid is None:
            return None
        if object.name in self.solids:
            raise SimulationError(f"{object.name} is in the simulated world already; remove it first")
        self.solids[solid.name] = solid
        return solid

    def set_weight(self, thing: str, weight: float) -> None:
        """Set the weight of a thing, kg."""
        self.solids[thing] = replace(self.solids[thing], weight=weight)

    def remove(self, name: str) -> Solid:
        """Remove an object, and return it."""
        solid = self.solids.pop(name)
        for leaf in leaves_of(solid):
            self.positions.pop(leaf.name, None)
        return solid
