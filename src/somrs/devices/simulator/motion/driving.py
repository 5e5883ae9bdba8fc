"""Driving: a robot drives where traffic grants it places, and the last steps to where it works; it never collides."""

from __future__ import annotations

import math
from collections.abc import Collection, Generator
from functools import partial

from somrs.devices.simulator.motion.passages import AutomaticDoor, Lift
from somrs.devices.simulator.motion.road_user import ASTRAY
from somrs.devices.simulator.motion.robot import COMFORTABLE, GivenUp, Robot, Routine, stand, wait, wrap
from somrs.devices.simulator.motion.traffic import GAP
from somrs.devices.simulator.world.scene import Scene
from somrs.ontology.modes import why_closed
from somrs.protocol.messages.traffic import Berth, TripEnded, TripResult
from somrs.space.clearance import Disc
from somrs.space.lanes import BACKWARD
from somrs.space.lines import point_distance
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Point
from somrs.traffic.roadmap import Lane

PATIENCE = 45.0
"""Time after which a robot gives up that cannot come nearer because another one works at its goal, s."""
ARRIVED = 0.015
"""A robot that is this near to its goal is there, m."""
PASSED = 0.04
"""A robot that is this near to a place and may drive on has come to it, m."""
MARGIN = 0.03
"""Distance of a planned path from obstacles, beyond the robot's radius, m."""
SLACK = 0.02
"""How much nearer to something than planned a robot drives before it counts as in the way, m."""
NO_NEARER = 0.005
"""How much nearer to something a robot may come before it counts as nearer, m."""
SLOWEST = 0.08
"""Speed at which corners are passed at least, m/s."""
TURNING_DOWN = 3.0
"""Deceleration with which the base comes to a heading, rad/s²."""
LOOK = 1.0
"""The time after which a robot looks again whether its way is clear, s."""
NEAR_FLOOR = 0.3
"""Things whose underside is lower than this are obstacles, m."""


def floor_things(robot: Robot, ignored: Collection[str] = ()) -> list[Disc]:
    """Things that stand on the robot's floor, as discs."""
    return things_on_floor(robot.scene, robot.solid.z, ignored)


def things_on_floor(scene: Scene, level: float, ignored: Collection[str] = ()) -> list[Disc]:
    """Things that stand on the floor of this height, as discs."""
    discs = []
    for thing in scene.things():
        x, y, z, _ = scene.pose(thing)
        if thing not in ignored and scene.hands.holder(thing) is None and -0.1 < z - level < NEAR_FLOOR:
            support = scene.support_below(x, y, z + 0.02)
            if support is None or support.top - level < 0.05:
                discs.append(Disc(x, y, scene.world.solids[thing].extent))
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


def sees(robot: Robot, start: Point, end: Point, slack: float = 0.0) -> bool:
    """Whether the robot can drive from one point to the other in a straight line, past what stands there, but for robots.

    One of the points may be nearer to something than robots are to be: then the robot does not come any nearer. `slack`: how much nearer it
    may come, m.
    """
    clearance = robot.size.radius + MARGIN - slack
    room = min(clearance, robot.free_space.clearance(start), robot.free_space.clearance(end))
    if not robot.free_space.is_clear(start, end, room):
        return False
    for disc in floor_things(robot, [robot.holding] if robot.holding else []):
        distance = point_distance((disc.x, disc.y), start, end) - disc.radius
        if distance < min(clearance, disc.distance(start), disc.distance(end)) - NO_NEARER:
            return False
    return True


def drive_to(robot: Robot, goal: Point, yaw: float | None = None, patience: float = PATIENCE) -> Routine:
    """Drive to the goal, where traffic grants it, then turn to `yaw`.

    Raises GivenUp when there is no path, when traffic says that there is no room, and when another robot has worked at the goal for
    `patience` seconds since this one last came nearer.
    """
    robot.need_drive()
    _need_inside(robot)
    while (distance := math.dist(robot.pose()[:2], goal)) > ARRIVED or robot.road.is_on_its_way:
        is_near = distance < ASTRAY and not robot.road.is_on_its_way and sees(robot, robot.pose()[:2], goal)
        if is_near and all(door.is_open for door in robot.fleet.doors_between(robot, robot.pose()[:2], goal)):
            yield from _drive_lane(robot, robot.pose()[:2], goal)  # within the place that it holds
            yield from stand(robot)
        else:
            yield from _travel(robot, goal, patience)
    if yaw is not None:
        yield from turn_to(robot, yaw)


def change_storey(robot: Robot, level: float, goal: Point) -> Routine:
    """Go to the floor of a height, on the way to a point there. Raises GivenUp."""
    robot.need_drive()
    _need_inside(robot)
    while abs(robot.level - level) > SAME_FLOOR or robot.road.zone is not None:
        road = robot.road
        robot.fleet.levels.add(level)
        _enter(robot)
        place = road.office.landing(robot.name, level, goal)
        if place is None:
            raise GivenUp("unreachable", f"no lift in order takes {robot.name} to the floor at {level:.1f} m")
        yield from _travel_to(robot, place, road.point(place), PATIENCE)


def _need_inside(robot: Robot) -> None:
    """Raise GivenUp if the robot's own program drives it."""
    if robot.is_outside:
        raise GivenUp("not-possible", f"{robot.name} takes part in traffic by a program of its own, which drives it")


def _enter(robot: Robot) -> None:
    """Take part in traffic. Raises GivenUp."""
    if not robot.road.enter(robot.pose()[:2], partial(sees, robot)):
        raise GivenUp("blocked", f"{robot.name} cannot take part in traffic: {robot.road.refusal}")


def _travel(robot: Robot, goal: Point, patience: float) -> Routine:
    _enter(robot)
    zone = robot.fleet.zones.forbidden_zone_at(goal, robot.level, robot.size.radius)
    if zone is not None and robot.fleet.zones.forbidden_zone_at(robot.pose()[:2], robot.level, robot.size.radius) != zone:
        raise GivenUp("unreachable", f"{robot.name} does not go to ({goal[0]:.2f}, {goal[1]:.2f}): {why_closed((), [zone])}")
    stop = robot.road.stop_at(goal, partial(sees, robot)) if _is_free(robot, goal) else None
    yield from _travel_to(robot, stop, goal, patience)


def _travel_to(robot: Robot, stop: Berth | str | None, goal: Point, patience: float) -> Routine:
    road = robot.road
    refusal = road.begin(stop) if stop is not None else "something stands there, or no place of the roadmap is in sight"
    if refusal is not None:
        raise GivenUp("unreachable", f"{robot.name} finds no path to ({goal[0]:.2f}, {goal[1]:.2f}): {refusal}")
    progressed_at = robot.scene.time
    try:
        while road.is_travelling:
            robot.need_drive()
            if robot.road is not road:
                return  # there is another roadmap
            if (yield from drive_on(robot)):
                progressed_at = robot.scene.time
                continue
            if road.office.is_held:
                progressed_at = robot.scene.time
            occupant = road.office.occupant(robot.name) if robot.scene.time > progressed_at + patience else None
            if occupant is not None:
                raise GivenUp("blocked", f"{occupant} works where {robot.name} wants to go")
            yield
    finally:
        robot.plan = []
        road.cancel()
    problem = why_not_arrived(robot.name, goal, road.ended) if road.ended is not None else None
    if problem is not None:
        raise problem


def _is_free(robot: Robot, goal: Point, slack: float = 0.0) -> bool:
    """Whether nothing but robots stands at the goal. To a thing that it is too near to already, the robot may be as near there."""
    clearance, position = robot.size.radius + MARGIN - slack, robot.pose()[:2]
    discs = floor_things(robot, [robot.holding] if robot.holding else [])
    near_discs = [disc for disc in discs if disc.distance(position) < clearance]
    if any(disc.distance(goal) < disc.distance(position) - NO_NEARER for disc in near_discs):
        return False
    return robot.free_space.free(goal, clearance, [disc for disc in discs if disc not in near_discs])


def _can_go_on(robot: Robot, position: Point, following: Point) -> bool:
    """Whether the robot can drive to the next place. Where it was stopped on the way, something may stand there since."""
    if not robot.road.is_on_its_way:
        return sees(robot, position, following, SLACK)
    return sees(robot, position, following, MARGIN) and _is_free(robot, following, MARGIN)


def why_not_arrived(robot: str, goal: Point, ended: TripEnded) -> GivenUp | None:
    """Why a trip of a robot did not end at its goal; None if it did."""
    names = f" by {' and '.join(ended.robots)}" if ended.robots else ""
    way = f"the path of {robot} to ({goal[0]:.2f}, {goal[1]:.2f})"
    match ended.result:
        case TripResult.CLOSED:
            closed = why_closed(ended.passages, ended.zones)
            reason = f": {closed}" if closed else names or " by what stands there"
            return GivenUp("blocked", f"{way} is blocked{reason}")
        case TripResult.NO_ROOM:
            blockers = " and ".join(ended.robots)
            help = "bring them somewhere else" if len(ended.robots) > 1 else "bring it somewhere else"
            return GivenUp("blocked", f"on {way} there is no room: {blockers} cannot let {robot} pass; {help}, or clear a place for it")
        case TripResult.IMMOBILE:
            return GivenUp("drive-dead", f"{robot} cannot move")
    return None


def drive_on(robot: Robot) -> Generator[None, None, bool]:
    """Drive as far as places are granted, or to the end of the trip. Returns whether the robot has come to a place."""
    road, has_moved = robot.road, False
    position, travels = robot.pose()[:2], robot.road.is_travelling
    while robot.road is road and road.is_travelling == travels:
        following = road.next_place
        if following is None:
            return has_moved
        if road.next_level != road.level:
            yield from _ride(robot)
            has_moved = True
            continue
        lift = _lift_to_pass(robot)
        if lift is not None and not (yield from _wait_for(robot, lift)):
            return has_moved
        if not (yield from _wait_for_doors(robot, robot.fleet.doors_between(robot, position, following))):
            return has_moved
        if not _can_go_on(robot, position, following):
            has_way = road.look_again(position, partial(sees, robot))
            yield from wait(robot, LOOK)
            if not has_way:
                raise GivenUp("blocked", f"{robot.name} cannot drive on: {road.refusal}")
            return has_moved
        target = road.depart()
        assert target is not None, "it was granted"
        yield from _drive_lane(robot, position, target)
        road.arrive()
        position, has_moved = target, True
    return has_moved


def _lift_to_pass(robot: Robot) -> Lift | None:
    """The lift through whose door the robot drives to the next place; None if it stays inside or outside."""
    zone, next_zone = robot.road.zone, robot.road.next_zone
    return robot.fleet.lifts.get(zone or next_zone or "") if zone != next_zone else None


def _wait_for(robot: Robot, lift: Lift) -> Generator[None, None, bool]:
    """Wait until the robot can drive into the lift, or out of it. Returns False if it cannot: a robot outside of a lift that nobody may
    enter gives its way back."""
    road = robot.road
    while True:
        robot.need_drive()
        if not lift.is_usable and road.zone is None and not road.is_on_its_way:
            road.give_back(robot.pose()[:2], partial(sees, robot))
            yield from wait(robot, LOOK)
            return False
        if lift.is_open(road.level):
            return True
        yield
        if robot.road is not road or road.next_place is None:
            return False


def _wait_for_doors(robot: Robot, doors: list[AutomaticDoor]) -> Generator[None, None, bool]:
    """Wait until the doors are open, which open for who was granted the way through them. Returns False if the robot cannot go on: before a
    door that nobody may use, it gives its way back."""
    road = robot.road
    try:
        for door in doors:
            while not door.is_open:
                robot.awaited_door = door
                robot.need_drive()
                if not (door.is_usable or road.is_on_its_way):
                    road.give_back(robot.pose()[:2], partial(sees, robot))
                    yield from wait(robot, LOOK)
                    return False
                yield
                if robot.road is not road or road.next_place is None:
                    return False
    finally:
        robot.awaited_door = None
    return True


def _ride(robot: Robot) -> Routine:
    """Let the lift take the robot to the next place, which is on another floor."""
    road, level = robot.road, robot.road.next_level
    lift = robot.fleet.lifts[road.zone or road.next_zone or ""]
    road.depart()
    while not lift.is_open(level):
        if robot.road is not road:
            return
        yield
    road.arrive()


def _drive_lane(robot: Robot, start: Point, end: Point) -> Routine:
    """Drive to the next place, and do not slow down there if the way on is granted."""
    while True:
        robot.need_drive()
        x, y, yaw = robot.pose()
        ahead = robot.road.ahead
        robot.plan = [(x, y), end, *ahead]
        dx, dy = end[0] - x, end[1] - y
        distance, is_final = math.hypot(dx, dy), not ahead
        if distance < (0.01 if is_final else PASSED):
            return
        direction, (lane, next_lane) = (dx / distance, dy / distance), robot.road.rules
        error = wrap(math.atan2(dy, dx) + _turned(lane) - yaw)
        if is_final and distance < 0.04:
            error = 0.0  # so near to the goal, the direction is mostly noise
        allowed = _top_speed(robot, lane) * max(0.0, math.cos(error)) ** 4 if abs(error) < 1.0 else 0.0
        turn = _turned(next_lane) - _turned(lane)
        exit_speed = 0.02 if is_final else min(corner_speed(start, end, ahead[0], robot.solid.speed, turn), _top_speed(robot, next_lane))
        allowed = min(allowed, math.sqrt(exit_speed * exit_speed + 2 * COMFORTABLE * max(0.0, distance - 0.01)))
        allowed = min(allowed, distance / robot.period)  # not past the place within this period
        robot.move(direction, allowed, turning_speed(error))
        yield


def _top_speed(robot: Robot, lane: Lane | None) -> float:
    """The highest speed of a robot on a lane, m/s."""
    limit = lane.speed_limit if lane is not None else None
    return robot.solid.speed if limit is None else min(robot.solid.speed, limit)


def _turned(lane: Lane | None) -> float:
    """By how much the heading of a robot differs from the direction in which it drives on a lane, rad."""
    return math.pi if lane is not None and lane.travel == BACKWARD else 0.0


def turn_to(robot: Robot, yaw: float) -> Routine:
    """Turn on the spot."""
    for _ in range(500):
        robot.need_drive()
        error = wrap(yaw - robot.pose()[2])
        if abs(error) < 0.01:
            return
        robot.move((math.cos(robot.pose()[2]), math.sin(robot.pose()[2])), 0.0, turning_speed(error))
        yield


def turning_speed(error: float) -> float:
    """The turning speed for a heading error, rad/s: the base stops at the heading without overshooting."""
    return math.copysign(min(4.0 * abs(error), math.sqrt(2 * TURNING_DOWN * abs(error))), error)


def corner_speed(previous_point: Point, corner: Point, next_point: Point, top_speed: float, turn: float = 0.0) -> float:
    """The largest speed at a corner of the path, m/s. `turn`: by how much the robot turns there besides, rad."""
    heading = math.atan2(corner[1] - previous_point[1], corner[0] - previous_point[0]) - turn
    bend = wrap(math.atan2(next_point[1] - corner[1], next_point[0] - corner[0]) - heading)
    return max(SLOWEST, top_speed * max(0.0, math.cos(bend)) ** 2)
