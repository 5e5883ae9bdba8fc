"""Moving the arm past obstacles: above what is in its way, in, and to the transport position.

How the hand grips and releases things is in `handling.py`, and leaves in `leaves.py`.
"""

from __future__ import annotations

import numpy as np

from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.motion.robot import Robot, Routine
from somrs.devices.simulator.world.joints import LIFT_TOP
from somrs.space.dimensions import OPENING
from somrs.space.distances import distances_from
from somrs.space.leaves import HANDLE_LENGTH, inside
from somrs.space.solids import Point, Solid

NEAR = 0.12
"""Distance from its way below which the hand has to pass above an obstacle, m."""
CLEAR = 0.03
"""Vertical clearance when the hand or a held thing passes above an obstacle, m."""


def withdraw(robot: Robot) -> Routine:
    """Bring the arm, with what it holds, to the transport position: up, in, and to the front."""
    if not robot.size.gripper:
        return
    yield from let_go(robot)
    if robot.arm_out:
        yield from _open_loose_grip(robot)
        container = _container_around(robot)
        yield from robot.arm(lift=min(max(robot.joints["lift"] + 0.02, lift_over(robot, robot.hand(), container=container)), 1.74))
        yield from robot.arm(reach=robot.size.drawn_in)
    robot.arm_claim = None
    yield from robot.arm(turret=0.0, lift=_transport(robot))


def _container_around(robot: Robot) -> Solid | None:
    """The container into which the hand reaches."""
    tip = robot.joints["lift"] + robot.solid.z - robot.size.hang
    return robot.scene.container_at(*robot.hand(), tip)


def let_go(robot: Robot) -> Routine:
    """Release the handle of a door, if the hand holds one, and lift the hand above it."""
    if robot.name in robot.scene.hands.pulled:
        robot.scene.hands.let_go(robot.name)
        if Fault.GRIPPER not in robot.faults:
            yield from open_clear(robot)
        yield from robot.arm(lift=min(robot.joints["lift"] + HANDLE_LENGTH, LIFT_TOP - 0.01))


def _open_loose_grip(robot: Robot) -> Routine:
    """Open the fingers if they touch a thing that is not held: the robot was stopped while it gripped or released it."""
    able = robot.holding is None and Fault.GRIPPER not in robot.faults
    if able and any(robot.scene.touching_fingers(robot.name, thing) for thing in robot.scene.things()):
        yield from open_clear(robot)


def open_clear(robot: Robot) -> Routine:
    """Open each finger so far that it does not touch what is between them."""
    opened = min(OPENING, robot.joints["left"] + 0.02), min(OPENING, robot.joints["right"] + 0.02)
    yield from robot.arm(left=opened[0], right=opened[1])


def _transport(robot: Robot) -> float:
    """The lift's height for driving, m: what is held passes just above the base."""
    return robot.size.clear + robot.size.hang + overhang(robot)


def overhang(robot: Robot) -> float:
    """How far what is held extends below the finger tips, m."""
    if robot.holding is None:
        return 0.0
    z = robot.scene.pose(robot.holding)[2]
    return max(0.0, robot.joints["lift"] + robot.solid.z - robot.size.hang - z)


def lift_over(robot: Robot, spot: Point, at_least: float = 0.0, container: Solid | None = None) -> float:
    """The lift's height, m, at which the hand and what it holds pass above everything up to a spot, in a container or not."""
    x, y, _ = robot.pose()
    line = np.array([(x + s * (spot[0] - x), y + s * (spot[1] - y)) for s in np.linspace(0, 1.1, 12)])
    top = max(robot.solid.z, at_least)
    for thing in robot.scene.things():
        px, py, z, _ = robot.scene.pose(thing)
        solid = robot.scene.world.solids[thing]
        is_near = bool(np.hypot(line[:, 0] - px, line[:, 1] - py).min() < solid.extent + 0.13)
        if not is_near or robot.scene.hands.holder(thing) is not None:
            continue
        if (container is not None) == (robot.scene.container_at(px, py, z) is not None):  # else a board or a leaf is between it and the arm
            top = max(top, z + solid.height)
    (left, bottom), (right, end) = line.min(axis=0) - NEAR, line.max(axis=0) + NEAR
    for block in robot.scene.world.blocks_near((left, bottom, right, end)):
        if container is not None and block.name.split("/")[0] == container.name:
            continue
        if block.top < robot.solid.z + 1.4 and distances_from(block, line).min() < NEAR:
            top = max(top, block.top)
    if container is not None:
        top = max(top, inside(container).z)
    return max(top - robot.solid.z + CLEAR, robot.size.clear) + robot.size.hang + overhang(robot)


def draw_in(robot: Robot) -> Routine:
    """If the arm is extended, bring the hand above the base without turning the turret."""
    if robot.arm_out:
        yield from robot.arm(lift=lift_over(robot, robot.hand()))
        yield from robot.arm(reach=robot.size.drawn_in)
