"""The drive of a lift: it takes its cabin from storey to storey, with the robots that are in it, and moves its doors.

One robot has the lift at a time: the one to which traffic has granted the cabin. The command to take the cabin
to a floor waits until none has.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec.structs import replace

from somrs.devices.simulator.link.commands import (
    MUTING,
    Command,
    CommandDone,
    Fault,
    MoveCabin,
    ReleasePassage,
    RobotState,
    ServePassage,
    Status,
    Stop,
)
from somrs.devices.simulator.motion.leaves import obstacle_in_sweep
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.world.scene import Scene
from somrs.devices.simulator.world.stationary import OnEnd, StationaryDevice
from somrs.space.leaves import Leaf
from somrs.space.shafts import Shaft
from somrs.space.solids import Solid

DOOR_SPEED = 0.6
"""Speed of the leaf of a door, m/s."""
LEVEL = 0.001
"""Difference in height up to which the cabin is at a floor, m."""


class LiftDrive(StationaryDevice):
    """The drive of one lift. `robots`: all robots. The caller calls `step` once per control period.

    `is_out_of_order`: an operator has said so. Then nobody enters it, and who is in the cabin still gets out.
    """

    refusal = "is a lift: it accepts MoveCabin to a floor at which it stops, Stop and Status"
    possible_faults = (Fault.DRIVE, *StationaryDevice.possible_faults)

    def __init__(self, solid: Solid, scene: Scene, robots: Mapping[str, Robot], shaft: Shaft) -> None:
        super().__init__(solid, scene)
        self.shaft = shaft
        self.is_out_of_order = False
        self.is_paused = False
        """Whether an operator has stopped it."""
        self._robots = robots
        self._is_taken = False
        """Whether a robot has it, by its places in traffic."""
        self._goal = self._nearest_level()
        self.is_outside = False
        """Whether a program of its own serves robots, and not the simulation."""
        self._serving: tuple[float, OnEnd] | None = None
        """The height at which a program of its own wants it open, and what is called then."""
        self._commanded: tuple[float, OnEnd] | None = None
        """The height to which the command in progress is to take the cabin, and what is called with its result."""

    @property
    def works(self) -> bool:
        """Whether it has no fault."""
        return not self.faults

    @property
    def is_usable(self) -> bool:
        """Whether robots may enter it: it works, and is not out of order."""
        return self.works and not self.is_out_of_order

    @property
    def hindrance(self) -> str | None:
        """Why it moves nobody now; None if it does."""
        if not self.works:
            return f"{self.name} does not work"
        return f"{self.name} is stopped" if self.is_paused else None

    @property
    def busy(self) -> bool:
        """Whether its cabin or one of its doors has to move."""
        is_settled = self._is_level() and all(self._is_at_goal(leaf, level) for leaf, level in self._leaves())
        return self.works and not (is_settled and self._commanded is None and self._serving is None)

    def call(self, level: float) -> None:
        """A robot has the lift, and needs the cabin at a floor, with open doors."""
        self._is_taken, self._goal = True, level

    def release(self) -> None:
        """No robot needs the lift any more."""
        self._is_taken = False

    def is_open(self, level: float) -> bool:
        """Whether the robot that has it can enter or leave it at a floor now."""
        is_there = self._is_wanted_open(level) and abs(self._goal - level) < LEVEL
        return self.works and is_there and all(leaf.is_open(self.scene.leaf_position(leaf)) for leaf in self._doors(level))

    def carries(self, robot: Robot) -> bool:
        """Whether a robot is in the cabin."""
        return abs(robot.solid.z - self.solid.z) < self.solid.height / 2 and self.shaft.contains(robot.pose()[:2])

    def state(self) -> RobotState:
        """Its state, with the height of its cabin, and with the robot in it as what it holds."""
        return replace(super().state(), z=self.solid.z, holding=next((robot.name for robot in self._carried()), None))

    def command(self, command: Command, on_end: OnEnd) -> None:
        """Carry out a command. A new command ends the one in progress."""
        if not isinstance(command, Status):
            self._give_up("stopped", f"{self.name} received another command")
        match command:
            case MoveCabin() if not self.works:
                on_end(self._given_up("drive-dead", f"{self.name} does not work"))
            case MoveCabin(z=z) if (landing := self.shaft.landing(z)) is not None:
                self._commanded, self.activity = (landing.level, on_end), type(command).__name__
            case ServePassage(z=float() as z) if self.is_outside and (landing := self.shaft.landing(z)) is not None:
                self.call(landing.level)
                self._serving, self.activity = (landing.level, on_end), type(command).__name__
            case ReleasePassage() if self.is_outside:
                self.release()
                on_end(CommandDone(state=self.state()))
            case Stop() | Status():
                on_end(CommandDone(state=self.state()))
            case _:
                on_end(self._refused())

    def _give_up(self, reason: str, description: str) -> None:
        """End the command in progress, if there is one."""
        for ended in (self._commanded, self._serving):
            if ended is not None:
                self._commanded = self._serving = self.activity = None
                ended[1](self._given_up(reason, description))

    def fault(self, fault: Fault) -> None:
        """Inject a fault: the cabin and the doors stop where they are."""
        self.faults.add(fault)
        if fault in MUTING:
            self._commanded = self._serving = self.activity = None
        self._give_up("drive-dead", f"{self.name} does not work")
        for leaf, _ in self._leaves():
            if leaf.owner.powered:
                self.scene.hold_leaf(leaf, self.scene.leaf_position(leaf))

    def step(self) -> None:
        """Move the doors, or else the cabin, for one control period."""
        if not self.works:
            return
        if self._commanded is not None and not self._is_taken:
            self._goal = self._commanded[0]
        is_shut = True
        for leaf, level in self._leaves():
            is_wanted_open = self._is_wanted_open(level)
            if not self._is_at_goal(leaf, level):
                self._move(leaf, leaf.travel if is_wanted_open else 0.0)
            elif self.scene.world.solids[leaf.owner.name].open != is_wanted_open:
                self.scene.note_leaves(leaf.owner.name)
            is_shut &= leaf.is_shut(self.scene.leaf_position(leaf))
        if is_shut and not self._is_level():
            self._move_cabin()
        elif is_shut and self._commanded is not None and not self._is_taken:
            (_, on_end), self._commanded, self.activity = self._commanded, None, None
            on_end(CommandDone(state=self.state()))
        if self._serving is not None and self.is_open(self._serving[0]):
            (_, on_end), self._serving, self.activity = self._serving, None, None
            on_end(CommandDone(state=self.state()))

    def _move(self, leaf: Leaf, goal: float) -> None:
        if not goal and obstacle_in_sweep(self.scene, leaf, self._robots.values()) is not None:
            return
        position, way = self.scene.leaf_position(leaf), DOOR_SPEED * self.scene.period
        if leaf.owner.powered:
            self.scene.drive_leaf(leaf, goal, DOOR_SPEED)
        else:
            self.scene.set_leaf(leaf, position + min(max(goal - position, -way), way))

    def _move_cabin(self) -> None:
        carried = self._carried()
        way = self.solid.speed * self.scene.period
        z = self.solid.z + min(max(self._goal - self.solid.z, -way), way)
        self.solid = self.scene.raise_object(self.name, z)
        for robot in carried:
            robot.solid = self.scene.raise_object(robot.name, z)
            robot.level = self._goal

    def _carried(self) -> list[Robot]:
        """The robots in the cabin."""
        return [robot for robot in self._robots.values() if self.carries(robot)]

    @property
    def name(self) -> str:
        return self.solid.name

    def _nearest_level(self) -> float:
        levels = [landing.level for landing in self.shaft.landings]
        return min(levels, key=lambda level: abs(level - self.solid.z), default=self.solid.z)

    def _is_level(self) -> bool:
        return abs(self.solid.z - self._goal) < LEVEL

    def _is_wanted_open(self, level: float) -> bool:
        """Whether the doors of a floor are to be open: only while somebody has the lift, and its cabin is there."""
        return self._is_taken and self._is_level() and abs(self.solid.z - level) < LEVEL

    def _is_at_goal(self, leaf: Leaf, level: float) -> bool:
        position = self.scene.leaf_position(leaf)
        return leaf.is_open(position) if self._is_wanted_open(level) else leaf.is_shut(position)

    def _leaves(self) -> Iterator[tuple[Leaf, float]]:
        """The leaves of its doors, with the heights of their floors."""
        for landing in self.shaft.landings:
            for leaf in self._doors(landing.level):
                yield leaf, landing.level

    def _doors(self, level: float) -> list[Leaf]:
        landing = self.shaft.landing(level)
        return [leaf for door in landing.doors for leaf in self.scene.leaves(door.name)] if landing is not None else []
