"""Driving: a robot follows a path around static obstacles, gives way to moving robots, and never collides."""

from __future__ import annotations

import math
from collections.abc import Collection, Generator, Sequence
from itertools import pairwise

import numpy as np

from somrs.devices.simulator.motion.robot import BRAKING, GivenUp, Robot, Routine, wait, wrap
from somrs.devices.simulator.motion.traffic import GAP, Capsule
from somrs.space.clearance import Disc
from somrs.space.lines import path_distance, point_distance
from somrs.space.solids import Point, path_length

PATIENCE = 45.0
"""Time after which a robot without progress gives up, s."""
MARGIN = 0.03
"""Distance of a planned path from obstacles, beyond the robot's radius, m."""
NEAR_FLOOR = 0.3
"""Things whose underside is lower than this are obstacles, m."""


def floor_things(robot: Robot, ignored: Collection[str] = ()) -> list[Disc]:
    """Things that stand on the robot's floor, as discs."""
    discs = []
    for thing in robot.scene.things():
        x, y, z, _ = robot.scene.pose(thing)
        if thing not in ignored and robot.scene.hands.holder(thing) is None and -0.1 < z - robot.solid.z < NEAR_FLOOR:
            support = robot.scene.support_below(x, y, z + 0.02)
            if support is None or support.top - robot.solid.z < 0.05:
                discs.append(Disc(x, y, robot.scene.world.solids[thing].extent))
    return discs


def robot_discs(robots: Collection[Robot]) -> list[Disc]:
    """The current claims of the robots, as discs."""
    discs = []
    for robot in robots:
        for claim in robot.claims():
            steps = max(1, math.ceil(math.dist(claim.start, claim.end) / 0.15))
            for i in range(steps + 1):
                x = claim.start[0] + (claim.end[0] - claim.start[0]) * i / steps
                y = claim.start[1] + (claim.end[1] - claim.start[1]) * i / steps
                discs.append(Disc(x, y, claim.radius + GAP))
    return discs


def _route(robot: Robot, goal: Point, robots: Collection[Robot]) -> list[Point] | None:
    """A path around static obstacles, things on the floor, and the given robots; None if there is none."""
    x, y, _ = robot.pose()
    discs = [*floor_things(robot, [robot.holding] if robot.holding else []), *robot_discs(robots)]
    near_discs = [disc for disc in discs if math.hypot(disc.x - x, disc.y - y) < disc.radius + robot.size.radius + MARGIN]
    # A robot that is already too near to a disc must be able to leave, so that disc shrinks until it does not touch the robot.
    for disc in near_discs:
        gap = math.hypot(disc.x - x, disc.y - y) - robot.size.radius - MARGIN - 0.005
        discs[discs.index(disc)] = Disc(disc.x, disc.y, max(0.01, gap))
    return robot.navigator.path((x, y), goal, robot.size.radius + MARGIN, discs)


def drive_to(robot: Robot, goal: Point, yaw: float | None = None, patience: float = PATIENCE) -> Routine:
    """Drive to the goal, then turn to `yaw`. Raises GivenUp when there is no path, or other robots block it for `patience` seconds.

    The path ignores robots that are driving, since most have moved on when this robot gets there. After an encounter it avoids the
    robot that was met; if that is impossible, the robot with less right of way makes way.
    """
    waited, best = 0.0, math.inf
    met_robot: Robot | None = None
    try:
        while math.dist(robot.pose()[:2], goal) > 0.015:
            robot.need_drive()
            parked = [other_robot for other_robot in robot.other_robots() if not other_robot.plan]
            path = _route(robot, goal, [*parked, met_robot] if met_robot is not None and met_robot.plan else parked)
            if path is None:
                obstacle = _culprit(robot, goal, parked, met_robot)
                waited += yield from _unblock(robot, obstacle, patience)
                met_robot = None
            else:
                if path_length(path) < best - 0.3:
                    best, waited = path_length(path), 0.0
                met_robot = yield from _follow(robot, path)
                if met_robot is None:
                    continue
                obstacle = met_robot
                waited += yield from _wait_for(robot, met_robot)
            if waited > patience:
                cause = f" by {obstacle.name}" if obstacle is not None else ""
                raise GivenUp("blocked", f"the path of {robot.name} to ({goal[0]:.2f}, {goal[1]:.2f}) is blocked{cause}")
        if yaw is not None:
            yield from turn_to(robot, yaw)
    finally:
        robot.plan = []


def _culprit(robot: Robot, goal: Point, parked: list[Robot], met_robot: Robot | None) -> Robot | None:
    """The robot that blocks the path; None if several block it together. Sets `robot.plan` to the path without other robots.

    Raises GivenUp when there is no path even without them.
    """
    free_path = _route(robot, goal, ())
    if free_path is None:
        raise GivenUp("unreachable", f"{robot.name} finds no path to ({goal[0]:.2f}, {goal[1]:.2f})")
    robot.plan = free_path
    if met_robot is not None and _route(robot, goal, parked) is not None:
        return met_robot
    alternatives = ((candidate, [other_robot for other_robot in parked if other_robot is not candidate]) for candidate in parked)
    return next((candidate for candidate, rest in alternatives if _route(robot, goal, rest) is not None), None)


def turn_to(robot: Robot, yaw: float) -> Routine:
    """Turn on the spot."""
    for _ in range(500):
        robot.need_drive()
        error = wrap(yaw - robot.pose()[2])
        if abs(error) < 0.01:
            return
        robot.move((math.cos(robot.pose()[2]), math.sin(robot.pose()[2])), 0.0, _turning(error))
        yield


def _turning(error: float) -> float:
    """The turning speed for a heading error, rad/s: the base stops at the heading without overshooting."""
    return math.copysign(min(4.0 * abs(error), math.sqrt(2 * 3.0 * abs(error))), error)


def _follow(robot: Robot, path: Sequence[Point]) -> Generator[None, None, Robot | None]:
    """Follow the path. Returns None at its end, or when obstacles changed, or the robot that has blocked it for a while."""
    corner, stall_count = 1 if len(path) > 1 else 0, 0
    navigator = robot.navigator
    while robot.navigator is navigator:
        robot.need_drive()
        x, y, yaw = robot.pose()
        robot.plan = [(x, y), *path[corner:]]
        dx, dy = path[corner][0] - x, path[corner][1] - y
        distance, is_final = math.hypot(dx, dy), corner == len(path) - 1
        if distance < (0.01 if is_final else 0.04):
            if is_final:
                return None
            corner += 1
            continue
        direction = (dx / distance, dy / distance)
        error = wrap(math.atan2(dy, dx) - yaw)
        if is_final and distance < 0.04:
            error = 0.0  # so near to the goal, the direction is mostly noise
        allowed = robot.solid.speed * max(0.0, math.cos(error)) ** 4 if abs(error) < 1.0 else 0.0
        exit_speed = 0.02 if is_final else _corner_speed(robot, path[corner - 1], path[corner], path[corner + 1])
        allowed = min(allowed, math.sqrt(exit_speed * exit_speed + 2 * 0.6 * BRAKING * max(0.0, distance - 0.01)))
        allowed = min(allowed, distance / robot.period)  # not past the corner within this period
        obstacle = robot.move(direction, allowed, _turning(error))
        stall_count = stall_count + 1 if obstacle is not None and robot.speed < 0.03 else 0
        if stall_count > 25 and obstacle is not None:
            return obstacle
        yield
    return None


def _corner_speed(robot: Robot, previous_point: Point, corner: Point, next_point: Point) -> float:
    """The largest speed at a corner of the path, m/s."""
    heading = math.atan2(corner[1] - previous_point[1], corner[0] - previous_point[0])
    bend = wrap(math.atan2(next_point[1] - corner[1], next_point[0] - corner[0]) - heading)
    return max(0.08, robot.solid.speed * max(0.0, math.cos(bend)) ** 6)


def _yields_to(robot: Robot, other_robot: Robot) -> bool:
    """Whether `robot` makes way for `other_robot`. An idle robot makes way for a driving one.

    Of two driving robots, the one that stands on the other's goal makes way, otherwise the one with the greater name.
    """
    if not robot.plan or not other_robot.plan:
        return bool(other_robot.plan)
    mine, theirs = _stands_on_goal(other_robot, robot), _stands_on_goal(robot, other_robot)
    return mine if mine != theirs else robot.name > other_robot.name


def _stands_on_goal(robot: Robot, other_robot: Robot) -> bool:
    return math.dist(robot.pose()[:2], other_robot.plan[-1]) < robot.size.radius + other_robot.size.radius + GAP


def _wait_for(robot: Robot, other_robot: Robot) -> Generator[None, None, float]:
    """Wait for a robot that blocks the path, and retreat from it. Returns the seconds waited."""
    start = robot.scene.time
    yield from wait(robot, 1.6 if _yields_to(robot, other_robot) else 0.2)
    yield from _retreat(robot, other_robot)
    return robot.scene.time - start


def _retreat(robot: Robot, other_robot: Robot) -> Routine:
    """Move away from another robot until there is a path around it, as far as there is space behind."""
    for _ in range(100):
        robot.need_drive()
        x, y, _ = robot.pose()
        nearest = min(other_robot.claims(), key=robot.base_claim().gap)
        gap = Capsule((x, y), (x, y), robot.size.radius).gap(nearest)
        tx, ty = (nearest.start[i] + nearest.end[i] for i in (0, 1))
        way = math.hypot(x - tx / 2, y - ty / 2)
        direction = ((x - tx / 2) / way, (y - ty / 2) / way)
        retreat_point = (x + 0.1 * direction[0], y + 0.1 * direction[1])
        things = floor_things(robot, [robot.holding] if robot.holding else [])
        if gap > GAP + MARGIN + 0.06 or not robot.navigator.free(retreat_point, robot.size.radius + MARGIN, things):
            return
        robot.move(direction, 0.15, 0.0)
        yield


def _unblock(robot: Robot, other_robot: Robot | None, patience: float) -> Generator[None, None, float]:
    """Resolve a blocked path: make way, ask the other robot to make way, or wait. Returns the seconds that count as waiting."""
    if other_robot is not None and _yields_to(robot, other_robot) and other_robot.mobile:
        if (yield from make_way(robot, other_robot)):
            return patience / 8
    elif other_robot is not None and not other_robot.plan and other_robot.mobile and other_robot.activity is None:
        other_robot.asking_robot = robot
    yield from wait(robot, 0.5)
    return 0.5


def ask_aside(robot: Robot, place: Point) -> Routine:
    """Ask idle robots to leave a place and the path to it."""
    robot.plan = _route(robot, place, ()) or [robot.pose()[:2], place]
    for other_robot in robot.other_robots():
        room = robot.size.radius + other_robot.size.radius + 0.12
        idle = other_robot.activity is None and not other_robot.plan and other_robot.mobile
        if idle and path_distance([other_robot.pose()[:2]], robot.plan) < room:
            other_robot.asking_robot = robot
    yield from wait(robot, 0.5)
    robot.plan = []


def make_way(robot: Robot, other_robot: Robot) -> Generator[None, None, bool]:
    """Leave the path of another robot, and wait until it has passed. Returns False if there is no refuge, or the other is not driving."""
    if not other_robot.plan:
        return False
    refuge, goal = _refuge(robot, other_robot), robot.plan[-1] if robot.plan else None
    if refuge is None:
        return False
    met_robot = yield from _follow(robot, refuge)
    for _ in range(60):
        robot.need_drive()
        if met_robot is not None or not other_robot.plan or not other_robot.mobile:
            break
        yield from wait(robot, 0.25)
        mine = (_route(robot, goal, ()) if goal is not None else None) or [robot.pose()[:2]]
        if (
            other_robot.plan
            and path_distance(_beginning(mine), _beginning(other_robot.plan)) > robot.size.radius + other_robot.size.radius + 0.1
        ):
            break
    robot.plan = []
    return True


def _beginning(path: Sequence[Point], way: float = 3.0) -> list[Point]:
    """The first `way` metres of a path."""
    points = [path[0]]
    for start, end in pairwise(path):
        step = math.dist(start, end)
        if step >= way:
            share = way / step
            return [*points, (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))]
        points.append(end)
        way -= step
    return points


def _refuge(robot: Robot, other_robot: Robot) -> list[Point] | None:
    """A path to a near place that is off the other robot's path; None if there is none."""
    x, y, _ = robot.pose()
    room = robot.size.radius + other_robot.size.radius + 0.12
    discs = [*floor_things(robot), *robot_discs(robot.other_robots())]
    candidates = []
    for radius in (0.5, 0.8, 1.2, 1.7, 2.4, 3.2, 4.2, 5.5):
        for angle in np.arange(16) * math.pi / 8:
            point = (x + radius * math.cos(angle), y + radius * math.sin(angle))
            aside = all(point_distance(point, start, end) > room for start, end in pairwise(other_robot.plan))
            footprint = Capsule(point, point, robot.size.radius + 0.05)
            if aside and all(footprint.gap(Capsule((d.x, d.y), (d.x, d.y), d.radius)) > 0 for d in discs):
                candidates.append(point)
    fallback: list[Point] | None = None
    attempt_count = 0
    for point in candidates:
        if attempt_count > 80:
            break
        if not robot.navigator.free(point, robot.size.radius + MARGIN):
            continue
        attempt_count += 1
        path = _route(robot, point, robot.other_robots())
        if path is None:
            continue
        # The part of its path that the other robot drives until this robot has reached the refuge.
        ahead = _beginning(other_robot.plan, 0.5 + other_robot.solid.speed * path_length(path) / robot.solid.speed)
        if path_distance(path, ahead) > robot.size.radius + other_robot.size.radius + 0.1:
            return path
        if fallback is None and math.dist(point, other_robot.plan[0]) > math.dist((x, y), other_robot.plan[0]):
            fallback = path
    return fallback
