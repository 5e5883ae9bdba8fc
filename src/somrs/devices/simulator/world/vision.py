"""What a camera sees: objects within its range and field of view that no solid hides. Also the stationary cameras."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from somrs.devices.simulator.link.commands import ObjectState, Point
from somrs.devices.simulator.world.scene import Scene
from somrs.devices.simulator.world.stationary import StationaryDevice
from somrs.space.solids import Role, Solid

MAST = 1.05
"""Height of the camera of a robot with an arm, above its underside, m."""
VISIBLE = (Role.THING, Role.ROBOT, Role.SUPPORT, Role.STATIC)
"""The roles of objects that cameras report. Parts of the building only hide other objects."""

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Eye:
    """A camera: position, direction, field of view and range, in metres and radians.

    `nods`: a robot's camera tilts as needed; the field of view of a stationary camera is limited vertically as it is horizontally.
    """

    position: Place
    yaw: float
    pitch: float
    view: float
    sight: float
    nods: bool

    def faces(self, point: Place) -> bool:
        """Whether the point is within range and field of view. Obstacles are not considered."""
        if math.dist(self.position, point) > self.sight:
            return False
        if self.view >= math.tau:
            return True
        dx, dy, dz = (end - start for start, end in zip(self.position, point, strict=True))
        ahead, leftward = dx * math.cos(self.yaw) + dy * math.sin(self.yaw), dy * math.cos(self.yaw) - dx * math.sin(self.yaw)
        if not self.nods:
            ahead, upward = (
                ahead * math.cos(self.pitch) - dz * math.sin(self.pitch),
                ahead * math.sin(self.pitch) + dz * math.cos(self.pitch),
            )
            if abs(math.atan2(upward, ahead)) > self.view / 2:
                return False
        return abs(math.atan2(leftward, ahead)) <= self.view / 2


def eye_of(scene: Scene, name: str) -> Eye:
    """The camera of a robot, or the stationary camera of that name."""
    solid, (x, y, z, yaw) = scene.world.solids[name], scene.pose(name)
    hangs = solid.role is Role.CAMERA
    high = solid.height / 2 if hangs else MAST if solid.gripper else solid.height + 0.05
    return Eye((x, y, z + high), yaw, solid.pitch, solid.view, solid.sight, nods=not hangs)


def visible(scene: Scene, viewer: str, name: str, radius: float | None = None) -> bool:
    """Whether the viewer's camera sees at least a part of the object now."""
    if name == viewer or name not in scene.world.solids:
        return False
    eye = eye_of(scene, viewer)
    first, *other_points = _points(scene, scene.world.solids[name], eye)
    if not eye.faces(first) or (radius is not None and math.dist(eye.position[:2], first[:2]) > radius):
        return False
    transparent = [viewer, name, *([held] if (held := scene.hands.held.get(viewer)) else [])]
    return any(scene.is_unobstructed(eye.position, point, transparent) for point in (first, *other_points))


def view(scene: Scene, viewer: str, radius: float | None = None) -> tuple[ObjectState, ...]:
    """The states of all objects that the viewer's camera sees now, at most `radius` away."""
    names = [solid.name for solid in scene.world.by_role(*VISIBLE)]
    return tuple(scene.observe(name) for name in names if visible(scene, viewer, name, radius))


def clear_points(scene: Scene, viewer: str, points: Sequence[Point]) -> tuple[int, ...]:
    """The numbers of the points that the viewer's camera faces and that nothing hides."""
    eye = eye_of(scene, viewer)
    transparent = [viewer, *([held] if (held := scene.hands.held.get(viewer)) else [])]
    places = [(point.x, point.y, point.z) for point in points]
    return tuple(
        number for number, place in enumerate(places) if eye.faces(place) and scene.is_unobstructed(eye.position, place, transparent)
    )


def _points(scene: Scene, solid: Solid, eye: Eye) -> Iterator[Place]:
    """Points of an object that are checked for visibility: near its middle, near its top, and to its sides."""
    x, y, z, _ = scene.pose(solid.name)
    middle = z + 0.6 * solid.height
    yield x, y, middle
    yield x, y, z + (MAST if solid.gripper else 0.95 * solid.height)
    distance = math.hypot(x - eye.position[0], y - eye.position[1]) or 1.0
    aside = 0.7 * solid.extent / distance
    for side in (-aside, aside):
        yield x - side * (y - eye.position[1]), y + side * (x - eye.position[0]), middle


class StationaryCamera(StationaryDevice):
    """A stationary camera. `view` computes what it sees."""

    refusal = "is a camera: it accepts only Sense and Status"


def looks_towards(scene: Scene, eye: Place, point: Place, ignored: Iterable[str]) -> bool:
    """Whether a camera at `eye` would see the point. Things and robots at the point itself do not hide it."""
    nearby_names = [
        n for n in (*scene.things(), *scene.joints) if math.dist(scene.pose(n)[:2], point[:2]) < scene.world.solids[n].extent + 0.3
    ]
    return scene.is_unobstructed(eye, point, [*ignored, *nearby_names])
