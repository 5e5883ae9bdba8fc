"""What the objects of a map look like and where they are: all that is needed to draw them, in space or from above."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import msgspec

from somrs.devices.simulator.world.colours import colour_of
from somrs.devices.simulator.world.dimensions import FINGER, dimensions_of
from somrs.devices.simulator.world.solids import Point, Role, Solid, role_of, solid_of
from somrs.errors import SimulationError
from somrs.ontology.objects import Map, Object
from somrs.ontology.types import Ontology, Value

PLACEMENT_RELATIONS = ("isOn", "isIn", "isHeldBy")
"""The relations that say where something is, by what it is on, in, or held by."""
FURNITURE = "furniture"
KINDS = {Role.MARK: "place", Role.SUPPORT: FURNITURE, Role.STATIC: FURNITURE}


MAX_OVERHANG = 0.15
"""As far as this, m, what stands on something may stick out."""


class Arm(msgspec.Struct, frozen=True, kw_only=True):
    """How a robot's arm is built, m."""

    hang: float
    """From the boom down to the finger tips."""
    finger: float
    """Length of a finger."""
    lift: float
    """How high the boom is, and how far the hand is out, while nothing else is known."""
    reach: float


class Placement(msgspec.Struct, frozen=True, kw_only=True):
    """Where something is by what it is on, in or held by: `relation` says which."""

    relation: str
    object: str


class Body(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """An object that takes up space: an upright prism with the middle of its underside at x, y, z, turned by yaw. Metres and radians.

    `kind`: floor, wall, door, furniture, thing, robot, camera or place.
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
    """What people call it; of a floor, what the room is called."""
    storey: str | None = None
    """Of a floor: what its storey is called."""
    open: bool = False
    pitch: float = 0.0
    """How far a camera looks down."""
    view: float = 0.0
    """Angle of a camera's field of view, and how far it sees."""
    sight: float = 0.0
    arm: Arm | None = None
    placement: Placement | None = msgspec.field(default=None, name="at")
    unknown: bool = False
    """Nothing is known of where it is; it is shown where it was."""


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """What there is to see. `types`: for each type, its ancestors, nearest first. `problems`: what cannot be drawn, and why."""

    version: int
    title: str
    bodies: tuple[Body, ...]
    types: dict[str, tuple[str, ...]]
    problems: tuple[str, ...] = ()


def scene_of(map: Map, version: int, ontology: Ontology, objects: Iterable[Object]) -> Scene:
    """The objects that take up space, as they are drawn."""
    bodies: list[Body] = []
    problems: list[str] = []
    for object in objects:
        try:
            solid = solid_of(object, ontology)
        except SimulationError as error:
            problems.append(str(error))
            continue
        if solid is not None:
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
        kind=KINDS.get(solid.role, solid.role.value),
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
    """What the room is called that a floor is part of."""
    room = map.objects.get(map.whole(floor) or "")
    return room.values.get("Label", room.name) if room is not None and ontology.is_subtype(room.type, "Space") else None


def _storey(floor: str, map: Map, ontology: Ontology) -> str | None:
    """What the storey is called that a floor is part of, whatever is in between."""
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
    """A thing where its relations say that it is, when it has a position of which they say otherwise: nobody may have measured it since."""
    placement = _find_placement(solid.name, map) if solid.role is Role.THING else None
    base_object = map.objects.get(placement.object) if placement is not None else None
    if placement is None or base_object is None:
        return solid
    try:
        base_solid = solid_of(base_object, ontology)
    except SimulationError:  # its own problem, which is told of it
        return solid
    if base_solid is None or (
        placement.relation != "isHeldBy"
        and base_solid.distance(solid.x, solid.y) < MAX_OVERHANG
        and abs(base_solid.top - solid.z) < MAX_OVERHANG
    ):
        return solid
    return replace(solid, x=base_solid.x, y=base_solid.y, z=base_solid.z if placement.relation == "isIn" else base_solid.top)


def movers(map: Map, ontology: Ontology) -> Iterator[Object]:
    """The objects that can move by themselves or be moved."""
    for type in ontology.types:
        names = map.of_type(type)
        if names and role_of(Object(name="", type=type), ontology) in (Role.ROBOT, Role.THING):
            yield from (map.objects[name] for name in names)


def _title(map: Map) -> str:
    """What the building, or whatever holds all others, is called."""
    for name in map.roots():
        if name in map.objects:
            return str(map.objects[name].values.get("Label", name))
    return ""
