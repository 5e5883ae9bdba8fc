"""Whether objects fit where they are put: furniture beside walls and robots, robots beside walls and furniture.

Furniture may overlap furniture: chairs stand under tables.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from somrs.errors import SimulationError
from somrs.ontology.objects import Map, Object
from somrs.ontology.types import Ontology
from somrs.space.distances import distances_from
from somrs.space.findings import TOLERANCE
from somrs.space.reachability import outline_of
from somrs.space.solids import Role, Solid, solid_of

_STEP = 0.05
"""Distance between the points at which outlines are sampled, m; walls are thicker."""
_FURNITURE = frozenset((Role.SUPPORT, Role.STATIC))
_OBSTACLES = {
    Role.ROBOT: frozenset((Role.WALL, Role.ROBOT, *_FURNITURE)),
    Role.SUPPORT: frozenset((Role.WALL, Role.ROBOT)),
    Role.STATIC: frozenset((Role.WALL, Role.ROBOT)),
}
"""What a solid must not overlap, by its role."""


def misfits(map: Map, ontology: Ontology, names: Iterable[str]) -> Iterator[tuple[str, str, float]]:
    """The objects of these names that do not fit: the object, what it overlaps, and how deep, in metres."""
    subjects = [solid for name in names if name in map.objects and (solid := _solid(map.objects[name], ontology)) is not None]
    subjects = [solid for solid in subjects if solid.role in _OBSTACLES]
    if not subjects:
        return
    solids = [solid for object in map.objects.values() if (solid := _solid(object, ontology)) is not None]
    for subject in subjects:
        parts = {subject.name, *(arguments[0] for arguments in map.facts_with("isPartOf", 1, subject.name)), map.whole(subject.name)}
        for obstacle in solids:
            if (
                obstacle.name not in parts
                and obstacle.role in _OBSTACLES[subject.role]
                and (depth := overlap(subject, obstacle)) > TOLERANCE
            ):
                yield subject.name, obstacle.name, depth


def overlap(solid: Solid, obstacle: Solid) -> float:
    """How deep two solids are in each other, m; 0 if they do not overlap."""
    if solid.z >= obstacle.top - TOLERANCE or obstacle.z >= solid.top - TOLERANCE:
        return 0.0
    if math.hypot(solid.x - obstacle.x, solid.y - obstacle.y) > solid.extent + obstacle.extent:
        return 0.0
    pairs = ((solid, obstacle), (obstacle, solid))
    return max(0.0, *(-float(distances_from(one, _points(another)).min()) for one, another in pairs))


def _points(solid: Solid) -> npt.NDArray[np.float64]:
    """Points on the outline of a solid, and its middle."""
    corners = np.asarray(outline_of(solid), dtype=float)
    points = [np.array([[solid.x, solid.y]])]
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        share = np.linspace(0, 1, max(2, math.ceil(math.dist(start, end) / _STEP)))[:, None]
        points.append(start * (1 - share) + end * share)
    return np.concatenate(points)


def _solid(object: Object, ontology: Ontology) -> Solid | None:
    try:
        return solid_of(object, ontology)
    except SimulationError:  # it has no shape that can be drawn; `somrs check` says so
        return None
