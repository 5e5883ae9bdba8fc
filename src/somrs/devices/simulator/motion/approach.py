"""Which of some points a robot gets to best, by the ways that traffic has now: the nearest one may be behind a wall, or a shut door."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from somrs.devices.simulator.motion.robot import Robot
from somrs.space.distances import Array
from somrs.traffic.layout import SPEED
from somrs.traffic.ways import in_sight

CHUNK = 400
"""How many points are ranked by the ways to them at a time."""
HERE = 0.02
"""A robot that is this near to a point is there, m."""


def ranked(robot: Robot, points: Array, costs: Array, per_metre: float) -> Iterator[int]:
    """The indices of points (n, 2) on the robot's floor to which a way leads, best first: those with the lowest `costs` (n), and as much
    more for each metre of the way.

    If no way leads to any of them, all of them, by their distances: who drives there is told why not. Of many points, only those that are
    nearest in a straight line are compared by their ways at a time.
    """
    x, y, _ = robot.pose()
    distances = np.hypot(points[:, 0] - x, points[:, 1] - y)
    order = np.argsort(costs + per_metre * distances, kind="stable")
    is_any_reached = False
    for first in range(0, len(order) if robot.road.takes_part else 0, CHUNK):
        chunk = order[first : first + CHUNK]
        lengths = _lengths(robot, points[chunk])
        lengths[distances[chunk] < HERE] = 0.0
        whole_costs = costs[chunk] + per_metre * lengths
        is_reached = np.isfinite(whole_costs)
        is_any_reached |= bool(is_reached.any())
        yield from chunk[is_reached][np.argsort(whole_costs[is_reached], kind="stable")].tolist()
    if not is_any_reached:
        yield from order.tolist()


def _lengths(robot: Robot, points: Array) -> Array:
    """How far the robot drives to each of the points, m; infinite where no way leads."""
    space, radius = robot.free_space, robot.size.radius
    return robot.road.driving_times(points, lambda starts, ends: in_sight(space, radius, starts, ends)) * SPEED
