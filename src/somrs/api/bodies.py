"""The shapes, colours and positions of the objects of a map, as needed to draw them in three dimensions or from above."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import msgspec

from somrs.devices.simulator.world.colours import colour_of
from somrs.errors import SimulationError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology, Value
from somrs.space.dimensions import FINGER, dimensions_of
from somrs.space.solids import Point, Role, Solid, role_of, solid_of

PLACEMENT_RELATIONS = ("isOn", "isIn", "isHeldBy")
"""The relations that locate an object by another: what it is on, in, or held by."""
_FURNITURE = "furniture"
_KINDS = {Role.MARK: "place", Role.SUPPORT: _FURNITURE, Role.STATIC: _FURNITURE}


MAX_OVERHANG = 0.15
"""How far an object may stick out beyond the object that it stands on, m."""


class Arm(msgspec.Struct, frozen=True, kw_only=True):
    """The dimensions of a robot's arm, m."""

    hang: float
    """Distance from the boom down to the finger tips."""
    finger: float
    """Length of a finger."""
    lift: float
    """Default height of the boom, for when the robot's pose is not known."""
    reach: float
    """Default distance of the hand from the robot, for when its pose is not known."""


class Placement(msgspec.Struct, frozen=True, kw_only=True):
    """The location of an object relative to another: what it is on, in or held by, according to `relation`."""

    relation: str
    object: str


class Body(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """An object that occupies space: an upright prism with the centre of its underside at x, y, z, rotated by yaw. Metres and radians.

    `kind`: floor, wall, door, furniture, thing, robot, lift, camera or place.
    """

    name: str
    type: str
    kind: str
    form: str
    """Box, Cylinder or Polygon."""
    x: float
    y: float
    z: float
    yaw: float
    width: float = 0.0
    depth: float = 0.0
    height: float = 0.0
    radius: float = 0.0
    outline: tuple[Point, ...] = ()
    color: str = "#999999"
    label: str | None = None
    """The object's label; for a floor, the label of its room."""
    storey: str | None = None
    """For a floor: the label of its storey."""
    open: bool = False
    pitch: float = 0.0
    """For a camera: angle below the horizontal."""
    view: float = 0.0
    """For a camera: angle of its field of view."""
    sight: float = 0.0
    """For a camera: its range."""
    arm: Arm | None = None
    placement: Placement | None = msgspec.field(default=None, name="at")
    unknown: bool = False
    """Its position is not known; it is shown at its last known position."""


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """The bodies to draw. `types`: for each type, its ancestors, nearest first. `problems`: the objects that cannot be drawn, and why."""

    version: int
    title: str
    bodies: tuple[Body, ...]
    types: dict[str, tuple[str, ...]]
    problems: tuple[str, ...] = ()


def scene_of(map: Map, version: int, ontology: Ontology, objects: Iterable[Object]) -> Scene:
    """The scene of those of the objects that occupy space."""
    bodies: list[Body] = []
    problems: list[str] = []
    for object in objects:
        try:
            solid = solid_of(object, ontology)
        except SimulationError as error:
            problems.append(str(error))
            continue
        if solid is not None and solid.role is not Role.PART:  # its whole is drawn with its parts
            bodies.append(_body(object, _place_solid(solid, map, ontology), map, ontology))
    types = {type: tuple(ontology.ancestors(type)) for type in {body.type for body in bodies}}
    return Scene(version=version, title=_title(map), bodies=tuple(bodies), types=types, problems=tuple(problems))


def _body(object: Object, solid: Solid, map: Map, ontology: Ontology) -> Body:
    red, green, blue, _ = (round(255 * part) for part in colour_of(solid))
    label = object.values.get("Label")
    if label is None and solid.role is Role.FLOOR:
        label = _room(solid.name, map, ontology)
    size, camera = dimensions_of(solid), solid.role is Role.CAMERA
    return Body(
        name=solid.name,
        type=solid.type,
        kind=_KINDS.get(solid.role, solid.role.value),
        form=solid.form,
        x=solid.x,
        y=solid.y,
        z=solid.z,
        yaw=solid.yaw,
        width=solid.width,
        depth=solid.depth,
        height=solid.height,
        radius=solid.radius,
        outline=solid.outline,
        color=f"#{red:02x}{green:02x}{blue:02x}",
        label=None if label is None else str(label),
        storey=_storey(solid.name, map, ontology) if solid.role is Role.FLOOR else None,
        open=solid.open,
        pitch=solid.pitch if camera else 0.0,
        view=solid.view if camera else 0.0,
        sight=solid.sight if camera else 0.0,
        arm=Arm(hang=size.hang, finger=FINGER, lift=size.clear + size.hang, reach=size.drawn_in) if solid.gripper else None,
        placement=_find_placement(solid.name, map),
        unknown=object.values.get("Unknown") is True,
    )


def _room(floor: str, map: Map, ontology: Ontology) -> Value | None:
    """The label of the room that a floor is part of."""
    room = map.objects.get(map.whole(floor) or "")
    return room.values.get("Label", room.name) if room is not None and ontology.is_subtype(room.type, "Space") else None


def _storey(floor: str, map: Map, ontology: Ontology) -> str | None:
    """The label of the storey that a floor is part of, directly or indirectly."""
    visited, whole = {floor}, map.whole(floor)
    while whole is not None and whole in map.objects and whole not in visited:
        if ontology.is_subtype(map.objects[whole].type, "Storey"):
            return str(map.objects[whole].values.get("Label", whole))
        visited.add(whole)
        whole = map.whole(whole)
    return None


def _find_placement(name: str, map: Map) -> Placement | None:
    for relation in PLACEMENT_RELATIONS:
        for arguments in map.facts_with(relation, 0, name):
            return Placement(relation=relation, object=arguments[1])
    return None


def _place_solid(solid: Solid, map: Map, ontology: Ontology) -> Solid:
    """The solid, moved to where its relations locate it if its stored position contradicts them.

    The position of a thing may be older than its relations: a service that moves it does not have to measure where it ends up.
    """
    placement = _find_placement(solid.name, map) if solid.role is Role.THING else None
    base_object = map.objects.get(placement.object) if placement is not None else None
    if placement is None or base_object is None:
        return solid
    try:
        base_solid = solid_of(base_object, ontology)
    except SimulationError:  # `scene_of` reports the problem with the base object itself
        return solid
    if base_solid is None or (
        placement.relation != "isHeldBy"
        and base_solid.distance(solid.x, solid.y) < MAX_OVERHANG
        and abs(base_solid.top - solid.z) < MAX_OVERHANG
    ):
        return solid
    return replace(solid, x=base_solid.x, y=base_solid.y, z=base_solid.z if placement.relation == "isIn" else base_solid.top)


def movers(map: Map, ontology: Ontology) -> Iterator[Object]:
    """The objects that can move by themselves or be moved, and the lifts, whose cabins move."""
    for type in ontology.types:
        names = map.of_type(type)
        if names and role_of(Object(name="", type=type), ontology) in (Role.ROBOT, Role.THING, Role.LIFT):
            yield from (map.objects[name] for name in names)


def _title(map: Map) -> str:
    """The label of the root object of the map, such as the building."""
    for name in map.roots():
        if name in map.objects:
            return str(map.objects[name].values.get("Label", name))
    return ""
