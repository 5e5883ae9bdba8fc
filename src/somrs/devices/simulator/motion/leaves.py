"""Opening and closing doors and containers: the hand takes a leaf by its handle, and leads it along the path of its joint.

The base stands while the leaf moves. Where the arm does not reach far enough, the robot lets go, drives on, and takes the handle again.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from somrs.devices.simulator.motion.approach import ranked
from somrs.devices.simulator.motion.arm import let_go, withdraw
from somrs.devices.simulator.motion.driving import MARGIN, PATIENCE, drive_to, floor_things
from somrs.devices.simulator.motion.robot import ARM, GivenUp, Robot, Routine, nearest_half_turn
from somrs.devices.simulator.motion.traffic import GAP, Capsule
from somrs.devices.simulator.world.scene import Scene
from somrs.space.dimensions import OPENING
from somrs.space.distances import Array, distances_from
from somrs.space.leaves import HANDLE, HANDLE_LENGTH, Leaf
from somrs.space.solids import Point

LEAF_SPEED = 0.15
"""Speed of a handle while a leaf is moved, m/s."""
LAG = 0.12
"""Distance by which a handle may be behind the hand before the leaf counts as stuck, m."""
BOOM = 0.03
"""Distance that the boom keeps from the leaf, m."""
SHARES = tuple(i / 15 for i in range(2, 16))
"""Points of the boom, as parts of its length, that are checked for the distance from the leaf."""
SAMPLES, LEAST_SAMPLES = 25, 3
"""Number of positions of a leaf for which a stand is checked, and of those to which the robot has to get from there."""
WORTH = 20.0
"""How far it is worth to drive to move a leaf to its end from one stand, m."""
ATTEMPTS = 4
"""Number of stands to which the robot tries to drive."""
STAGES = 6
"""How often a robot takes a handle again before it gives up."""

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class _Stand:
    """A place for the base, the side of the leaf, and the position to which the robot can bring the leaf from there."""

    base: Point
    side: int
    end: float


def move_leaves(robot: Robot, owner: str, *, opening: bool) -> Routine:
    """Open or close all leaves of a door or container. Raises GivenUp."""
    robot.need_gripper()
    for leaf in robot.scene.leaves(owner):
        for _ in range(STAGES):
            goal = leaf.travel if opening else 0.0
            if _is_moved(leaf, robot.scene.leaf_position(leaf), goal):
                break
            yield from _move_part(robot, leaf, goal)
        else:
            raise GivenUp("blocked", f"{robot.name} cannot move the door of {owner} any further")


def _move_part(robot: Robot, leaf: Leaf, goal: float) -> Routine:
    """Drive to a stand, and bring the leaf as near to the goal as the arm reaches from there."""
    yield from withdraw(robot)
    stand = yield from _drive_to_stand(robot, leaf, goal)
    try:
        yield from _claim_sweep(robot, leaf)
        yield from _grip_handle(robot, leaf, stand.side)
        yield from _lead(robot, leaf, stand.side, stand.end)
        yield from let_go(robot)
        yield from withdraw(robot)
    finally:
        robot.fleet.sweeps.pop(robot.name, None)


def _drive_to_stand(robot: Robot, leaf: Leaf, goal: float) -> Generator[None, None, _Stand]:
    """Drive to a place from which a handle is in reach, on the nearer side if there is one. Returns the stand. Raises GivenUp."""
    problem = GivenUp("unreachable", f"there is no place from which {robot.name} could move the door of {leaf.owner.name}")
    nearer = leaf.nearer_side(robot.pose()[:2])
    for side in sorted(leaf.sides, key=lambda side: side != nearer):
        candidates = _stands(robot, leaf, side, goal)
        for stand in [*candidates[:1], *candidates[6:7], *candidates[18:19], *candidates[-1:]][:ATTEMPTS]:
            try:
                yield from drive_to(robot, stand.base, patience=8.0)
                return stand
            except GivenUp as failure:
                if not failure.leaves_other_places:
                    raise
                problem = failure
    raise problem


def _stands(robot: Robot, leaf: Leaf, side: int, goal: float) -> list[_Stand]:
    """The stands from which the handle is in reach, best first: those from which the leaf gets furthest, then the nearest."""
    size, position = robot.size, robot.scene.leaf_position(leaf)
    bases, ends = leading_bases(robot, leaf, side, (position, goal), robot.solid.z)
    obstacles = [Capsule((d.x, d.y), (d.x, d.y), d.radius) for d in floor_things(robot)]
    obstacles += [claim for staying_robot in robot.staying_robots() for claim in staying_robot.claims()]
    progress = np.abs(ends - position) / max(abs(goal - position), 1e-9)
    candidates: list[_Stand] = []
    for i in ranked(robot, bases, -progress * WORTH, 1.0):
        base = (float(bases[i][0]), float(bases[i][1]))
        footprint = Capsule(base, base, size.radius + MARGIN + GAP + 0.01)
        if any(footprint.gap(obstacle) < 0 for obstacle in obstacles):
            continue
        if robot.free_space.free(base, size.radius + MARGIN + 0.01):
            candidates.append(_Stand(base, side, float(ends[i])))
    return candidates


def leading_bases(robot: Robot, leaf: Leaf, side: int, way: tuple[float, float], level: float) -> tuple[Array, Array]:
    """Points for the base on a floor from which the arm leads a handle on from the first position of a `way` of the leaf, and the position
    to which it gets, if nothing but static solids is in the way."""
    size = robot.size
    positions = np.linspace(*way, SAMPLES)
    handles = np.array([leaf.handle(float(position), side) for position in positions])
    radii = np.linspace(size.nearest + 0.015, size.farthest - 0.015, 7)
    angles = np.arange(32) * (math.pi / 16)
    bases = handles[0] + np.array([(r * math.cos(angle), r * math.sin(angle)) for r in radii for angle in angles])
    bases = bases[robot.scene.room(bases, level, [leaf.name]) >= size.radius + MARGIN + 0.015]
    reached = np.zeros(len(bases), dtype=int)
    going = np.arange(len(bases))
    for position, handle in zip(positions, handles, strict=True):
        going = going[_serves(robot, leaf, side, float(position), handle, bases[going])]
        reached[going] += 1
    is_led = reached >= LEAST_SAMPLES
    return bases[is_led], positions[reached[is_led] - 1]


def moving_bases(robot: Robot, leaf: Leaf, way: tuple[float, float], level: float) -> Array:
    """Points for the base on a floor from which the robot begins to move a leaf, and can bring it to the end of the way from the same side,
    if nothing but static solids is in the way."""
    chosen: list[Array] = [np.zeros((0, 2))]
    for side in leaf.sides:
        bases, ends = leading_bases(robot, leaf, side, way, level)
        if _gets_on(robot, leaf, side, ends, way[1], level):
            chosen.append(bases)
    return np.concatenate(chosen)


def _gets_on(robot: Robot, leaf: Leaf, side: int, ends: Array, goal: float, level: float) -> bool:
    """Whether the robot can bring a leaf to its goal on one side, when it has brought it to the best of these positions."""
    for _ in range(STAGES):
        if not len(ends):
            return False
        position = float(ends.max() if goal else ends.min())
        if _is_moved(leaf, position, goal):
            return True
        ends = leading_bases(robot, leaf, side, (position, goal), level)[1]
    return False


def _is_moved(leaf: Leaf, position: float, goal: float) -> bool:
    """Whether a leaf is as open, or as shut, as it has to be."""
    return leaf.is_open(position) if goal else leaf.is_shut(position)


def _serves(robot: Robot, leaf: Leaf, side: int, position: float, handle: Array, bases: Array) -> Mask:
    """For each base, whether the robot reaches the handle at a position of the leaf, and nothing but the hand is near the leaf."""
    size, solid = robot.size, leaf.solid(position)
    distance = np.hypot(*(bases - handle).T)
    fine = (distance >= size.nearest) & (distance <= size.farthest - 0.005)
    fine &= distances_from(solid, bases) >= size.radius + MARGIN
    boom = _tip(leaf) + size.hang
    angle = leaf.front(position, side)  # from the other side, the hand could not withdraw past the edge of the leaf
    fine &= (bases - handle) @ np.array([math.cos(angle), math.sin(angle)]) >= -BOOM
    near = bases[fine]
    points = (near + np.array(SHARES)[:, None, None] * (handle - near)).reshape(-1, 2)
    is_clear = robot.scene.clearances(points, boom - 0.05, boom + 0.1, [leaf.name, leaf.owner.name]) > 0.05
    if boom - BOOM < solid.top:
        is_clear &= distances_from(solid, points) > BOOM
    fine[fine] = is_clear.reshape(len(SHARES), -1).all(axis=0)
    return np.asarray(fine)


def _tip(leaf: Leaf) -> float:
    """Height of the finger tips on the map while they hold the handle, m."""
    return leaf.handle_height - 0.03


def _claim_sweep(robot: Robot, leaf: Leaf) -> Routine:
    """Claim the space through which the leaf and the arm move, once no other robot is in it. Raises GivenUp."""
    waited = 0.0
    while (obstacle := obstacle_in_sweep(robot.scene, leaf, robot.other_robots())) is not None:
        if waited > PATIENCE or obstacle in robot.scene.things():
            raise GivenUp("blocked", f"{obstacle} stands in the way of the door of {leaf.owner.name}")
        yield
        waited += robot.period
    robot.fleet.sweeps[robot.name] = _sweep(leaf)


def obstacle_in_sweep(scene: Scene, leaf: Leaf, robots: Iterable[Robot]) -> str | None:
    """A thing, or one of the robots, that is in the space through which the leaf moves; None if that is free."""
    sweep = _sweep(leaf)
    for thing in scene.things():
        x, y, z, _ = scene.pose(thing)
        in_way = Capsule((x, y), (x, y), scene.world.solids[thing].extent).gap(sweep) < 0 and scene.hands.holder(thing) is None
        if in_way and leaf.bottom - 0.1 < z - leaf.owner.z < leaf.top and scene.container_at(x, y, z) is None:
            return thing
    near = (robot for robot in robots if abs(robot.solid.z - leaf.owner.z) < leaf.top)
    return next((robot.name for robot in near if any(sweep.gap(claim) < 0 for claim in robot.claims())), None)


def _sweep(leaf: Leaf) -> Capsule:
    """A capsule around the space through which a leaf moves, seen from above."""
    if leaf.slides:
        x, y = leaf.end
        far = leaf.owner.world(x + leaf.width * math.cos(leaf.along), y + leaf.width * math.sin(leaf.along))
        return Capsule(leaf.owner.world(x, y), far, leaf.thickness / 2 + 0.08)
    angle = leaf.direction(leaf.travel / 2)
    middle = leaf.owner.world(leaf.end[0] + 0.6 * leaf.width * math.cos(angle), leaf.end[1] + 0.6 * leaf.width * math.sin(angle))
    return Capsule(middle, middle, 0.5 * leaf.width)


def _grip_handle(robot: Robot, leaf: Leaf, side: int) -> Routine:
    """Close the fingers around the handle, from above. Raises GivenUp."""
    robot.need_gripper()
    position, opening = robot.scene.leaf_position(leaf), min(OPENING, HANDLE + 0.02)
    handle, tip = leaf.handle(position, side), _tip(leaf) - robot.solid.z + robot.size.hang
    turret, reach = robot.aim(handle)
    robot.arm_claim = Capsule(robot.pose()[:2], handle, ARM)
    yield from robot.arm(lift=tip + HANDLE_LENGTH, left=opening, right=opening)
    yield from robot.arm(turret=turret, wrist=_wrist(robot, leaf, side, position, turret))
    yield from robot.arm(reach=reach)
    turret, reach = robot.aim(handle)  # again, because the base has moved a little
    yield from robot.arm(turret=turret, reach=reach)
    yield from robot.arm(lift=tip)
    for _ in range(100):
        touching = robot.scene.fingers_at_handle(robot.name, leaf)
        for finger in ("left", "right"):
            if finger in touching:
                robot.hold_joint(finger)
            else:
                robot.lead(finger, 0.0)
        if len(touching) == 2:
            robot.scene.hands.hold_handle(robot.name, leaf.name)
            return
        yield
    raise GivenUp("slipped", f"the fingers of {robot.name} close without the handle of {leaf.owner.name} between them")


def _wrist(robot: Robot, leaf: Leaf, side: int, position: float, turret: float) -> float:
    """The wrist's angle at which the fingers close along the leaf, so that both have space between the leaf and the palm."""
    return nearest_half_turn(leaf.front(position, side) - robot.pose()[2] - turret)


def _lead(robot: Robot, leaf: Leaf, side: int, end: float) -> Routine:
    """Lead the held handle to a position of the leaf. Raises GivenUp if the leaf does not follow."""
    position = robot.scene.leaf_position(leaf)
    step = LEAF_SPEED * robot.period / leaf.radius
    wrist = robot.joints["wrist"]
    settling = 0
    while settling < 40:
        robot.need_gripper()
        actual = robot.scene.leaf_position(leaf)
        if abs(position - actual) * leaf.radius > LAG:
            raise GivenUp("blocked", f"something keeps the door of {leaf.owner.name} from moving")
        position += max(-step, min(step, end - position))
        turret, reach = robot.aim(leaf.handle(position, side))
        turn = _wrist(robot, leaf, side, position, robot.joints["turret"])
        wrist += (turn - wrist + math.pi / 2) % math.pi - math.pi / 2
        robot.lead_turret(turret)
        robot.lead("reach", reach)
        robot.lead("wrist", wrist)
        yield
        settling = settling + 1 if abs(position - end) < 1e-9 else 0
