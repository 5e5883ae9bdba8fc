"""The free space on each storey, for one state of the map."""

from __future__ import annotations

from collections.abc import Mapping

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.space.free_space import FreeSpace


class FreeSpaces:
    """Computes the free space of a storey when it is first asked for. `positions`: those of leaves, by their names."""

    def __init__(self, map: Map, ontology: Ontology, positions: Mapping[str, float]) -> None:
        self._map, self._ontology, self._positions = map, ontology, positions
        self._free_spaces: dict[float, FreeSpace] = {}

    def free_space(self, level: float) -> FreeSpace:
        """The free space at a height, m."""
        key = round(level, 1)
        if key not in self._free_spaces:
            self._free_spaces[key] = FreeSpace(self._map, self._ontology, level=level, leaf_positions=self._positions)
        return self._free_spaces[key]
