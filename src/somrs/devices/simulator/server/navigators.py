"""The navigators of one state of the map: one for each storey, and for each set of doors that are to be open or shut in a plan."""

from __future__ import annotations

from collections.abc import Mapping

from somrs.ontology.objects import Map, ValueSet
from somrs.ontology.types import Ontology
from somrs.space.navigation import Navigator

Doors = frozenset[tuple[str, bool]]
"""Doors that are to be open (True) or shut in a plan, other than they are now."""
NO_DOORS: Doors = frozenset()
MOST_NAVIGATORS = 16
"""The number of navigators to keep, of all levels and states of doors."""


class Navigators:
    """Makes navigators when they are asked for, and keeps the last ones. `positions`: those of leaves, by their names."""

    def __init__(self, map: Map, ontology: Ontology, positions: Mapping[str, float]) -> None:
        self._map, self._ontology, self._positions = map, ontology, positions
        self._navigators: dict[tuple[float, Doors], Navigator] = {}

    def navigator(self, level: float, doors: Doors = NO_DOORS) -> Navigator:
        """The navigator at a height, m, with these doors."""
        key = round(level, 1), doors
        if key not in self._navigators:
            while len(self._navigators) >= MOST_NAVIGATORS:
                del self._navigators[next(iter(self._navigators))]
            changes = [ValueSet(door, "Open", is_open) for door, is_open in doors if door in self._map.objects]
            promised = dict(doors)
            positions = {leaf: position for leaf, position in self._positions.items() if leaf.split("/")[0] not in promised}
            self._navigators[key] = Navigator(self._map.changed(changes), self._ontology, level=level, leaf_positions=positions)
        return self._navigators[key]
