"""The simulator, as an operator reaches it: what it has of robots, and their faults."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

import msgspec

from somrs.devices.simulator.link.commands import Fault, RobotState
from somrs.devices.simulator.link.link import OperatorLink
from somrs.errors import RemoteError, SomrsError

PATIENCE = 1.5
"""Seconds that whoever looks at the whole fleet waits for the simulator."""


class SimulatedRobot(msgspec.Struct, frozen=True, kw_only=True):
    """A robot in the simulator: where it truly is (metres and radians), what it holds, the command that it carries out, its faults."""

    x: float
    y: float
    yaw: float
    holding: str | None = None
    command: str | None = msgspec.field(default=None, name="doing")
    faults: tuple[Fault, ...] = ()


async def robots(simulator: str | None) -> Mapping[str, SimulatedRobot]:
    """The robots by name; none where there is no simulator, or it does not answer now."""
    if simulator is None:
        return {}
    try:
        async with asyncio.timeout(PATIENCE), link(simulator) as operator:
            states = await operator.robots()
    except (TimeoutError, SomrsError):
        return {}
    return {name: _simulated(state) for name, state in states.items()}


def _simulated(state: RobotState) -> SimulatedRobot:
    """Rounded, so that what stands still does not change."""
    x, y, yaw = (round(value, 2) for value in (state.x, state.y, state.yaw))
    return SimulatedRobot(x=x, y=y, yaw=yaw, holding=state.holding, command=state.activity, faults=state.faults)


async def break_or_mend(simulator: str | None, robot: str, fault: Fault, *, repair: bool) -> None:
    """Break something of a robot, or mend it. Raises UsageError when there is no such robot."""
    if simulator is None:
        raise RemoteError("this system has no simulator: faults can be tried with simulated robots only")
    async with link(simulator) as operator:
        await (operator.repair if repair else operator.fault)(robot, fault)


def link(simulator: str) -> OperatorLink:
    host, _, port = simulator.rpartition(":")
    return OperatorLink(host, int(port))
