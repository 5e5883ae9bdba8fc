"""A scale of the simulated world: a device on the robot link that weighs what stands on it."""

from __future__ import annotations

from msgspec.structs import replace

from somrs.devices.simulator.link.commands import Command, CommandDone, CommandGivenUp, Fault, RobotState, Status, Stop, Weigh
from somrs.devices.simulator.world.scene import Scene
from somrs.devices.simulator.world.solids import Solid

RESOLUTION = 0.01
"""Resolution of the weights that a scale measures, kg."""


class WeighingScale:
    """One scale. It measures one weight: that of everything on it."""

    activity: None = None

    def __init__(self, solid: Solid, scene: Scene) -> None:
        self.solid, self.scene = solid, scene
        self.faults: set[Fault] = set()

    def state(self) -> RobotState:
        solid = self.solid
        return RobotState(time=self.scene.time, x=solid.x, y=solid.y, yaw=solid.yaw, faults=tuple(sorted(self.faults)))

    def command(self, command: Command) -> CommandDone | CommandGivenUp:
        """Carry out a command, which takes no time."""
        match command:
            case Weigh(object=name):
                return self._weigh(name)
            case Stop() | Status():
                return CommandDone(state=self.state())
        return self._given_up("not-possible", f"{self.solid.name} is a scale: it accepts Weigh, Stop and Status")

    def _weigh(self, name: str) -> CommandDone | CommandGivenUp:
        load = self._load()
        if Fault.DRIVE in self.faults:
            return self._given_up("drive-dead", f"{self.solid.name} is broken")
        if name not in load:
            return self._given_up("not-possible", f"{name} does not stand on {self.solid.name}")
        if len(load) > 1:
            others = ", ".join(thing for thing in load if thing != name)
            return self._given_up(
                "not-possible", f"{others} is on {self.solid.name}, too, which measures only the weight of all things on it"
            )
        weight = round(self.scene.world.solids[name].weight / RESOLUTION) * RESOLUTION
        return CommandDone(state=self.state(), object_states=(replace(self.scene.observe(name), weight=weight),))

    def _load(self) -> list[str]:
        """The things that stand on the scale, or on a thing on it."""
        load = [self.solid.name]
        for carrier in load:
            load += [
                thing for thing in self.scene.things() if self.scene.holder(thing) is None and self.scene.observe(thing).support == carrier
            ]
        return load[1:]

    def _given_up(self, reason: str, description: str) -> CommandGivenUp:
        return CommandGivenUp(reason=reason, description=description, state=self.state())
