"""Where everything is that can move, as numbers in one row, and what of it one who follows has not heard yet.

A row is cheap to read from the physics, and only what moved is said: a world at rest costs nothing.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from somrs.devices.simulator.link.commands import Fault, RobotState
from somrs.devices.simulator.link.lines import Mover, Poses, Work
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.chassis import ARM_SEEN, BASE_JOINTS
from somrs.devices.simulator.world.distances import Array
from somrs.devices.simulator.world.solids import Role
from somrs.devices.simulator.world.vision import StationaryCamera

Flags = npt.NDArray[np.bool_]

SMALLEST = 0.0005
"""What moved by less, in metres or radians, has not moved: physics is never quite still."""
DIGITS = 4
"""After the point: a tenth of a millimetre."""
SILENCE = 1.0
"""Seconds after which a line is said though nothing moved."""


class Table:
    """What can move in a compiled world, and where its numbers are. Made anew after each compilation."""

    def __init__(self, simulation: Simulation) -> None:
        scene = simulation.scene
        self.model, self._data = scene.model, scene.data
        robots = scene.world.of(Role.ROBOT)
        self._arms, self._bases = [one for one in robots if one.gripper], [one for one in robots if not one.gripper]
        things = list(scene.things())
        armed = [(one.name, 4 + len(ARM_SEEN)) for one in self._arms]
        movers = [*armed, *((one.name, 4) for one in self._bases), *((thing, 6) for thing in things)]
        self.movers = tuple(Mover(name=name, numbers=numbers) for name, numbers in movers)
        counts = [one.numbers for one in self.movers]
        self.owners = np.repeat(np.arange(len(counts)), counts)
        """Whose each number of the row is."""
        self._starts = np.cumsum([0, *counts])[:-1]
        ordered = [*self._arms, *self._bases]
        self._at = np.array([self._addresses(one.name, BASE_JOINTS) for one in ordered], dtype=int).reshape(-1, 3)
        self._origins = np.array([self.model.body(one.name).pos[:2] for one in ordered]).reshape(-1, 2)
        self._levels = np.array([one.z for one in ordered])
        self._joints = np.array([self._addresses(one.name, ARM_SEEN) for one in self._arms], dtype=int).reshape(-1, len(ARM_SEEN))
        self._things = np.array([self.model.body(thing).id for thing in things], dtype=int)

    def _addresses(self, robot: str, joints: tuple[str, ...]) -> list[int]:
        return [int(self.model.jnt_qposadr[self.model.joint(f"{robot}/{joint}").id]) for joint in joints]

    def each(self, numbers: Flags) -> Flags:
        """For each mover, whether it is so of any of its numbers."""
        return np.logical_or.reduceat(numbers, self._starts) if self.movers else np.empty(0, dtype=bool)

    def row(self) -> Array:
        """The numbers of all movers, one after the other."""
        position = np.asarray(self._data.qpos)
        base = position[self._at]
        robots = np.empty((len(base), 4))
        robots[:, :2] = base[:, :2] + self._origins
        robots[:, 2] = self._levels
        robots[:, 3] = np.remainder(base[:, 2] + math.pi, math.tau) - math.pi
        arms = np.concatenate([robots[: len(self._arms)], position[self._joints]], axis=1)
        things = np.concatenate([self._data.xpos[self._things], _angles(self._data.xquat[self._things])], axis=1)
        return np.concatenate([arms.ravel(), robots[len(self._arms) :].ravel(), things.ravel()])


def same(one: RobotState, other: RobotState) -> bool:
    """Whether nothing is otherwise but the time."""
    still = abs(one.x - other.x) < SMALLEST and abs(one.y - other.y) < SMALLEST and abs(one.yaw - other.yaw) < SMALLEST
    return still and (one.holding, one.doing, one.faults) == (other.holding, other.doing, other.faults)


def _faults(one: Robot | StationaryCamera) -> tuple[Fault, ...]:
    return tuple(sorted(one.faults))


def _angles(turns: Array) -> Array:
    """Yaw, pitch and roll (about z, then the new y, then the new x) of quaternions (n, 4)."""
    w, x, y, z = turns.T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return np.stack([yaw, pitch, roll], axis=1)


def works(simulation: Simulation) -> dict[str, Work]:
    """What each robot and camera does now."""
    held = simulation.scene.held
    robots = {name: Work(holding=held.get(name), doing=one.doing, faults=_faults(one)) for name, one in simulation.robots.items()}
    return {**robots, **{name: Work(faults=_faults(one)) for name, one in simulation.cameras.items()}}


class Telling:
    """What one connection was told, and when it is to be told again. Times are of the clock on the wall."""

    def __init__(self, rate: float) -> None:
        self._pause = 1 / rate
        self.next = -math.inf
        self._last = -math.inf
        self._model: mujoco.MjModel | None = None
        self._row: Array = np.empty(0)
        self._works: dict[str, Work] = {}

    def line(self, table: Table, row: Array, doing: dict[str, Work], time: float, now: float) -> Poses | None:
        """What is new, if anything is or nothing was said for long."""
        self.next = max(self.next + self._pause, now + self._pause / 2)
        anew = table.model is not self._model
        if anew:
            self._model, self._works = table.model, {}
            moved = np.ones(len(table.movers), dtype=bool)
        else:
            moved = table.each(np.abs(row - self._row) > SMALLEST)
        news = {name: one for name, one in doing.items() if one != self._works.get(name)}
        if not anew and not moved.any() and not news and now - self._last < SILENCE:
            return None
        said = moved[table.owners]
        self._row = row if anew else np.where(said, row, self._row)
        self._works, self._last = doing, now
        return Poses(
            time=round(time, 3),
            clock=round(now, 4),
            movers=table.movers if anew else None,
            moved=tuple(np.flatnonzero(moved).tolist()),
            values=tuple(row[said].round(DIGITS).tolist()),
            robots=news,
        )
