"""Driving distances of a simulated robot, for quotes: from its position through a sequence of stops."""

from __future__ import annotations

import math

from somrs.devices.simulator.link.lines import Stops
from somrs.devices.simulator.motion.clearance import Disc
from somrs.devices.simulator.motion.driving import MARGIN
from somrs.devices.simulator.motion.navigation import Pose
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.solids import Point, Role
from somrs.errors import UsageError

ELEVATION = 0.8
"""Height at which the arm reaches a stop that is a point, m."""


def leg_lengths(simulation: Simulation, robot: str, stops: Stops) -> tuple[float | None, ...]:
    """Driving distances in metres to the first stop, from there to the next, and so on; None from the first leg without a path on.

    Other robots count as obstacles only if they cannot move. Raises UsageError for an unknown robot or object.
    """
    if robot not in simulation.robots:
        raise UsageError(f"there is no robot {robot}; there are {', '.join(simulation.robots) or 'none'}")
    device = simulation.robots[robot]
    broken = [(other_robot.pose(), other_robot.size.radius) for other_robot in device.other_robots() if not other_robot.mobile]
    discs = [Disc(x, y, radius) for (x, y, _), radius in broken]
    lengths: list[float | None] = []
    position: Point | None = device.pose()[:2]
    for stop in stops:
        stand = _stand(simulation, device, position, stop, discs) if position is not None else None
        if position is None or stand is None:
            lengths.append(None)
            position = None
            continue
        lengths.append(device.navigator.distance(position, stand, device.size.radius + MARGIN, discs))
        position = stand
    return tuple(lengths)


def _stand(simulation: Simulation, robot: Robot, position: Point, stop: str | Point, discs: list[Disc]) -> Point | None:
    """The position from which the robot would reach the object or point; None if there is none."""
    plan, radius, reach = robot.navigator, robot.size.radius + MARGIN, (robot.size.nearest, robot.size.farthest)
    poses: list[Pose]
    if not isinstance(stop, str):
        return (
            position
            if _is_reachable(position, stop, reach)
            else _first(plan.approach(position, stop, radius, reach, discs, ELEVATION, limit=1))
        )
    solid = simulation.scene.world.solids.get(stop)
    if solid is None:
        raise UsageError(f"{stop} is not in the simulated world")
    if solid.role is Role.FLOOR and solid.distance(*position) < 0:
        return position
    if solid.role in (Role.THING, Role.MARK, Role.ROBOT, Role.FLOOR):
        object_state = simulation.observe(stop)
        poses = plan.approach(position, (object_state.x, object_state.y), radius, reach, discs, object_state.z, limit=1)
    else:
        poses = plan.approach_support(position, solid, radius, reach, discs, limit=1)
    return _first(poses)


def _is_reachable(position: Point, target: Point, reach: tuple[float, float]) -> bool:
    return reach[0] <= math.dist(position, target) <= reach[1]


def _first(poses: list[Pose]) -> Point | None:
    return (poses[0].x, poses[0].y) if poses else None
