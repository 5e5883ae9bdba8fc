"""The heights of storeys."""

from __future__ import annotations

import math

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology

BELOW_FLOOR = 0.5
"""How far below a storey's elevation its objects may begin, such as its floor, m."""


def elevation_of(storey: str, map: Map, ontology: Ontology) -> float:
    """The height of a storey, m."""
    object = map.objects[storey]
    value = object.values.get("Elevation", ontology.default(object.type, "Elevation"))
    return float(value) if isinstance(value, int | float) else 0.0


def storey_heights(map: Map, ontology: Ontology) -> dict[str, float]:
    """The heights of all storeys, by name, m."""
    storeys = sorted(name for name, object in map.objects.items() if ontology.is_subtype(object.type, "Storey"))
    return {storey: elevation_of(storey, map, ontology) for storey in storeys}


def span_of(storey: str, map: Map, ontology: Ontology) -> tuple[float, float] | None:
    """The heights between which the undersides of a storey's objects are, m; None for an object that is no storey."""
    elevations = storey_heights(map, ontology)
    if storey not in elevations:
        return None
    higher = (elevation for elevation in elevations.values() if elevation > elevations[storey])
    return elevations[storey] - BELOW_FLOOR, min(higher, default=math.inf) - BELOW_FLOOR
