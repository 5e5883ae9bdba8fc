"""Devices of the simulated world that stand still and have a robot link, such as cameras, scales and powered doors."""

from __future__ import annotations

from collections.abc import Callable

from somrs.devices.simulator.link.commands import MUTING, Command, CommandDone, CommandGivenUp, Fault, RobotState
from somrs.devices.simulator.world.scene import Scene
from somrs.space.solids import Solid

OnEnd = Callable[[CommandDone | CommandGivenUp], None]
"""Takes the result of a command, once."""


class StationaryDevice:
    """A device that stands still. `refusal`: what it answers to other commands than it accepts."""

    refusal = "accepts only Status"
    possible_faults: tuple[Fault, ...] = (Fault.SILENT, Fault.LINK)

    def __init__(self, solid: Solid, scene: Scene) -> None:
        self.solid, self.scene = solid, scene
        self.faults: set[Fault] = set()
        self.activity: str | None = None

    @property
    def is_mute(self) -> bool:
        """Whether a fault keeps it from sending anything."""
        return not MUTING.isdisjoint(self.faults)

    def state(self) -> RobotState:
        solid, faults = self.solid, tuple(sorted(self.faults))
        return RobotState(time=self.scene.time, x=solid.x, y=solid.y, yaw=solid.yaw, activity=self.activity, faults=faults)

    def command(self, command: Command, on_end: OnEnd) -> None:
        """Carry out a command."""
        on_end(self._refused())

    def _refused(self) -> CommandGivenUp:
        return self._given_up("not-possible", f"{self.solid.name} {self.refusal}")

    def _given_up(self, reason: str, description: str) -> CommandGivenUp:
        return CommandGivenUp(reason=reason, description=description, state=self.state())
