"""Motions of robots that take part in traffic by programs of their own: along points, and with velocities.

They keep clear of other robots and of what stands on the floor, as the safety fields of a real robot do: they wait, and go on when the way
is clear again.
"""

from __future__ import annotations

import math

from somrs.devices.simulator.motion.arm import withdraw
from somrs.devices.simulator.motion.driving import MARGIN, NO_NEARER, corner_speed, floor_things, sees, turn_to, turning_speed
from somrs.devices.simulator.motion.robot import COMFORTABLE, GivenUp, Robot, Routine, stand, wrap
from somrs.space.lines import point_distance
from somrs.space.solids import Point

REACHED, PASSED = 0.01, 0.04
"""A robot that is this near to its last point, or to one on the way, has come to it, m."""
CONTACT = 0.01
"""How much nearer to something than its radius the base may come, m."""


def drive_along(robot: Robot, points: tuple[Point, ...], yaw: float | None, speed: float | None, *, backward: bool) -> Routine:
    """Drive in straight lines through the points. Raises GivenUp if something stands in the way that does not move by itself."""
    _need_outside(robot)
    robot.need_drive()
    if robot.arm_out:
        yield from withdraw(robot)
    top_speed = robot.solid.speed if speed is None else min(speed, robot.solid.speed)
    try:
        for index, point in enumerate(points):
            position = robot.pose()[:2]
            if not (sees(robot, position, point, MARGIN) and _is_clear(robot, position, point)):
                raise GivenUp("blocked", f"something stands in the way of {robot.name} to ({point[0]:.2f}, {point[1]:.2f})")
            robot.plan = [position, *points[index:]]
            yield from _drive_line(robot, points[index:], top_speed, math.pi if backward else 0.0)
        yield from stand(robot)
        if yaw is not None:
            yield from turn_to(robot, yaw)
    finally:
        robot.plan, robot.is_obstructed = [], False


def _drive_line(robot: Robot, points: tuple[Point, ...], top_speed: float, turned: float) -> Routine:
    """Drive to the first of the points, and do not slow down there more than the corner needs."""
    start, end = robot.pose()[:2], points[0]
    while True:
        robot.need_drive()
        x, y, yaw = robot.pose()
        dx, dy = end[0] - x, end[1] - y
        distance, is_final = math.hypot(dx, dy), len(points) == 1
        if distance < (REACHED if is_final else PASSED):
            return
        error = 0.0 if is_final and distance < PASSED else wrap(math.atan2(dy, dx) + turned - yaw)
        exit_speed = 0.02 if is_final else corner_speed(start, end, points[1], top_speed)
        allowed = top_speed * max(0.0, math.cos(error)) ** 4 if abs(error) < 1.0 else 0.0
        allowed = min(allowed, math.sqrt(exit_speed**2 + 2 * COMFORTABLE * max(0.0, distance - 0.01)), distance / robot.period)
        blocker = robot.move((dx / distance, dy / distance), allowed, turning_speed(error))
        robot.is_obstructed = blocker is not None and robot.speed == 0.0
        yield


def move_at(robot: Robot, forward: float, turning: float, lasts: float) -> Routine:
    """Drive with velocities for a time, in m/s and rad/s. What stands in the way stops the base, and not its turning."""
    _need_outside(robot)
    robot.need_drive()
    end_time = robot.scene.time + lasts
    try:
        while robot.scene.time < end_time:
            robot.need_drive()
            x, y, yaw = robot.pose()
            sign = math.copysign(1.0, forward)
            direction = sign * math.cos(yaw), sign * math.sin(yaw)
            way = _stopping_way(robot)
            is_clear = forward == 0.0 or _is_clear(robot, (x, y), (x + way * direction[0], y + way * direction[1]))
            robot.move(direction, abs(forward) if is_clear else 0.0, turning)
            robot.is_obstructed = not is_clear  # a robot that comes too near is let pass: the wheels push against nothing
            yield
    finally:
        robot.is_obstructed = False


def _stopping_way(robot: Robot) -> float:
    """How far the base drives until it stands, m."""
    return robot.speed**2 / (2 * COMFORTABLE) + 2 * robot.speed * robot.period + CONTACT


def _is_clear(robot: Robot, start: Point, end: Point) -> bool:
    """Whether the base touches nothing at the end of a straight line, nor what stands on the floor on the way; or comes no nearer."""
    radius = robot.size.radius - CONTACT
    if robot.free_space.clearance(end) < min(radius, robot.free_space.clearance(start)):
        return False
    discs = floor_things(robot, [robot.holding] if robot.holding else [])
    return all(
        point_distance((disc.x, disc.y), start, end) - disc.radius >= min(radius, disc.distance(start)) - NO_NEARER for disc in discs
    )


def _need_outside(robot: Robot) -> None:
    if not robot.is_outside:
        raise GivenUp(
            "not-possible", f"{robot.name} drives where the simulator's traffic lets it: send DriveTo, or hello with outside: true"
        )
