"""A link to a robot of a simulation in the same process, which advances the simulation until a command has ended."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from somrs.devices.simulator.link.command_link import CommandLink
from somrs.devices.simulator.link.commands import Command, CommandDone, CommandGivenUp, RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.lines import Legs, PathStop
from somrs.devices.simulator.server.simulation import Simulation


class SimulatedLink(CommandLink):
    """Controls a robot that takes part in traffic from outside."""

    def __init__(self, simulation: Simulation, robot: str) -> None:
        self.simulation, self.robot = simulation, robot
        simulation.set_outside(robot, True)

    @classmethod
    def of_device(cls, simulation: Simulation, name: str) -> Self:
        """Control a device that does not drive: a door."""
        link = cls.__new__(cls)
        link.simulation, link.robot = simulation, name
        return link

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        pass

    @property
    def state(self) -> RobotState:
        return self.simulation.state(self.robot)

    @property
    def connected(self) -> bool:
        return True

    async def wait_reconnected(self, timeout: float) -> bool:
        return True

    async def command(self, command: Command) -> CommandDone:
        results: list[CommandDone | CommandGivenUp] = []
        self.simulation.command(self.robot, command, results.append)
        while not results:
            self.simulation.step()
        (result,) = results
        if isinstance(result, CommandDone):
            return result
        raise RobotGaveUp(result.reason, result.description, result.state)

    async def legs(self, *stops: PathStop, situation: str | None = None) -> Legs:
        raise NotImplementedError
