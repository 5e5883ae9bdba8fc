"""How far a simulated robot would have to drive, for quotes: from where it is to one thing after the other."""

from __future__ import annotations

import math

from somrs.devices.simulator.link.lines import Through
from somrs.devices.simulator.motion.clearance import Disc
from somrs.devices.simulator.motion.driving import MARGIN
from somrs.devices.simulator.motion.navigation import Pose
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.solids import Point, Role
from somrs.errors import UsageError

ELEVATION = 0.8
"""At which height a mere point is taken to be reached, m."""


def leg_lengths(simulation: Simulation, robot: str, through: Through) -> tuple[float | None, ...]:
    """Metres of driving to reach the first, from there the next, and so on; None from where there is no way.

    Robots that can move will have moved; those that cannot are in the way.
    """
    if robot not in simulation.robots:
        raise UsageError(f"there is no robot {robot}; there are {', '.join(simulation.robots) or 'none'}")
    one = simulation.robots[robot]
    broken = [(other.pose(), other.size.radius) for other in one.others() if not other.mobile]
    others = [Disc(x, y, radius) for (x, y, _), radius in broken]
    lengths: list[float | None] = []
    here: Point | None = one.pose()[:2]
    for stop in through:
        stand = _stand(simulation, one, here, stop, others) if here is not None else None
        if here is None or stand is None:
            lengths.append(None)
            here = None
            continue
        lengths.append(one.navigator.distance(here, stand, one.size.radius + MARGIN, others))
        here = stand
    return tuple(lengths)


def _stand(simulation: Simulation, robot: Robot, here: Point, stop: str | Point, others: list[Disc]) -> Point | None:
    """Where the robot would stand to reach the object or point."""
    plan, radius, reach = robot.navigator, robot.size.radius + MARGIN, (robot.size.nearest, robot.size.farthest)
    poses: list[Pose]
    if not isinstance(stop, str):
        return here if _near(here, stop, reach) else _first(plan.approach(here, stop, radius, reach, others, ELEVATION, limit=1))
    solid = simulation.scene.world.solids.get(stop)
    if solid is None:
        raise UsageError(f"{stop} is not in the simulated world")
    if solid.role is Role.FLOOR and solid.distance(*here) < 0:
        return here
    if solid.role in (Role.THING, Role.MARK, Role.ROBOT, Role.FLOOR):
        seen = simulation.seen(stop)
        poses = plan.approach(here, (seen.x, seen.y), radius, reach, others, seen.z, limit=1)
    else:
        poses = plan.approach_support(here, solid, radius, reach, others, limit=1)
    return _first(poses)


def _near(here: Point, there: Point, reach: tuple[float, float]) -> bool:
    return reach[0] <= math.dist(here, there) <= reach[1]


def _first(poses: list[Pose]) -> Point | None:
    return (poses[0].x, poses[0].y) if poses else None
