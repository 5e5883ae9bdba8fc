"""Whether objects fit where they are put: furniture beside walls and robots, robots beside walls, furniture and each other.

Furniture may overlap furniture: chairs stand under tables.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from somrs.errors import SimulationError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology
from somrs.space.distances import distances_from, outline_points
from somrs.space.solids import STANDING, Role, Solid, solid_of

TOLERANCE = 0.02
"""How far objects may overlap, m: drawings are not more exact."""
_OBSTACLES = {
    Role.ROBOT: frozenset((*STANDING, Role.ROBOT)),
    Role.SUPPORT: frozenset((Role.WALL, Role.ROBOT)),
    Role.STATIC: frozenset((Role.WALL, Role.ROBOT)),
}
"""What a solid must not overlap, by its role."""
_PASSABLE = ("Pedestrian",)
"""Types of what stands there, and yet is not in the way: people walk on."""


def misfits(map: Map, ontology: Ontology, names: Iterable[str]) -> Iterator[tuple[str, str, float]]:
    """The objects of these names that do not fit: the object, what it overlaps, and how deep, in metres."""
    subjects = [solid for name in names if name in map.objects and (solid := _solid(map.objects[name], ontology)) is not None]
    if any(solid.role in _OBSTACLES for solid in subjects):
        solids = [solid for object in map.objects.values() if (solid := _solid(object, ontology)) is not None]
        yield from ((subject.name, obstacle.name, depth) for subject, obstacle, depth in overlaps(subjects, solids, map, ontology))


def overlaps(subjects: Sequence[Solid], solids: Sequence[Solid], map: Map, ontology: Ontology) -> Iterator[tuple[Solid, Solid, float]]:
    """Which of the subjects overlap which of the solids that they must not, and how deep, in metres."""
    obstacles = [solid for solid in solids if is_in_the_way(solid, ontology) or solid.role is Role.ROBOT]
    centres = np.array([(solid.x, solid.y) for solid in obstacles]).reshape(-1, 2)
    extents = np.array([solid.extent for solid in obstacles])
    for subject in subjects:
        if subject.role not in _OBSTACLES or not _must_fit(subject, ontology):
            continue
        parts = {subject.name, *(arguments[0] for arguments in map.facts_with("isPartOf", 1, subject.name)), map.whole(subject.name)}
        candidates = np.nonzero(np.hypot(centres[:, 0] - subject.x, centres[:, 1] - subject.y) < extents + subject.extent)[0]
        for obstacle in (obstacles[index] for index in candidates.tolist()):
            if (
                obstacle.role in _OBSTACLES[subject.role]
                and obstacle.name not in parts
                and (depth := overlap(subject, obstacle)) > TOLERANCE
            ):
                yield subject, obstacle, depth


def is_in_the_way(solid: Solid, ontology: Ontology) -> bool:
    """Whether robots have to drive around it; doors are a matter of their own."""
    return solid.role in STANDING and not any(ontology.is_subtype(solid.type, type) for type in _PASSABLE)


def _must_fit(solid: Solid, ontology: Ontology) -> bool:
    """Whether it is a mistake if it overlaps something: parts of a building, such as holes in a floor, lie in its walls."""
    return solid.role is Role.ROBOT or (is_in_the_way(solid, ontology) and not ontology.is_subtype(solid.type, "BuildingElement"))


def overlap(solid: Solid, obstacle: Solid) -> float:
    """How deep two solids are in each other, m; 0 if they do not overlap."""
    if solid.z >= obstacle.top - TOLERANCE or obstacle.z >= solid.top - TOLERANCE:
        return 0.0
    if math.hypot(solid.x - obstacle.x, solid.y - obstacle.y) > solid.extent + obstacle.extent:
        return 0.0
    orders = ((solid, obstacle), (obstacle, solid))
    for first, second in orders:
        if first.form == "Cylinder":
            return max(0.0, first.radius - second.distance(first.x, first.y))
    return max(0.0, *(-float(distances_from(first, outline_points(second)).min()) for first, second in orders))


def _solid(object: Object, ontology: Ontology) -> Solid | None:
    try:
        return solid_of(object, ontology)
    except SimulationError:  # it has no shape that can be drawn; `somrs check` says so
        return None
