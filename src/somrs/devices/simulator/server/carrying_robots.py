"""Where somebody can put a simulated robot: on a floor, clear of all that stands there and of other robots."""

from __future__ import annotations

import math
from collections.abc import Iterable

from somrs.devices.simulator.motion.driving import MARGIN, things_on_floor
from somrs.devices.simulator.motion.robot import STOREY, Robot
from somrs.devices.simulator.motion.traffic import GAP
from somrs.ontology.objects import Object
from somrs.space.free_space import FreeSpace
from somrs.space.solids import Point


def why_no_room(robot: Robot, point: Point, level: float, free_space: FreeSpace, robots: Iterable[Robot]) -> str | None:
    """Why a robot cannot be put at a point on a floor; None if it can."""
    radius = robot.size.radius
    if robot.holding is not None:
        return f"it holds {robot.holding}; let it put that down first"
    for present_robot in robots:
        is_near = abs(present_robot.level - level) < STOREY and present_robot is not robot
        if is_near and math.dist(present_robot.pose()[:2], point) < radius + present_robot.size.radius + GAP:
            return f"{present_robot.name} stands there"
    if any(disc.distance(point) < radius for disc in things_on_floor(robot.scene, level)):
        return "something stands there on the floor"
    if not free_space.free(point, radius + MARGIN):
        return "there is no floor, or something stands there"
    return None


def put_at(object: Object, x: float, y: float, z: float, yaw: float, charge: float) -> Object:
    """The object of a robot at another pose, with this charge."""
    pose = {"PositionX": x, "PositionY": y, "PositionZ": z, "RotationZ": yaw}
    return Object(name=object.name, type=object.type, values={**object.values, **pose, "Charge": charge})
