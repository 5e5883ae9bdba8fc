"""Gripping and placing: the hand takes things from above. A thing counts as held when both fingers touch it."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Generator

import numpy as np

from somrs.devices.simulator.motion.arm import draw_in, lift_over, open_clear, overhang, withdraw
from somrs.devices.simulator.motion.driving import PATIENCE, drive_to
from somrs.devices.simulator.motion.placement import (
    free_spots,
    order,
    reachable_now,
    spots_here,
    spots_inside,
    stands,
    thing_distances,
)
from somrs.devices.simulator.motion.robot import ARM, GivenUp, Robot, Routine, nearest_half_turn, wait
from somrs.devices.simulator.motion.traffic import Capsule
from somrs.space.dimensions import FINGER, OPENING
from somrs.space.distances import Array, distances_from
from somrs.space.leaves import inside
from somrs.space.solids import Point, Role, Solid

SLOWLY = 0.08
"""Speed at which the hand descends the last centimetres, m/s."""
HEAVE = 0.02
"""Height to which a thing is lifted to find out its weight, m."""
LOAD_RESOLUTION = 0.05
"""Resolution of the weights that an arm measures, kg."""

Spots = Callable[[], tuple[Array, Array]]
"""Returns the suitable spots (n, 2) and their penalties (n). Called again whenever the robot needs another spot."""


def get_within_reach(
    robot: Robot, target_name: str, spots: Spots, top: float, ignored: Collection[str] = (), container: Solid | None = None
) -> Generator[None, None, Point]:
    """Drive, if necessary, to a place from which one of the spots, in a container or not, is in reach. Returns the spot. Raises GivenUp."""
    waited = 0.0
    while True:
        candidates, penalties = order(*spots())
        if not len(candidates):
            raise GivenUp("no-space", f"{robot.name} finds no free spot on {target_name}")
        reachable_index = reachable_now(robot, candidates, top, container)
        if reachable_index is not None:
            return float(candidates[reachable_index][0]), float(candidates[reachable_index][1])
        robot.need_drive()
        if robot.is_outside:
            raise GivenUp("unreachable", f"{target_name} is not within reach of {robot.name}, which its own program drives")
        started = robot.scene.time
        ranked = stands(robot, candidates, top, penalties, ignored, container)
        problem = GivenUp("blocked", f"other robots occupy the places from which {robot.name} could reach {target_name}")
        if not ranked and not stands(robot, candidates, top, penalties, ignored, container, is_alone=True):
            raise GivenUp("unreachable", f"there is no place for {robot.name} from which it could reach {target_name}")
        yield from withdraw(robot)
        for stand in ranked[:1] + ranked[8:9] + ranked[16:17] + ranked[-1:]:
            try:
                yield from drive_to(robot, stand.base, patience=4.0)
                return stand.spot
            except GivenUp as failure:
                if not failure.leaves_other_places:
                    raise
                problem = failure
        if not ranked:
            yield from wait(robot, 0.5)
        waited += robot.scene.time - started
        if waited > PATIENCE or problem.reason == "unreachable":
            raise problem


def _claim_arm(robot: Robot, spot: Point) -> Routine:
    """Wait until the space for the arm is free of other robots, then claim it. Raises GivenUp after `PATIENCE` seconds."""
    x, y, _ = robot.pose()
    arm_claim, waited = Capsule((x, y), spot, ARM), 0.0
    while any(arm_claim.gap(claim) < 0 for other_robot in robot.other_robots() for claim in other_robot.claims()):
        if waited > PATIENCE:
            raise GivenUp("blocked", f"another robot occupies the space that the arm of {robot.name} needs")
        yield
        waited += robot.period
    robot.arm_claim = arm_claim


def pick(robot: Robot, thing: str) -> Routine:
    """Grip a thing that is within reach. Raises GivenUp, also if the thing turns out to be too heavy; it is then where it was."""
    x, y, z, _ = robot.scene.pose(thing)
    container = robot.scene.container_at(x, y, z)
    yield from _take(robot, thing)
    yield from _lift_a_little(robot, thing)
    if robot.weighed[thing] > robot.solid.payload:
        yield from _let_down(robot, thing)
        weight, payload = robot.weighed[thing], robot.solid.payload
        raise GivenUp("too-heavy", f"{thing} weighs {weight:g} kg, which is too heavy for {robot.name}; its payload is {payload:g} kg")
    yield from robot.arm(lift=lift_over(robot, (x, y), z, container))
    yield from withdraw(robot)
    if robot.holding != thing:
        raise GivenUp("slipped", f"{thing} is no longer in the gripper of {robot.name}")


def weigh(robot: Robot, thing: str) -> Routine:
    """Find out what a thing within reach weighs, and leave it where it is. Raises GivenUp."""
    yield from _take(robot, thing)
    yield from _lift_a_little(robot, thing)
    yield from _let_down(robot, thing)


def _lift_a_little(robot: Robot, thing: str) -> Routine:
    """Lift a thing that is held so far that it stands on nothing, and measure its weight."""
    yield from robot.arm(lift=robot.joints["lift"] + HEAVE)
    weight = robot.scene.world.solids[thing].weight
    robot.weighed[thing] = round(weight / LOAD_RESOLUTION) * LOAD_RESOLUTION


def _let_down(robot: Robot, thing: str) -> Routine:
    """Lower a thing that was lifted a little, release it, and withdraw the arm."""
    yield from _lower(robot, thing, robot.joints["lift"] - 2 * HEAVE)
    yield from _release(robot, thing)


def _take(robot: Robot, thing: str) -> Routine:
    """Close the fingers around a thing that is within reach. Raises GivenUp."""
    scene, solid = robot.scene, robot.scene.world.solids[thing]
    robot.need_gripper()
    yield from _claim_arm(robot, scene.pose(thing)[:2])
    x, y, z, _ = scene.pose(thing)
    if scene.hands.holder(thing) is not None or math.dist((x, y), robot.arm_claim.end if robot.arm_claim else (x, y)) > 0.05:
        robot.arm_claim = None
        raise GivenUp("slipped", f"{thing} was taken away before {robot.name} could grip it")
    container = scene.container_at(x, y, z)
    angle, half = _grasp_angle(robot, thing, container)
    opening = min(OPENING, half + 0.018)
    tip = z - robot.solid.z + max(0.012, solid.height - FINGER + 0.025)
    travel_lift = lift_over(robot, (x, y), z + solid.height, container)
    _check_ceiling(robot, travel_lift, container)
    turret, reach = robot.aim((x, y))
    yield from robot.arm(lift=travel_lift, left=opening, right=opening)
    yaw = robot.pose()[2]
    yield from robot.arm(turret=turret, wrist=nearest_half_turn(angle - yaw - turret))
    yield from robot.arm(reach=reach)
    turret, reach = robot.aim(scene.pose(thing)[:2])  # again, because the base has moved a little
    yield from robot.arm(turret=turret, reach=reach)
    yield from robot.arm(lift=tip + robot.size.hang + 0.03)
    yield from robot.arm(lift=tip + robot.size.hang)
    yield from _close(robot, thing)
    scene.hands.hold(robot.name, thing)


def _grasp_angle(robot: Robot, thing: str, container: Solid | None) -> tuple[float, float]:
    """The wrist angle on the map with most space for the fingers beside a thing, and half the thing's width along the closing axis.

    The fingers move along the y axis of the wrist. Raises GivenUp if the thing is too wide, or if there is not enough space.
    """
    scene, solid = robot.scene, robot.scene.world.solids[thing]
    x, y, z, yaw = scene.pose(thing)
    if solid.form == "Box":
        options = [(yaw, solid.depth / 2), (yaw + math.pi / 2, solid.width / 2)]
    else:
        base = math.atan2(y - robot.pose()[1], x - robot.pose()[0])
        options = [(base + i * math.pi / 8, solid.extent) for i in (0, 1, -1, 2, -2, 3, -3, 4)]
    rated: list[tuple[float, float, float]] = []
    for angle, half in options:
        if half > OPENING - 0.005:
            continue
        closing_axis, offset = np.array([-math.sin(angle), math.cos(angle)]), half + 0.024
        fingers = np.array([[x, y] + side * offset * closing_axis for side in (-1, 1)])
        room = (
            min(
                thing_distances(robot, fingers, z + 0.02, z + solid.height, [thing]).min(),
                scene.clearances(fingers, z + 0.02, z + 1.0).min()
                if container is None
                else -distances_from(inside(container), fingers).max(),
            )
            - 0.02
        )
        rated.append((-min(float(room), 0.08), angle, half))
    if not rated:
        raise GivenUp("not-possible", f"{thing} is too wide for the gripper of {robot.name}")
    blocked, angle, half = min(rated, key=lambda option: round(option[0], 3))
    if blocked > 0.012:
        raise GivenUp("not-possible", f"there is no space beside {thing} for the fingers of {robot.name}")
    return angle, half


def _close(robot: Robot, thing: str) -> Routine:
    """Close each finger until it touches the thing. Raises GivenUp unless both do."""
    for _ in range(150):
        touching = robot.scene.touching_fingers(robot.name, thing)
        for finger in ("left", "right"):
            if finger not in touching:
                robot.lead(finger, 0.0)
            else:
                robot.hold_joint(finger)
        if len(touching) == 2:
            return
        yield
    yield from robot.arm(left=0.06, right=0.06)
    raise GivenUp("slipped", f"the fingers of {robot.name} close without {thing} between them")


def place(robot: Robot, support: Solid, position: Point | None) -> Routine:
    """Put what is held on an object, at `position` or at a free spot."""
    thing = robot.holding
    assert thing is not None
    radius, top = robot.scene.world.solids[thing].extent, top_of(support)
    while True:
        spot = yield from get_within_reach(robot, support.name, spots_on(robot, support, position), top)
        yield from _claim_arm(robot, spot)
        # Meanwhile another robot may have put something there.
        if thing_distances(robot, np.array([spot]), top - 0.05, top + 0.4, [thing])[0] - radius > 0.005:
            break
        robot.arm_claim = None
    yield from _put_on_spot(robot, spot, top)


def put_into(robot: Robot, container: Solid) -> Routine:
    """Put what is held into an open container, at a free spot on its bottom."""
    thing = robot.holding
    assert thing is not None
    radius, bottom = robot.scene.world.solids[thing].extent, inside(container).z
    spot = yield from get_within_reach(robot, container.name, lambda: spots_inside(robot, container, radius), bottom, container=container)
    yield from _claim_arm(robot, spot)
    _check_ceiling(robot, lift_over(robot, spot, bottom, container), container)
    yield from _put_on_spot(robot, spot, bottom, container)


def _check_ceiling(robot: Robot, lift: float, container: Solid | None) -> None:
    """Raise GivenUp if the boom does not fit under the top of the container."""
    if container is not None and lift + robot.solid.z + 0.05 > inside(container).top:
        raise GivenUp("no-space", f"the inside of {container.name} is too low for the arm of {robot.name}")


def _put_on_spot(robot: Robot, spot: Point, top: float, container: Solid | None = None) -> Routine:
    """Put what is held on a spot in the space that the arm has claimed, release it, and withdraw the arm."""
    thing = robot.holding
    assert thing is not None
    robot.need_gripper()
    yield from robot.arm(lift=lift_over(robot, spot, top, container))
    turret, reach = robot.aim(spot)
    yield from robot.arm(turret=turret)
    yield from robot.arm(reach=reach)
    turret, reach = robot.aim(spot)
    yield from robot.arm(turret=turret, reach=reach)
    underside = top - robot.solid.z + robot.size.hang + overhang(robot)
    yield from robot.arm(lift=underside + 0.02)
    yield from _lower(robot, thing, underside - 0.02)
    yield from _release(robot, thing)


def _release(robot: Robot, thing: str) -> Routine:
    """Release a thing that stands, wait until it is at rest, and withdraw the arm."""
    robot.need_gripper()
    robot.scene.hands.release(robot.name)
    yield from open_clear(robot)
    for _ in range(50):
        if robot.scene.are_at_rest(thing):
            break
        yield
    yield from withdraw(robot)


def _lower(robot: Robot, thing: str, lowest: float) -> Routine:
    """Lower the hand slowly until something supports the thing. Raises GivenUp if nothing does."""
    target, held = robot.joints["lift"], 0
    for _ in range(200):
        if robot.scene.rests(thing):
            held += 1
            if held > 2:
                return
        else:
            target = max(lowest, target - SLOWLY * robot.period)
        robot.lead("lift", target)
        yield
    raise GivenUp("no-space", f"{robot.name} finds nothing to put {thing} on")


def set_down(robot: Robot) -> Routine:
    """Put what is held on the floor, or on furniture, without driving."""
    thing = robot.holding
    if thing is None:
        yield from withdraw(robot)
        return
    robot.need_gripper()
    for _ in range(20):
        ranked = spots_here(robot, robot.scene.world.solids[thing].extent)
        if ranked:
            break
        yield from wait(robot, 0.5)
    else:
        raise GivenUp("no-space", f"there is no free spot around {robot.name} to put {thing} on")
    yield from draw_in(robot)
    yield from _claim_arm(robot, ranked[0][0])
    yield from _put_on_spot(robot, *ranked[0])


def spots_on(robot: Robot, support: Solid, position: Point | None) -> Spots:
    """Free spots on an object for what is held, or for a thing of a common size."""

    def spots() -> tuple[Array, Array]:
        held = robot.holding
        radius = robot.scene.world.solids[held].extent if held is not None else 0.05
        return free_spots(robot, support, radius, position)

    return spots


def top_of(support: Solid) -> float:
    return support.z if support.role is Role.MARK else support.top
