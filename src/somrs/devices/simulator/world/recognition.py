"""What a camera recognises of the things and robots that it sees: their types, colours, sizes and poses, with noise, and not their names.

Furniture and parts of the building are landmarks, by which robots and cameras know where they are. They are reported by name.
"""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable, Iterator, Sequence

from somrs.devices.simulator.link.commands import Likeness, ObjectState, Sighting
from somrs.devices.simulator.world.scene import Scene
from somrs.ontology.types import Ontology, Value
from somrs.space.solids import Role, Solid

RECOGNISED = (Role.THING, Role.ROBOT)
"""The roles of the objects that are recognised by their looks."""
FURNITURE = (Role.SUPPORT, Role.STATIC)
"""The roles of landmarks that who does not know them by name recognises by their looks, too."""

SIZE_NOISE, TURN_NOISE = 0.25, 2.0
"""Standard deviation of a size in m, and of an angle in rad, as multiples of the camera's accuracy."""
ALIKE = 0.02
"""Largest difference between two sizes that look alike, m."""


def landmarks(scene: Scene, states: Iterable[ObjectState]) -> tuple[ObjectState, ...]:
    """The states of the objects that are reported by name."""
    return tuple(state for state in states if scene.world.solids[state.object].role not in RECOGNISED)


def sightings(
    scene: Scene, viewer: str, states: Sequence[ObjectState], like: Likeness | None, roles: Collection[Role] = RECOGNISED
) -> tuple[Sighting, ...]:
    """What the camera recognises of the objects with these roles, in the order of their poses. The same scene gives the same noise.

    `like`: what it looks for.
    """
    solids = scene.world.solids
    recognised = sorted((s for s in states if s.object in solids and solids[s.object].role in roles), key=lambda s: (s.x, s.y, s.z))
    numbers = {state.object: number for number, state in enumerate(recognised)}
    alike = set(look_alikes(scene, like)) if like is not None else set()
    return tuple(_sighting(scene, viewer, state, numbers, alike) for state in recognised)


def _sighting(scene: Scene, viewer: str, state: ObjectState, numbers: dict[str, int], alike: set[str]) -> Sighting:
    solid, accuracy = scene.world.solids[state.object], scene.world.solids[viewer].accuracy
    noise = random.Random(f"{viewer} {state.object} {scene.time:.2f}")
    lands_on = state.support if state.support in scene.world.solids and state.support not in numbers else None

    def measured(value: float, multiple: float = 1.0) -> float:
        return value + noise.gauss(0.0, accuracy * multiple)

    return Sighting(
        type=solid.type,
        values={path: measured(value, SIZE_NOISE) if isinstance(value, float) else value for path, value in looks(solid)},
        robot=solid.role is Role.ROBOT,
        furniture=solid.role in FURNITURE,
        alike=state.object in alike,
        x=measured(state.x),
        y=measured(state.y),
        z=measured(state.z),
        yaw=measured(state.yaw, TURN_NOISE),
        support=lands_on,
        container=state.container,
        held_by=numbers.get(state.held_by) if state.held_by is not None else None,
    )


def looks(solid: Solid) -> Iterator[tuple[str, Value]]:
    """The colour, the form and the sizes of a solid, by attribute path."""
    if solid.color is not None:
        yield "Color", solid.color
    yield "Shape.Form", solid.form
    match solid.form:
        case "Box":
            yield from (("Shape.Width", solid.width), ("Shape.Depth", solid.depth), ("Shape.Height", solid.height))
        case "Cylinder":
            yield from (("Shape.Radius", solid.radius), ("Shape.Height", solid.height))


def look_alikes(scene: Scene, like: Likeness) -> Iterator[str]:
    """The things and robots of the likeness."""
    for solid in scene.world.by_role(*RECOGNISED):
        if _looks_like(solid, like, scene.world.ontology):
            yield solid.name


def are_alike(solid: Solid, other: Solid, ontology: Ontology) -> bool:
    """Whether two solids cannot be told apart: one's type is the other's or a super-type of it, and their looks agree."""
    return _looks_like(solid, Likeness(type=other.type, values=dict(looks(other))), ontology)


def _looks_like(solid: Solid, like: Likeness, ontology: Ontology) -> bool:
    related = ontology.is_subtype(solid.type, like.type) or ontology.is_subtype(like.type, solid.type)
    return related and all(_is_alike(value, like.values.get(path)) for path, value in looks(solid))


def _is_alike(value: Value, sought: Value | None) -> bool:
    if isinstance(value, float) and isinstance(sought, float):
        return abs(value - sought) <= ALIKE
    return sought is None or value == sought
