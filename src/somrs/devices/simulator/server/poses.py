"""The poses of everything that can move, as one row of numbers, and the changes that a subscriber has not received yet.

A row is cheap to read, and only changes are sent, so that a world at rest costs almost nothing.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from somrs.devices.simulator.link.commands import Fault, RobotState
from somrs.devices.simulator.link.lines import Mover, Poses, RobotStatus
from somrs.devices.simulator.server.linked_devices import Linked
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.joints import ARM_SEEN
from somrs.space.distances import Array
from somrs.space.solids import Role

Flags = npt.NDArray[np.bool_]

SMALLEST = 0.0005
"""Smallest change that counts as motion, in metres or radians: physics is never completely still."""
SMALLEST_CHARGE = 0.1
"""Smallest change of a battery's charge that is sent, percent."""
DIGITS = 4
"""Decimal digits of the values that are sent: a tenth of a millimetre."""
SILENCE = 1.0
"""Seconds after which a line is sent even if nothing moved."""


class Table:
    """The movers of a world, and how their numbers are read. Valid for one edition of the scene."""

    def __init__(self, simulation: Simulation) -> None:
        scene = simulation.scene
        self.edition = scene.edition
        robots = scene.world.by_role(Role.ROBOT)
        arms, bases = [robot.name for robot in robots if robot.gripper], [robot.name for robot in robots if not robot.gripper]
        owners = [(solid.name, owned) for solid in scene.world.solids.values() if (owned := scene.leaves(solid.name))]
        leaves = [leaf for _, owned in owners for leaf in owned]
        armed, swinging = ((name, 4 + len(ARM_SEEN)) for name in arms), ((name, len(owned)) for name, owned in owners)
        cabins = [solid.name for solid in scene.world.by_role(Role.LIFT)]
        things = ((thing, 6) for thing in scene.things())
        movers = [*armed, *((name, 4) for name in bases), *things, *swinging, *((lift, 4) for lift in cabins)]
        self.movers = tuple(Mover(name=name, numbers=numbers) for name, numbers in movers)
        counts = [mover.numbers for mover in self.movers]
        self.owners = np.repeat(np.arange(len(counts)), counts)
        """For each number of the row, the index of its mover."""
        self._starts = np.cumsum([0, *counts])[:-1]
        self._scene, self._cabins = scene, cabins
        self._read_scene = scene.row_reader(arms, bases, leaves)

    def row(self) -> Array:
        """The numbers of all movers, in the order of `movers`."""
        solids = self._scene.world.solids
        cabins = [(solid.x, solid.y, solid.z, solid.yaw) for solid in (solids[name] for name in self._cabins)]
        return np.concatenate([self._read_scene(), np.array(cabins, dtype=float).ravel()])

    def flag_movers(self, numbers: Flags) -> Flags:
        """For each mover, whether the flag of any of its numbers is set."""
        return np.logical_or.reduceat(numbers, self._starts) if self.movers else np.empty(0, dtype=bool)


def is_same_state(first: RobotState, second: RobotState) -> bool:
    """Whether two states differ only in time."""
    same_pose = abs(first.x - second.x) < SMALLEST and abs(first.y - second.y) < SMALLEST and abs(first.yaw - second.yaw) < SMALLEST
    return (
        same_pose
        and _is_same_height(first.z, second.z)
        and _is_same_charge(first.charge, second.charge)
        and (first.holding, first.activity, first.faults) == (second.holding, second.activity, second.faults)
        and first.hindrance == second.hindrance
    )


def _is_same_height(first: float | None, second: float | None) -> bool:
    return first == second if first is None or second is None else abs(first - second) < SMALLEST


def _is_same_charge(first: float | None, second: float | None) -> bool:
    return first == second if first is None or second is None else abs(first - second) < SMALLEST_CHARGE


def _faults(device: Linked) -> tuple[Fault, ...]:
    return tuple(sorted(device.faults))


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
        self._edition: int | None = None
        self._row: Array = np.empty(0)
        self._statuses: dict[str, RobotStatus] = {}

    def line(self, table: Table, row: Array, statuses: dict[str, RobotStatus], time: float, now: float) -> Poses | None:
        """The next line: the changes since the last line. None if there are none and the last line is less than `SILENCE` seconds old."""
        self.next_time = max(self.next_time + self._pause, now + self._pause / 2)
        anew = table.edition != self._edition
        if anew:
            self._edition, self._statuses = table.edition, {}
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
