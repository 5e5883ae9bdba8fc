"""The map as it would be in a promised situation: what a service is asked to quote on, before earlier steps have made it so."""

from __future__ import annotations

from somrs.ontology.check import check
from somrs.ontology.effects import apply_effect
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology

SIZE = 32
"""The number of situations to keep. The services that are asked for a step read the map in the same situation, several times each."""


class PromisedMaps:
    """Applies situations to a map, without changing it. The latest results are kept until the map or the ontology changes."""

    def __init__(self) -> None:
        self._basis: tuple[Map, Ontology] | None = None
        self._maps: dict[str, Map] = {}

    def map_in(self, situation: str | None, map: Map, ontology: Ontology) -> Map:
        """The map after the situation, a formula, has come true; None: the map as it is. Raises FormulaError."""
        if situation is None:
            return map
        if self._basis is None or self._basis[0] is not map or self._basis[1] is not ontology:
            self._basis, self._maps = (map, ontology), {}
        if situation not in self._maps:
            if len(self._maps) >= SIZE:
                del self._maps[next(iter(self._maps))]
            self._maps[situation] = apply_effect(check(situation, ontology, map), map, ontology)
        return self._maps[situation]
