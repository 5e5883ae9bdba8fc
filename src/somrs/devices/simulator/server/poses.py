"""The poses of everything that can move, as one row of numbers, and the changes that a subscriber has not received yet.

A row is cheap to read from the physics, and only changes are sent, so that a world at rest costs almost nothing.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from somrs.devices.simulator.link.commands import Fault, RobotState
from somrs.devices.simulator.link.lines import Mover, Poses, RobotStatus
from somrs.devices.simulator.server.simulation import Linked, Simulation
from somrs.devices.simulator.world.chassis import ARM_SEEN, BASE_JOINTS
from somrs.space.distances import Array
from somrs.space.solids import Role

Flags = npt.NDArray[np.bool_]

SMALLEST = 0.0005
"""Smallest change that counts as motion, in metres or radians: the physics is never completely still."""
SMALLEST_CHARGE = 0.1
"""Smallest change of a battery's charge that is sent, percent."""
DIGITS = 4
"""Decimal digits of the values that are sent: a tenth of a millimetre."""
SILENCE = 1.0
"""Seconds after which a line is sent even if nothing moved."""


class Table:
    """The movers of a compiled world, and the addresses of their numbers. Valid until the next compilation."""

    def __init__(self, simulation: Simulation) -> None:
        scene = simulation.scene
        self.model, self._data = scene.model, scene.data
        robots = scene.world.by_role(Role.ROBOT)
        self._arms, self._bases = [robot for robot in robots if robot.gripper], [robot for robot in robots if not robot.gripper]
        things = list(scene.things())
        armed = [(robot.name, 4 + len(ARM_SEEN)) for robot in self._arms]
        owners = [(solid.name, owned) for solid in scene.world.solids.values() if (owned := scene.leaves(solid.name))]
        leaves = [leaf for _, owned in owners for leaf in owned]
        swinging = ((name, len(owned)) for name, owned in owners)
        movers = [*armed, *((robot.name, 4) for robot in self._bases), *((thing, 6) for thing in things), *swinging]
        self.movers = tuple(Mover(name=name, numbers=numbers) for name, numbers in movers)
        counts = [mover.numbers for mover in self.movers]
        self.owners = np.repeat(np.arange(len(counts)), counts)
        """For each number of the row, the index of its mover."""
        self._starts = np.cumsum([0, *counts])[:-1]
        ordered = [*self._arms, *self._bases]
        self._base_addresses = np.array([self._addresses(robot.name, BASE_JOINTS) for robot in ordered], dtype=int).reshape(-1, 3)
        self._origins = np.array([self.model.body(robot.name).pos[:2] for robot in ordered]).reshape(-1, 2)
        self._levels = np.array([robot.z for robot in ordered])
        self._joints = np.array([self._addresses(robot.name, ARM_SEEN) for robot in self._arms], dtype=int).reshape(-1, len(ARM_SEEN))
        self._leaves = np.array([int(self.model.jnt_qposadr[self.model.joint(leaf.name).id]) for leaf in leaves], dtype=int)
        self._travels = np.array([leaf.travel for leaf in leaves])
        self._things = np.array([self.model.body(thing).id for thing in things], dtype=int)

    def _addresses(self, robot: str, joints: tuple[str, ...]) -> list[int]:
        return [int(self.model.jnt_qposadr[self.model.joint(f"{robot}/{joint}").id]) for joint in joints]

    def flag_movers(self, numbers: Flags) -> Flags:
        """For each mover, whether the flag of any of its numbers is set."""
        return np.logical_or.reduceat(numbers, self._starts) if self.movers else np.empty(0, dtype=bool)

    def row(self) -> Array:
        """The numbers of all movers, in the order of `movers`."""
        position = np.asarray(self._data.qpos)
        base = position[self._base_addresses]
        robots = np.empty((len(base), 4))
        robots[:, :2] = base[:, :2] + self._origins
        robots[:, 2] = self._levels
        robots[:, 3] = np.remainder(base[:, 2] + math.pi, math.tau) - math.pi
        arms = np.concatenate([robots[: len(self._arms)], position[self._joints]], axis=1)
        things = np.concatenate([self._data.xpos[self._things], _angles(self._data.xquat[self._things])], axis=1)
        leaves = np.clip(position[self._leaves] / self._travels, 0.0, 1.0)
        return np.concatenate([arms.ravel(), robots[len(self._arms) :].ravel(), things.ravel(), leaves])


def is_same_state(first: RobotState, second: RobotState) -> bool:
    """Whether two states differ only in time."""
    same_pose = abs(first.x - second.x) < SMALLEST and abs(first.y - second.y) < SMALLEST and abs(first.yaw - second.yaw) < SMALLEST
    return (
        same_pose
        and _is_same_charge(first.charge, second.charge)
        and (first.holding, first.activity, first.faults) == (second.holding, second.activity, second.faults)
    )


def _is_same_charge(first: float | None, second: float | None) -> bool:
    return first == second if first is None or second is None else abs(first - second) < SMALLEST_CHARGE


def _faults(device: Linked) -> tuple[Fault, ...]:
    return tuple(sorted(device.faults))


def _angles(turns: Array) -> Array:
    """Yaw, pitch and roll (n, 3), about z, then the new y, then the new x, of quaternions (n, 4)."""
    w, x, y, z = turns.T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return np.stack([yaw, pitch, roll], axis=1)


def robot_statuses(simulation: Simulation) -> dict[str, RobotStatus]:
    """The current status of each device with a robot link, by name."""
    held = simulation.scene.hands.held
    return {
        name: RobotStatus(holding=held.get(name), activity=device.activity, faults=_faults(device))
        for name, device in simulation.linked.items()
    }


class PoseSubscription:
    """What was sent to one connection, and the time of its next line. Times are in seconds of real time."""

    def __init__(self, rate: float) -> None:
        self._pause = 1 / rate
        self.next_time = -math.inf
        self._last_time = -math.inf
        self._model: mujoco.MjModel | None = None
        self._row: Array = np.empty(0)
        self._statuses: dict[str, RobotStatus] = {}

    def line(self, table: Table, row: Array, statuses: dict[str, RobotStatus], time: float, now: float) -> Poses | None:
        """The next line: the changes since the last line. None if there are none and the last line is less than `SILENCE` seconds old."""
        self.next_time = max(self.next_time + self._pause, now + self._pause / 2)
        anew = table.model is not self._model
        if anew:
            self._model, self._statuses = table.model, {}
            moved = np.ones(len(table.movers), dtype=bool)
        else:
            moved = table.flag_movers(np.abs(row - self._row) > SMALLEST)
        news = {name: status for name, status in statuses.items() if status != self._statuses.get(name)}
        if not anew and not moved.any() and not news and now - self._last_time < SILENCE:
            return None
        moved_numbers = moved[table.owners]
        self._row = row if anew else np.where(moved_numbers, row, self._row)
        self._statuses, self._last_time = statuses, now
        return Poses(
            time=round(time, 3),
            clock=round(now, 4),
            movers=table.movers if anew else None,
            moved=tuple(np.flatnonzero(moved).tolist()),
            values=tuple(row[moved_numbers].round(DIGITS).tolist()),
            robots=news,
        )
