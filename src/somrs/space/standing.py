"""Whether what is on something stands above it. The map of the system and `somrs check` share this rule."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from somrs.errors import SimulationError
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.ontology.values import value_of
from somrs.space.solids import Role, Solid, solid_of

ON = "isOn"

EDGE = 0.05
"""How far beside its support the middle of a thing may be, m: positions are measured."""

FLOATING = 0.1
"""How far above its support the underside of a thing may be, m."""

BESIDE = "beside"
"""The name of the rule."""


def beside_text(support: str, distance: float) -> str:
    """What is wrong, and what to do, for people. `distance`: in metres."""
    return f"it is on {support}, and its position is {distance:.2f} m beside that; correct PositionX and PositionY, or what it is on"


def beside_supports(map: Map, ontology: Ontology, names: Iterable[str]) -> Iterator[tuple[str, str, float]]:
    """Which of the objects are on something beside which they are: the object, what it is on, and the distance in metres.

    Places are no supports: their circles say about where they are.
    """
    for name in names:
        x, y = (value_of(name, path, map, ontology) for path in ("PositionX", "PositionY"))
        if not isinstance(x, float | int) or not isinstance(y, float | int):
            continue
        for _, support in map.facts_with(ON, 0, name):
            solid = _solid(support, map, ontology)
            if solid is not None and solid.role is not Role.MARK and (distance := solid.distance(x, y)) > EDGE:
                yield name, support, distance


def above_supports(map: Map, ontology: Ontology, names: Iterable[str]) -> Iterator[tuple[str, str, float]]:
    """Which of the objects are on something above which they float: the object, what it is on, and the distance in metres."""
    for name in names:
        z = value_of(name, "PositionZ", map, ontology)
        if not isinstance(z, float | int):
            continue
        for _, support in map.facts_with(ON, 0, name):
            solid = _solid(support, map, ontology)
            if solid is not None and (distance := z - solid.top) > FLOATING:
                yield name, support, distance


def _solid(name: str, map: Map, ontology: Ontology) -> Solid | None:
    try:
        return solid_of(map.objects[name], ontology)
    except SimulationError:  # it has no shape; `somrs check` says so
        return None
