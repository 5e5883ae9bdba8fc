"""Solids: the position and form of physical objects on the map, and their roles in the simulated world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise

from somrs.errors import SimulationError
from somrs.ontology.objects import Object
from somrs.ontology.types import ABSTRACT, Ontology, Value

Point = tuple[float, float]
DENSITY = 1000.0
"""Mass of a cubic metre of a thing of which the map states no weight, kg: that of water."""
SIGHT = 4.0
"""Range of a camera for which the map states none, m."""


class Role(StrEnum):
    """The behaviour of an object in the simulated world, which follows from its type, and of furniture also from its Supporting."""

    IGNORED = "nothing"
    """Abstract, or without a position or a form."""
    MARK = "mark"
    """Only painted on the floor."""
    FLOOR = "floor"
    WALL = "wall"
    DOOR = "door"
    SUPPORT = "support"
    """Things can be put on top of it."""
    STATIC = "static"
    """Does not move, and nothing can be put on it."""
    THING = "thing"
    """Can be carried."""
    PART = "part"
    """Visible only: the object that it is a part of stands for it in all else."""
    ROBOT = "robot"
    CAMERA = "camera"
    """A stationary camera."""
    ZONE = "zone"
    """An area of a floor that is in nobody's way, and in which robots drive slowly or not at all (`zones.py`)."""
    LIFT = "lift"
    """The cabin of a lift: `shafts.py` says what of it is in the way on each storey."""


# The first supertype in this order determines the role, so special types come before general types.
_ROLES = (
    (ABSTRACT, Role.IGNORED),
    ("Ceiling", Role.IGNORED),
    ("Opening", Role.IGNORED),
    ("Place", Role.MARK),
    ("Waypoint", Role.IGNORED),
    ("Station", Role.IGNORED),
    ("Zone", Role.ZONE),
    ("Floor", Role.FLOOR),
    ("Door", Role.DOOR),
    ("Wall", Role.WALL),
    ("Window", Role.WALL),
    ("Support", Role.SUPPORT),
    ("Camera", Role.CAMERA),
    ("Lift", Role.LIFT),
    ("StationaryDevice", Role.SUPPORT),  # things on which the device works are put on it
    ("Graspable", Role.THING),
    ("MobileRobot", Role.ROBOT),
    ("FurnitureLeg", Role.PART),
    ("TableTop", Role.PART),
    ("PhysicalObject", Role.STATIC),
)


CARRYING = (Role.SUPPORT, Role.FLOOR, Role.MARK)
"""The roles of the objects on which robots put things."""
STANDING = (Role.WALL, Role.SUPPORT, Role.STATIC)
"""The roles of the objects around which robots drive, besides shut doors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Solid:
    """An upright prism: the position of the middle of its underside, its heading, form and sizes, in metres and radians on the map."""

    name: str
    type: str
    role: Role
    x: float
    y: float
    z: float
    yaw: float
    form: str
    width: float = 0.0
    depth: float = 0.0
    radius: float = 0.0
    height: float = 0.0
    outline: tuple[Point, ...] = ()
    color: str | None = None
    weight: float = 0.3
    """What it truly weighs, kg. The map may not know, or be mistaken."""
    payload: float = math.inf
    """Weight of the heaviest thing that it lifts, kg."""
    scale: bool = False
    """Whether it weighs what stands on it."""
    open: bool = False
    powered: bool = False
    """Whether it is a door with a drive."""
    automatic: bool = False
    """Whether it is a door that opens by itself for robots that drive through it."""
    charger: bool = False
    container: bool = False
    """Whether things can be put into it, through doors in its front."""
    speed: float = 0.8
    charge: float = 100.0
    """Charge of its battery at the start, percent."""
    gripper: bool = False
    graph: str | None = None
    """The navigation graph whose lanes a robot uses."""
    pitch: float = 0.0
    """Downward inclination of its front, rad."""
    view: float = math.tau
    """Field of view of its camera, rad."""
    sight: float = SIGHT
    """Range of its camera, m."""
    accuracy: float = 0.0
    """Standard deviation of the positions that its camera measures, m."""

    @property
    def top(self) -> float:
        return self.z + self.height

    @property
    def volume(self) -> float:
        """Of the prism, m³."""
        match self.form:
            case "Box":
                return self.width * self.depth * self.height
            case "Polygon":
                corners = zip(self.outline, (*self.outline[1:], self.outline[0]), strict=True)
                return abs(sum(ax * by - bx * ay for (ax, ay), (bx, by) in corners)) / 2 * self.height
        return math.pi * self.radius**2 * self.height

    @property
    def extent(self) -> float:
        """The radius of the smallest circle around its position that contains it, seen from above."""
        match self.form:
            case "Box":
                return math.hypot(self.width, self.depth) / 2
            case "Polygon":
                return max(math.hypot(*corner) for corner in self.outline)
        return self.radius

    def corners(self, sides: int = 24) -> Sequence[Point]:
        """The corners of its outline in its own frame; those of a regular polygon with so many sides for a cylinder."""
        match self.form:
            case "Box":
                width, depth = self.width / 2, self.depth / 2
                return (-width, -depth), (width, -depth), (width, depth), (-width, depth)
            case "Polygon":
                return self.outline
        turns = [side * math.tau / sides for side in range(sides)]
        return [(self.radius * math.cos(turn), self.radius * math.sin(turn)) for turn in turns]

    def world(self, x: float, y: float) -> Point:
        """Transform a point from the solid's own frame to the map."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return self.x + c * x - s * y, self.y + s * x + c * y

    def distance(self, x: float, y: float) -> float:
        """Distance from its outline to a point, seen from above; negative inside. `distances.py` computes it for many points."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        u, v = c * (x - self.x) + s * (y - self.y), c * (y - self.y) - s * (x - self.x)
        match self.form:
            case "Box":
                excess_x, excess_y = abs(u) - self.width / 2, abs(v) - self.depth / 2
                return math.hypot(max(excess_x, 0.0), max(excess_y, 0.0)) + min(max(excess_x, excess_y), 0.0)
            case "Polygon":
                return polygon_distance(self.outline, u, v)
        return math.hypot(u, v) - self.radius


def polygon_distance(outline: Sequence[Point], u: float, v: float) -> float:
    """Signed distance of a point from a polygon's edge, negative inside; the even-odd rule defines the inside."""
    nearest, is_interior = math.inf, False
    for (start_x, start_y), (end_x, end_y) in zip(outline, (*outline[1:], outline[0]), strict=True):
        dx, dy = end_x - start_x, end_y - start_y
        share = min(max(((u - start_x) * dx + (v - start_y) * dy) / (dx * dx + dy * dy or 1.0), 0.0), 1.0)
        nearest = min(nearest, math.hypot(u - start_x - share * dx, v - start_y - share * dy))
        if (start_y > v) != (end_y > v):
            is_interior ^= u < start_x + (v - start_y) / (end_y - start_y) * dx
    return -nearest if is_interior else nearest


def path_length(path: Sequence[Point]) -> float:
    return sum(math.dist(start, end) for start, end in pairwise(path))


def role_of(object: Object, ontology: Ontology) -> Role:
    """The role of the object; `IGNORED` for a type that the ontology does not know.

    Whether things can be put on something that stands still is stated by Supporting. An ontology of an earlier version has no such
    attribute; then the type decides.
    """
    role = next((role for ancestor, role in _ROLES if ontology.is_subtype(object.type, ancestor)), Role.IGNORED)
    stated = object.values.get("Supporting")
    supporting = ontology.default(object.type, "Supporting") if stated is None else stated
    if role not in (Role.SUPPORT, Role.STATIC) or supporting is None:
        return role
    return Role.SUPPORT if supporting else Role.STATIC


def solid_of(object: Object, ontology: Ontology) -> Solid | None:
    """The solid of an object, with its type's defaults for missing values; None if its position or form is unknown.

    Raises SimulationError for values from which no solid can be made.
    """
    role = role_of(object, ontology)
    return _make(object, ontology, role) if role not in (Role.IGNORED, Role.ZONE) else None


def area_of(object: Object, ontology: Ontology) -> Solid | None:
    """The area of a zone; None if its position or form is unknown. Raises SimulationError for values that make none."""
    area = _make(object, ontology, Role.ZONE)
    if area is not None and area.extent <= 0:
        raise SimulationError(f"{object.name}: a {object.type} without extent is no zone; give it a Shape in the map")
    return area


def _make(object: Object, ontology: Ontology, role: Role) -> Solid | None:
    def value(path: str) -> Value | None:
        own_value = object.values.get(path)
        return ontology.default(object.type, path) if own_value is None else own_value

    def number(path: str, otherwise: float = 0.0) -> float:
        attribute_value = value(path)
        if attribute_value is None:
            return otherwise
        if isinstance(attribute_value, str) or not math.isfinite(attribute_value):
            raise SimulationError(f"{object.name}: {path} must be a finite number, not {attribute_value!r}; correct it in the map")
        return float(attribute_value)

    form = value("Shape.Form")
    if form is None or value("PositionX") is None or value("PositionY") is None:
        return None
    color = value("Color")
    gripper = ontology.is_subtype(object.type, "MobileManipulator")
    solid = Solid(
        name=object.name,
        type=object.type,
        role=role,
        x=number("PositionX"),
        y=number("PositionY"),
        z=number("PositionZ"),
        yaw=number("RotationZ"),
        form=str(form),
        width=number("Shape.Width"),
        depth=number("Shape.Depth"),
        radius=number("Shape.Radius"),
        height=number("Shape.Height"),
        outline=_outline(object.name, str(value("Shape.Outline") or "")) if form == "Polygon" else (),
        color=None if color is None else str(color),
        weight=number("Weight"),
        payload=number("Payload", math.inf),
        scale=ontology.is_subtype(object.type, "Scale"),
        open=bool(value("Open")),
        powered=role is Role.DOOR and (ontology.driver(object.type) is not None or ontology.is_subtype(object.type, "LiftDoor")),
        automatic=ontology.is_subtype(object.type, "AutomaticDoor"),
        charger=ontology.is_subtype(object.type, "Charger"),
        container=ontology.is_subtype(object.type, "Cupboard"),
        speed=number("Speed", 0.8),
        charge=number("Charge", 100.0),
        gripper=gripper,
        graph=None if value("NavigationGraph") is None else str(value("NavigationGraph")),
        pitch=number("RotationY"),
        view=number("FieldOfView", math.tau),
        sight=SIGHT if gripper else number("OperationRange", SIGHT),  # a manipulator's OperationRange is that of its arm
        accuracy=number("Accuracy"),
    )
    if value("Weight") is None:
        solid = replace(solid, weight=DENSITY * solid.volume)
    if role not in (Role.MARK, Role.ZONE) and (solid.extent <= 0 or solid.height <= 0):
        raise SimulationError(f"{object.name}: a {object.type} without extent cannot be built; give it a Shape in the map")
    return solid


def _outline(name: str, text: str) -> tuple[Point, ...]:
    try:
        corners = tuple((float(x), float(y)) for x, y in (corner.split(",") for corner in text.split()))
    except ValueError:
        corners = ()
    if len(corners) < 3 or not all(math.isfinite(value) for corner in corners for value in corner):
        raise SimulationError(f'{name}: Shape.Outline must be three or more corners such as "0,0 4,0 4,3", not "{text}"')
    return corners
