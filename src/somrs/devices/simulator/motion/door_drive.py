"""The drive of a powered door: a device on the robot link that opens and closes its own leaf.

An automatic door also opens by itself while a robot is to drive through it or is in it, and shuts behind the last one.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from somrs.devices.simulator.link.commands import (
    Close,
    Command,
    CommandDone,
    CommandGivenUp,
    Fault,
    Open,
    ReleasePassage,
    ServePassage,
    Status,
    Stop,
)
from somrs.devices.simulator.motion.leaves import obstacle_in_sweep
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.world.scene import Scene
from somrs.devices.simulator.world.stationary import OnEnd, StationaryDevice
from somrs.space.leaves import Leaf
from somrs.space.solids import Solid

DRIVE_SPEED = 0.3
"""Speed of the leaf, m/s."""
AUTOMATIC_SPEED = 0.6
"""Speed of the leaf of an automatic door that moves by itself, m/s."""
LINGER = 2.0
"""Time for which an automatic door stays open behind a robot, s."""
DRIVE_PATIENCE = 45.0
"""Time for which the drive waits for a free doorway before it gives up, s."""


class DoorDrive(StationaryDevice):
    """The drive of one door. `robots`: those for which it waits. The caller calls `step` once per control period."""

    refusal = "is a door: it accepts Open and Close of itself, Stop and Status"
    possible_faults = (Fault.DRIVE, *StationaryDevice.possible_faults)

    def __init__(self, solid: Solid, scene: Scene, robots: Mapping[str, Robot]) -> None:
        super().__init__(solid, scene)
        self._robots = robots
        self._goal: float | None = None
        self._waited = 0.0
        self._on_end: OnEnd | None = None
        self.is_out_of_order = self.is_paused = False
        """Whether an operator has said that nobody uses it; whether one has stopped it."""
        self.stays_open = solid.open
        """Whether it was opened by a command, or is open on the map: then it does not shut by itself."""
        self.is_outside = False
        """Whether a program of its own serves robots, and not the simulation."""
        self._serving: OnEnd | None = None
        """What is called when it is open, as a program of its own wants it."""
        self._is_needed = self._is_obstructed = False
        self._needed_until = -LINGER

    @property
    def is_usable(self) -> bool:
        """Whether robots may drive through it: it works, and is not out of order."""
        return not self.faults and not self.is_out_of_order

    @property
    def is_open(self) -> bool:
        """Whether robots can drive through it now."""
        return self._leaf.is_open(self.scene.leaf_position(self._leaf)) and (self._goal is None or self._goal > 0)

    @property
    def hindrance(self) -> str | None:
        """Why it does not open now; None if it does."""
        if self.faults:
            return f"{self.solid.name} does not work"
        return f"{self.solid.name} is stopped" if self.is_paused else None

    def need(self, needed: bool) -> None:
        """Whether a robot is to drive through it, or is in it."""
        self._is_needed = needed

    @property
    def _leaf(self) -> Leaf:
        (leaf,) = self.scene.leaves(self.solid.name)
        return leaf

    @property
    def busy(self) -> bool:
        """Whether its leaf has to move, or will have to when the robot behind it is gone."""
        return (
            self._goal is not None
            or self._serving is not None
            or (self._moves_by_itself and not self._is_obstructed and not self._is_as_wanted())
        )

    def command(self, command: Command, on_end: OnEnd) -> None:
        """Carry out a command. A new command ends the one in progress."""
        if not isinstance(command, Status):
            self._give_up("stopped", f"{self.solid.name} received another command")
        match command:
            case Open(object=name) | Close(object=name) if name == self.solid.name:
                if Fault.DRIVE in self.faults:
                    on_end(self._given_up("drive-dead", f"the drive of {name} is dead"))
                    return
                self._goal, self._waited = self._leaf.travel if isinstance(command, Open) else 0.0, 0.0
                self._on_end, self.activity, self.stays_open = on_end, type(command).__name__, isinstance(command, Open)
            case ServePassage() if self.is_outside and self._moves_by_itself:
                self.need(True)
                self._serving, self.activity = on_end, type(command).__name__
            case ReleasePassage() if self.is_outside:
                self.need(False)
                on_end(self._done())
            case Stop() | Status():
                on_end(self._done())
            case _:
                on_end(self._refused())

    def fault(self, fault: Fault) -> None:
        """Inject a fault: the leaf stops."""
        self.faults.add(fault)
        if fault is Fault.DRIVE:
            self._give_up("drive-dead", f"the drive of {self.solid.name} is dead")
        else:
            self._on_end = self._serving = None
            self._rest()

    def step(self) -> bool:
        """Move the leaf for one control period. Returns whether it has come to rest now."""
        if self._is_needed:
            self._needed_until = self.scene.time + LINGER
        if self._goal is None:
            if self._moves_by_itself:
                self._move_by_itself()
            if self._serving is not None and self.is_open:
                serving, self._serving, self.activity = self._serving, None, None
                serving(self._done())
            return False
        leaf, position = self._leaf, self.scene.leaf_position(self._leaf)
        if leaf.is_open(position) if self._goal else leaf.is_shut(position):
            on_end = self._on_end
            self.scene.note_leaves(self.solid.name)
            self._rest(self._goal)
            if on_end is not None:
                on_end(self._done())
            return True
        obstacle = None if self._goal else self._obstacle()
        if obstacle is not None:
            self._waited += self.scene.period
            if self._waited > DRIVE_PATIENCE:
                self._give_up("blocked", f"{obstacle} stands in the way of {self.solid.name}")
            return self._goal is None
        self.scene.drive_leaf(leaf, self._goal, DRIVE_SPEED)
        return False

    def _obstacle(self) -> str | None:
        """What keeps the leaf from shutting: a thing or a robot in its way, or one that is to come."""
        if self._moves_by_itself and self._is_needed:
            return "a robot that is to drive through"
        return obstacle_in_sweep(self.scene, self._leaf, self._robots.values())

    @property
    def _moves_by_itself(self) -> bool:
        return self.solid.automatic and not self.faults

    @property
    def _is_wanted_open(self) -> bool:
        return self.stays_open or self._is_needed or self.scene.time < self._needed_until

    def _is_as_wanted(self) -> bool:
        position = self.scene.leaf_position(self._leaf)
        if self._is_wanted_open:
            return self._leaf.is_open(position) and (self.stays_open or self._is_needed)
        is_noted = not self.scene.world.solids[self.solid.name].open
        return is_noted and self._leaf.is_shut(position)

    def _move_by_itself(self) -> None:
        """Move the leaf of an automatic door for one control period, unless it is where it is to be."""
        leaf, position, opens = self._leaf, self.scene.leaf_position(self._leaf), self._is_wanted_open
        if leaf.is_open(position) if opens else leaf.is_shut(position):
            if self.scene.world.solids[self.solid.name].open != opens:
                self.scene.note_leaves(self.solid.name)
                self._rest(leaf.travel if opens else 0.0)
            return
        self._is_obstructed = not opens and self._obstacle() is not None
        if not self._is_obstructed:
            self.scene.drive_leaf(leaf, leaf.travel if opens else 0.0, AUTOMATIC_SPEED)

    def _rest(self, position: float | None = None) -> None:
        """Hold the leaf at a position; by default where it is."""
        self._goal, self._on_end, self.activity = None, None, None
        self.scene.hold_leaf(self._leaf, self.scene.leaf_position(self._leaf) if position is None else position)

    def _give_up(self, reason: str, description: str) -> None:
        """End the command in progress, if there is one."""
        serving, self._serving = self._serving, None
        if serving is not None:
            self.activity = None
            serving(self._given_up(reason, description))
        on_end = self._on_end
        if self._goal is not None:
            self.scene.note_leaves(self.solid.name)
            self._rest()
        if on_end is not None:
            on_end(self._given_up(reason, description))

    def _given_up(self, reason: str, description: str) -> CommandGivenUp:
        return structs.replace(super()._given_up(reason, description), object_states=(self.scene.observe(self.solid.name),))

    def _done(self) -> CommandDone:
        return CommandDone(state=self.state(), object_states=(self.scene.observe(self.solid.name),))
