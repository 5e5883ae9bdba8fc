"""The free space of a floor: how far from the nearest obstacle a robot would be.

It is independent of the physics. Static obstacles come from the map; the caller gives temporary ones (robots, things on the floor) as
discs. The ground is a grid whose cells hold the distance of their centres from the nearest obstacle (`clearance.py`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.space.clearance import FAR, Disc, Field, Grid, clearances
from somrs.space.dimensions import EVEN, ROBOT_HEIGHT
from somrs.space.leaves import leaf_obstacles
from somrs.space.shafts import shafts_of
from somrs.space.solids import STANDING, Point, Role, Solid, solid_of

SLACK = 0.01
"""Tolerance of clearances, for the error of interpolation between cells, m."""


class FreeSpace:
    """The free space of one floor of a map. Solids above the robots are not obstacles.

    `leaf_positions`: where the leaves of doors and containers are, if not where the map says.
    """

    def __init__(
        self,
        map: Map,
        ontology: Ontology,
        *,
        level: float = 0.0,
        leaf_positions: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        solids = [solid for object in map.objects.values() if (solid := solid_of(object, ontology)) is not None]
        standing = {solid.name: solid for solid in solids if _stands(solid) and solid.z < level + ROBOT_HEIGHT and solid.top > level + EVEN}
        shafts = shafts_of(map, ontology)
        for fact in map.facts("leadsInto"):  # the doors of a lift are open for whoever may use it
            standing.pop(fact.arguments[0], None)
        floors = [solid for solid in solids if solid.role is Role.FLOOR and abs(solid.top - level) < 0.1]
        leaves = [leaf for solid in standing.values() for leaf in leaf_obstacles(solid, leaf_positions)]
        passages = [solid for solid in solids if ontology.is_subtype(solid.type, "Passage")]
        cabins = [part for shaft in shafts for part in shaft.ground(level)]
        walls = [wall for shaft in shafts for wall in shaft.obstacles(level)]
        self.grid = Grid.enclosing([*floors, *cabins] if floors else solids, margin=0.5 if floors else 4.0)
        self._clearance = clearances(self.grid, [*standing.values(), *leaves, *walls], floors, [*passages, *cabins] if floors else [])

    @property
    def field(self) -> Field:
        """The clearance of each cell of the grid, in metres."""
        return self._clearance

    def clearances(self, points: ArrayLike) -> Field:
        """Distance from each point to the nearest obstacle, as `clearance` says it."""
        return self.grid.sample(self._clearance, points)

    def is_clear(self, start: Point, end: Point, radius: float, discs: Sequence[Disc] = ()) -> bool:
        """Whether a robot of that radius can drive from one point to the other in a straight line."""
        return self._clear_line(self.grid.with_discs(self._clearance, discs), start, end, radius)

    def clearance(self, point: Point, discs: Sequence[Disc] = ()) -> float:
        """Distance from the point to the nearest obstacle, at most `FAR`; negative inside an obstacle or off the floor."""
        return min(self.grid.value(self._clearance, point), *(d.distance(point) for d in discs), FAR)

    def free(self, point: Point, radius: float, discs: Sequence[Disc] = ()) -> bool:
        """Whether a robot of that radius can stand there."""
        return self.clearance(point, discs) >= radius - SLACK

    def _clear_line(self, field: np.ndarray, start: Point, end: Point, clearance: float) -> bool:
        count = max(2, math.ceil(2 * math.dist(start, end) / self.grid.size))
        share = np.linspace(0, 1, count)[:, None]
        return bool(self.grid.sample(field, np.asarray(start) * (1 - share) + np.asarray(end) * share).min() >= clearance - SLACK)


def _stands(solid: Solid) -> bool:
    """Whether robots drive around it. An automatic door opens for them."""
    return solid.role in STANDING or (solid.role is Role.DOOR and not (solid.open or solid.automatic))
