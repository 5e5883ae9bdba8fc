"""How a robot gets somewhere: along a path around what stands still, giving way to what moves, never into anything."""

from __future__ import annotations

import math
from collections.abc import Collection, Generator, Sequence
from itertools import pairwise

import numpy as np

from somrs.devices.simulator.motion.clearance import Disc
from somrs.devices.simulator.motion.robot import BRAKING, GivenUp, Robot, Routine, wait, wrap
from somrs.devices.simulator.motion.traffic import GAP, Capsule, length, path_distance, point_distance
from somrs.devices.simulator.world.solids import Point

PATIENCE = 45.0
"""How long a robot waits and tries without getting nearer, s."""
MARGIN = 0.03
"""What a planned path keeps from obstacles beyond the robot's radius, m."""
NEAR_FLOOR = 0.3
"""Things whose underside is lower than this stand in a robot's way, m."""


def floor_things(robot: Robot, ignored: Collection[str] = ()) -> list[Disc]:
    """Things that stand on the robot's floor."""
    found = []
    for thing in robot.scene.things():
        x, y, z, _ = robot.scene.pose(thing)
        if thing not in ignored and robot.scene.holder(thing) is None and -0.1 < z - robot.solid.z < NEAR_FLOOR:
            below = robot.scene.below(x, y, z + 0.02)
            if below is None or below.top - robot.solid.z < 0.05:
                found.append(Disc(x, y, robot.scene.world.solids[thing].extent))
    return found


def robot_discs(robots: Collection[Robot]) -> list[Disc]:
    """The room of robots as it is now, as discs."""
    found = []
    for robot in robots:
        for claim in robot.claims():
            steps = max(1, math.ceil(math.dist(claim.start, claim.end) / 0.15))
            for i in range(steps + 1):
                x = claim.start[0] + (claim.end[0] - claim.start[0]) * i / steps
                y = claim.start[1] + (claim.end[1] - claim.start[1]) * i / steps
                found.append(Disc(x, y, claim.radius + GAP))
    return found


def route(robot: Robot, goal: Point, around: Collection[Robot]) -> list[Point] | None:
    """A path that keeps clear of everything static, of things on the floor, and of the given robots."""
    x, y, _ = robot.pose()
    discs = [*floor_things(robot, [robot.holding] if robot.holding else []), *robot_discs(around)]
    near = [disc for disc in discs if math.hypot(disc.x - x, disc.y - y) < disc.radius + robot.size.radius + MARGIN]
    # A robot that is too near to something already must be able to leave: what it touches shrinks to what it leaves free.
    for disc in near:
        gap = math.hypot(disc.x - x, disc.y - y) - robot.size.radius - MARGIN - 0.005
        discs[discs.index(disc)] = Disc(disc.x, disc.y, max(0.01, gap))
    return robot.navigator.path((x, y), goal, robot.size.radius + MARGIN, discs)


def drive_to(robot: Robot, goal: Point, yaw: float | None = None, patience: float = PATIENCE) -> Routine:
    """Get to the goal; give up when that is impossible, or when others leave no way for longer than the patience.

    Robots that are on their way are met rather than planned around: they are mostly gone when one gets there. One that is
    met is planned around; if that is impossible, the one with less right of way steps aside.
    """
    waited, best = 0.0, math.inf
    met: Robot | None = None
    try:
        while math.dist(robot.pose()[:2], goal) > 0.015:
            robot.need_drive()
            parked = [other for other in robot.others() if not other.plan]
            path = route(robot, goal, [*parked, met] if met is not None and met.plan else parked)
            if path is None:
                obstacle = _culprit(robot, goal, parked, met)
                waited += yield from _unblock(robot, obstacle, patience)
                met = None
            else:
                if length(path) < best - 0.3:
                    best, waited = length(path), 0.0
                met = yield from _follow(robot, path)
                if met is None:
                    continue
                obstacle = met
                waited += yield from _wait_for(robot, met)
            if waited > patience:
                by = f" by {obstacle.name}" if obstacle is not None else ""
                raise GivenUp("blocked", f"the way of {robot.name} to ({goal[0]:.2f}, {goal[1]:.2f}) is blocked{by}")
        if yaw is not None:
            yield from turn_to(robot, yaw)
    finally:
        robot.plan = []


def _culprit(robot: Robot, goal: Point, parked: list[Robot], met: Robot | None) -> Robot | None:
    """Which robot it is that leaves no way; None if it takes several. Sets out what the robot would do without them."""
    wish = route(robot, goal, ())
    if wish is None:
        raise GivenUp("unreachable", f"{robot.name} finds no way to ({goal[0]:.2f}, {goal[1]:.2f})")
    robot.plan = wish
    if met is not None and route(robot, goal, parked) is not None:
        return met
    without = ((one, [other for other in parked if other is not one]) for one in parked)
    return next((one for one, rest in without if route(robot, goal, rest) is not None), None)


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
    """How fast to turn towards a heading that is that far off: so that it stops there without overshooting."""
    return math.copysign(min(4.0 * abs(error), math.sqrt(2 * 3.0 * abs(error))), error)


def _follow(robot: Robot, path: Sequence[Point]) -> Generator[None, None, Robot | None]:
    """Go along the path. Returns the robot that kept it standing for a while, or None at the end of the path."""
    corner, stood = 1 if len(path) > 1 else 0, 0
    while True:
        robot.need_drive()
        x, y, yaw = robot.pose()
        robot.plan = [(x, y), *path[corner:]]
        dx, dy = path[corner][0] - x, path[corner][1] - y
        distance, last = math.hypot(dx, dy), corner == len(path) - 1
        if distance < (0.01 if last else 0.04):
            if last:
                return None
            corner += 1
            continue
        direction = (dx / distance, dy / distance)
        error = wrap(math.atan2(dy, dx) - yaw)
        if last and distance < 0.04:
            error = 0.0  # too near for the direction to mean anything
        allowed = robot.solid.speed * max(0.0, math.cos(error)) ** 4 if abs(error) < 1.0 else 0.0
        after = 0.02 if last else _corner_speed(robot, path[corner - 1], path[corner], path[corner + 1])
        allowed = min(allowed, math.sqrt(after * after + 2 * 0.6 * BRAKING * max(0.0, distance - 0.01)))
        obstacle = robot.move(direction, allowed, _turning(error))
        stood = stood + 1 if obstacle is not None and robot.speed < 0.03 else 0
        if stood > 25 and obstacle is not None:
            return obstacle
        yield


def _corner_speed(robot: Robot, before: Point, corner: Point, after: Point) -> float:
    """How fast a robot may be where its path bends."""
    a = math.atan2(corner[1] - before[1], corner[0] - before[0])
    bend = wrap(math.atan2(after[1] - corner[1], after[0] - corner[0]) - a)
    return max(0.08, robot.solid.speed * max(0.0, math.cos(bend)) ** 6)


def _yields_to(robot: Robot, other: Robot) -> bool:
    """Who makes way for whom: the one that has nowhere to go, else the one whose goal the other stands on, else the one with
    the greater name."""
    if not robot.plan or not other.plan:
        return bool(other.plan)
    mine, theirs = _stands_on_goal(other, robot), _stands_on_goal(robot, other)
    return mine if mine != theirs else robot.name > other.name


def _stands_on_goal(robot: Robot, other: Robot) -> bool:
    return math.dist(robot.pose()[:2], other.plan[-1]) < robot.size.radius + other.size.radius + GAP


def _wait_for(robot: Robot, other: Robot) -> Generator[None, None, float]:
    """Another one is in the way, where there was a path. Returns the seconds waited."""
    start = robot.scene.time
    yield from wait(1.6 if _yields_to(robot, other) else 0.2)
    yield from _back_off(robot, other)
    return robot.scene.time - start


def _back_off(robot: Robot, other: Robot) -> Routine:
    """Get so far away from another robot that there is a way around it, if there is room behind."""
    for _ in range(100):
        robot.need_drive()
        x, y, _ = robot.pose()
        nearest = min(other.claims(), key=robot.base_claim().gap)
        gap = Capsule((x, y), (x, y), robot.size.radius).gap(nearest)
        tx, ty = (nearest.start[i] + nearest.end[i] for i in (0, 1))
        way = math.hypot(x - tx / 2, y - ty / 2)
        direction = ((x - tx / 2) / way, (y - ty / 2) / way)
        behind = (x + 0.1 * direction[0], y + 0.1 * direction[1])
        things = floor_things(robot, [robot.holding] if robot.holding else [])
        if gap > GAP + MARGIN + 0.06 or not robot.navigator.free(behind, robot.size.radius + MARGIN, things):
            return
        robot.move(direction, 0.15, 0.0)
        yield


def _unblock(robot: Robot, other: Robot | None, patience: float) -> Generator[None, None, float]:
    """No way because of another robot: step aside, or have it step aside, or wait. Returns what that costs of the patience."""
    if other is not None and _yields_to(robot, other) and other.mobile:
        if (yield from make_way(robot, other)):
            return patience / 8
    elif other is not None and not other.plan and other.mobile and other.doing is None:
        other.asked = robot
    yield from wait(0.5)
    return 0.5


def ask_aside(robot: Robot, place: Point) -> Routine:
    """Have those that do nothing leave a place, and the way to it."""
    robot.plan = route(robot, place, ()) or [robot.pose()[:2], place]
    for other in robot.others():
        room = robot.size.radius + other.size.radius + 0.12
        idle = other.doing is None and not other.plan and other.mobile
        if idle and path_distance([other.pose()[:2]], robot.plan) < room:
            other.asked = robot
    yield from wait(0.5)
    robot.plan = []


def make_way(robot: Robot, other: Robot) -> Generator[None, None, bool]:
    """Leave the way of another robot, and wait until that has passed. Whether there was anywhere to go; not if it goes nowhere by now."""
    if not other.plan:
        return False
    refuge, goal = _refuge(robot, other), robot.plan[-1] if robot.plan else None
    if refuge is None:
        return False
    met = yield from _follow(robot, refuge)
    for _ in range(60):
        robot.need_drive()
        if met is not None or not other.plan or not other.mobile:
            break
        yield from wait(0.25)
        mine = (route(robot, goal, ()) if goal is not None else None) or [robot.pose()[:2]]
        if other.plan and path_distance(_beginning(mine), _beginning(other.plan)) > robot.size.radius + other.size.radius + 0.1:
            break
    robot.plan = []
    return True


def _beginning(path: Sequence[Point], way: float = 3.0) -> list[Point]:
    """The first metres of a path."""
    kept = [path[0]]
    for a, b in pairwise(path):
        step = math.dist(a, b)
        if step >= way:
            share = way / step
            return [*kept, (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))]
        kept.append(b)
        way -= step
    return kept


def _refuge(robot: Robot, other: Robot) -> list[Point] | None:
    """The way to the nearest place off the other's path."""
    x, y, _ = robot.pose()
    room = robot.size.radius + other.size.radius + 0.12
    discs = [*floor_things(robot), *robot_discs(robot.others())]
    candidates = []
    for radius in (0.5, 0.8, 1.2, 1.7, 2.4, 3.2, 4.2, 5.5):
        for angle in np.arange(16) * math.pi / 8:
            point = (x + radius * math.cos(angle), y + radius * math.sin(angle))
            aside = all(point_distance(point, a, b) > room for a, b in pairwise(other.plan))
            here = Capsule(point, point, robot.size.radius + 0.05)
            if aside and all(here.gap(Capsule((d.x, d.y), (d.x, d.y), d.radius)) > 0 for d in discs):
                candidates.append(point)
    fallback: list[Point] | None = None
    tried = 0
    for point in candidates:
        if tried > 80:
            break
        if not robot.navigator.free(point, robot.size.radius + MARGIN):
            continue
        tried += 1
        path = route(robot, point, robot.others())
        if path is None:
            continue
        # Where the other one will be when this one has got there.
        ahead = _beginning(other.plan, 0.5 + other.solid.speed * length(path) / robot.solid.speed)
        if path_distance(path, ahead) > robot.size.radius + other.size.radius + 0.1:
            return path
        if fallback is None and math.dist(point, other.plan[0]) > math.dist((x, y), other.plan[0]):
            fallback = path
    return fallback
