"""The drive of a powered door: a device on the robot link that opens and closes its own leaf."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from somrs.devices.simulator.link.commands import Close, Command, CommandDone, CommandGivenUp, Fault, Open, Status, Stop
from somrs.devices.simulator.motion.leaves import obstacle_in_sweep
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.world.scene import Scene
from somrs.devices.simulator.world.stationary import OnEnd, StationaryDevice
from somrs.space.leaves import Leaf
from somrs.space.solids import Solid

DRIVE_SPEED = 0.3
"""Speed of the leaf, m/s."""
DRIVE_PATIENCE = 45.0
"""Time for which the drive waits for a free doorway before it gives up, s."""


class DoorDrive(StationaryDevice):
    """The drive of one door. `robots`: those for which it waits. The caller calls `step` once per control period."""

    refusal = "is a door: it accepts Open and Close of itself, Stop and Status"

    def __init__(self, solid: Solid, scene: Scene, robots: Mapping[str, Robot]) -> None:
        super().__init__(solid, scene)
        self._robots = robots
        self._goal: float | None = None
        self._waited = 0.0
        self._on_end: OnEnd | None = None

    @property
    def _leaf(self) -> Leaf:
        (leaf,) = self.scene.leaves(self.solid.name)
        return leaf

    @property
    def busy(self) -> bool:
        return self._goal is not None

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
                self._on_end, self.activity = on_end, type(command).__name__
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
            self._on_end = None
            self._rest()

    def step(self) -> bool:
        """Move the leaf for one control period. Returns whether it has come to rest now."""
        if self._goal is None:
            return False
        leaf, position = self._leaf, self.scene.leaf_position(self._leaf)
        if leaf.is_open(position) if self._goal else leaf.is_shut(position):
            on_end = self._on_end
            self.scene.note_leaves(self.solid.name)
            self._rest(self._goal)
            if on_end is not None:
                on_end(self._done())
            return True
        obstacle = None if self._goal else obstacle_in_sweep(self.scene, leaf, self._robots.values())
        if obstacle is not None:
            self._waited += self.scene.period
            if self._waited > DRIVE_PATIENCE:
                self._give_up("blocked", f"{obstacle} stands in the way of {self.solid.name}")
            return self._goal is None
        self.scene.drive_leaf(leaf, self._goal, DRIVE_SPEED)
        return False

    def _rest(self, position: float | None = None) -> None:
        """Hold the leaf at a position; by default where it is."""
        self._goal, self._on_end, self.activity = None, None, None
        self.scene.hold_leaf(self._leaf, self.scene.leaf_position(self._leaf) if position is None else position)

    def _give_up(self, reason: str, description: str) -> None:
        """End the command in progress, if there is one."""
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
