"""A scale of the simulated world: a device on the robot link that weighs what stands on it."""

from __future__ import annotations

from msgspec.structs import replace

from somrs.devices.simulator.link.commands import Command, CommandDone, CommandGivenUp, Fault, Status, Stop, Weigh
from somrs.devices.simulator.world.stationary import OnEnd, StationaryDevice

RESOLUTION = 0.01
"""Resolution of the weights that a scale measures, kg."""


class WeighingScale(StationaryDevice):
    """One scale. It measures one weight: that of everything on it. Its commands take no time."""

    refusal = "is a scale: it accepts Weigh, Stop and Status"
    possible_faults = (Fault.DRIVE, *StationaryDevice.possible_faults)

    def command(self, command: Command, on_end: OnEnd) -> None:
        match command:
            case Weigh(object=name):
                on_end(self._weigh(name))
            case Stop() | Status():
                on_end(CommandDone(state=self.state()))
            case _:
                on_end(self._refused())

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
        scene, load = self.scene, [self.solid.name]
        for carrier in load:
            load += [thing for thing in scene.things() if scene.hands.holder(thing) is None and scene.observe(thing).support == carrier]
        return load[1:]
