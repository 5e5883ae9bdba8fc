"""The body of a simulated mobile robot, and access to its joints.

A round base moves in the plane by velocity servos. Wheels are not simulated: robots on wheels tip over under a tall load, and wheel slip
is not needed. On the base of a manipulator, a turret turns about the vertical axis. It carries a mast with a lift, the lift carries a
telescopic boom, and from the boom's end hangs a hand with a wrist and a parallel gripper with two fingers. So the robot grips things
from above, at heights from 0 to 1.2 m, in any direction, and carries them above the base, within its outline.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from somrs.devices.simulator.world.joints import ARM_JOINTS, BASE_JOINTS, LIFT_TOP, Joints, wrapped
from somrs.space.dimensions import FINGER, OPENING, Dimensions, dimensions_of
from somrs.space.solids import Solid

GROUND = 0.02
"""Height of the base's collision body above the floor, m."""
# Collision bits: static bodies collide with robots and things, robots with everything, static bodies never with each other.
# Handles collide with fingers only.
STATIC_BIT, ROBOT_BIT, THING_BIT, HANDLE_BIT = 1, 2, 4, 8
_DARK, _STEEL, _RUBBER, _TIP = (0.13, 0.14, 0.16, 1), (0.72, 0.74, 0.77, 1), (0.06, 0.06, 0.07, 1), (0.95, 0.55, 0.1, 1)


def add_robot(spec: mujoco.MjSpec, solid: Solid, colour: tuple[float, float, float, float]) -> None:
    """Add a robot's bodies, joints, servos, and the equalities for what it grips, all named `<robot>/<part>`."""
    size, name = dimensions_of(solid), solid.name
    base = spec.worldbody.add_body(name=name, pos=[solid.x, solid.y, solid.z], gravcomp=1)
    for axis, joint in enumerate("xy"):
        base.add_joint(name=f"{name}/{joint}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[axis == 0, axis == 1, 0], armature=1)
    base.add_joint(name=f"{name}/yaw", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], armature=0.2)
    _add_base(base, size, max(solid.weight, 1.0), colour)
    for joint, gain, limit in (("x", 800.0, 400.0), ("y", 800.0, 400.0), ("yaw", 80.0, 60.0)):
        servo = spec.add_actuator(name=f"{name}/{joint}", target=f"{name}/{joint}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_velocity(gain)
        servo.forcelimited, servo.forcerange = 1, [-limit, limit]
    if size.gripper:
        _add_arm(spec, base, name, size)


def _geom(
    body: mujoco.MjsBody, kind: str, size: list[float], pos: list[float], rgba: tuple[float, ...], mass: float = 0.0, **options: object
) -> None:
    """Add a part of a robot. A part with mass collides; a part without is only visible."""
    bits = {"contype": ROBOT_BIT, "conaffinity": STATIC_BIT | ROBOT_BIT} if mass else {"contype": 0, "conaffinity": 0, "group": 1}
    form = getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")
    body.add_geom(type=form, size=size, pos=pos, rgba=list(rgba), mass=mass, **(bits | options))


def _add_base(base: mujoco.MjsBody, size: Dimensions, mass: float, colour: tuple[float, ...]) -> None:
    radius, height, wheel = size.base, size.height, min(0.0975, 0.4 * size.height)
    _geom(base, "cylinder", [radius, (height - GROUND) / 2], [0, 0, (height + GROUND) / 2], (0, 0, 0, 0), mass, group=3)
    _geom(base, "cylinder", [radius - 0.03, (height - 0.09) / 2], [0, 0, (height - 0.03) / 2 + 0.02], _DARK)
    _geom(base, "cylinder", [radius, 0.045], [0, 0, height - 0.07], colour)
    _geom(base, "cylinder", [radius - 0.01, 0.0125], [0, 0, height - 0.0125], _DARK)
    _geom(base, "box", [0.015, 0.5 * radius, 0.02], [radius - 0.012, 0, height - 0.07], _STEEL)
    turned = [math.sqrt(0.5), math.sqrt(0.5), 0, 0]
    for side in (-1, 1):
        _geom(base, "cylinder", [wheel, 0.024], [0, side * (radius - 0.024), wheel], _RUBBER, quat=turned)
        _geom(base, "cylinder", [0.5 * wheel, 0.026], [0, side * (radius - 0.024), wheel], _STEEL, quat=turned)
    _geom(base, "sphere", [0.035], [-radius + 0.06, 0, 0.035], _RUBBER)


def _add_arm(spec: mujoco.MjSpec, base: mujoco.MjsBody, name: str, size: Dimensions) -> None:
    mast = -(size.base - 0.07)
    parts = {"": base}

    def part(
        key: str, parent: str, pos: list[float], axis: list[float], span: tuple[float, float] | None, armature: float
    ) -> mujoco.MjsBody:
        hinge = key in ("turret", "wrist")
        body = parts[key] = parts[parent].add_body(name=f"{name}/{key}", pos=pos, gravcomp=1)
        joint = body.add_joint(name=f"{name}/{key}", axis=axis, armature=armature)
        joint.type = mujoco.mjtJoint.mjJNT_HINGE if hinge else mujoco.mjtJoint.mjJNT_SLIDE
        if span is not None:
            joint.limited, joint.range = 1, list(span)
        return body

    turret = part("turret", "", [0, 0, 0], [0, 0, 1], None, 0.3)
    _geom(turret, "cylinder", [0.05, 0.008], [mast, 0, size.height + 0.006], _STEEL)
    _geom(turret, "cylinder", [0.024, (1.0 - size.height) / 2], [mast, 0, (1.0 + size.height) / 2], _STEEL, 0.6)
    lift = part("lift", "turret", [0, 0, 0], [0, 0, 1], (size.height + 0.03, LIFT_TOP), 0.5)
    _geom(lift, "cylinder", [0.016, 0.37], [mast, 0, -0.37], (0.55, 0.57, 0.6, 1))
    _geom(lift, "box", [0.04, 0.04, 0.035], [mast, 0, 0], _DARK, 0.3)
    _geom(lift, "box", [(size.base + 0.035 - mast) / 2, 0.02, 0.018], [(size.base + 0.035 + mast) / 2, 0, 0], _STEEL, 0.3)
    hand = part("reach", "lift", [0, 0, 0], [1, 0, 0], (0.0, size.farthest + 0.02), 0.3)
    _geom(hand, "box", [0.18, 0.013, 0.012], [-0.18, 0, 0], (0.5, 0.52, 0.55, 1))
    drop = size.hang - FINGER
    _geom(hand, "cylinder", [0.02, drop / 2], [0, 0, -drop / 2 + 0.01], _DARK, 0.3)
    palm = part("wrist", "reach", [0, 0, -drop], [0, 0, 1], None, 0.02)
    _geom(palm, "box", [0.018, OPENING + 0.014, 0.012], [0, 0, 0.012], _DARK, 0.2)
    for key, side in (("left", 1), ("right", -1)):
        finger = part(key, "wrist", [0, 0, 0], [0, side, 0], (0.0, OPENING), 0.1)
        grip = {"friction": [1.2, 0.02, 0.001], "condim": 4, "conaffinity": STATIC_BIT | ROBOT_BIT | HANDLE_BIT}
        _geom(finger, "box", [0.014, 0.006, FINGER / 2], [0, side * 0.006, -FINGER / 2], _TIP, 0.08, **grip)
    gains = {
        "turret": (600, 90, 80),
        "lift": (9000, 500, 400),
        "reach": (3000, 200, 150),
        "wrist": (60, 4, 10),
        "left": (600, 40, 12),
        "right": (600, 40, 12),
    }
    for key, (stiffness, damping, limit) in gains.items():
        servo = spec.add_actuator(name=f"{name}/{key}", target=f"{name}/{key}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(stiffness, damping)
        servo.forcelimited, servo.forcerange = 1, [-limit, limit]
    bodies = list(parts.values())
    for i, first_body in enumerate(bodies):
        for second_body in bodies[i + 2 :]:
            spec.add_exclude(bodyname1=first_body.name, bodyname2=second_body.name)
    grasp = spec.add_equality(name=f"{name}/grasp", type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, active=False)
    grasp.name1, grasp.name2, grasp.solref = palm.name, base.name, [0.012, 1.0]
    pull = spec.add_equality(name=f"{name}/pull", type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY, active=False)
    pull.name1, pull.name2, pull.solref = palm.name, base.name, [0.02, 1.0]


class ServoJoints(Joints):
    """A robot's joints and servos in a compiled model. Valid until the next compilation."""

    def __init__(self, name: str, model: mujoco.MjModel, data: mujoco.MjData, gripper: bool) -> None:
        # Views of the physics' memory: getting a view costs more than reading it.
        self._positions, self._velocities, self._targets = np.asarray(data.qpos), np.asarray(data.qvel), np.asarray(data.ctrl)
        joints = (*BASE_JOINTS, *ARM_JOINTS) if gripper else BASE_JOINTS
        ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{name}/{joint}") for joint in joints]
        self._position = {joint: int(model.jnt_qposadr[i]) for joint, i in zip(joints, ids, strict=True)}
        self._velocity = {joint: int(model.jnt_dofadr[i]) for joint, i in zip(joints, ids, strict=True)}
        self._servo = {joint: mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, f"{name}/{joint}") for joint in joints}
        self._origin = tuple(float(value) for value in model.body(name).pos[:2])

    def __getitem__(self, joint: str) -> float:
        return float(self._positions[self._position[joint]])

    def start(self, joint: str, position: float) -> None:
        self._positions[self._position[joint]] = position
        if joint not in BASE_JOINTS:
            self.drive(joint, position)

    def drive(self, joint: str, target: float) -> None:
        self._targets[self._servo[joint]] = target

    def pose(self) -> tuple[float, float, float]:
        return self["x"] + self._origin[0], self["y"] + self._origin[1], wrapped(self["yaw"])

    def speed(self) -> tuple[float, float]:
        x, y, yaw = (float(self._velocities[self._velocity[joint]]) for joint in BASE_JOINTS)
        return math.hypot(x, y), yaw
