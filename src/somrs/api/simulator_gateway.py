"""Access to the simulator as its operator: the states of simulated devices, and their faults."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager

import msgspec

from somrs.client.addresses import Addresses
from somrs.client.simulator_link import operator_link
from somrs.devices.simulator.link.commands import Fault, LinkedDevice
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.link.roads import TrafficState
from somrs.errors import RemoteError, SomrsError, UsageError

NO_TRAFFIC = TrafficState(roadmap=0, robots={})

PATIENCE = 1.5
"""Seconds to wait for the simulator's answers to a few questions."""


class SimulatedDeviceView(msgspec.Struct, frozen=True, kw_only=True):
    """A robot or another device in the simulator: its true pose (metres and radians), what it holds, the `command` that it executes (JSON:
    `doing`), its faults, and those that it can have. A lift holds the robot in it."""

    x: float
    y: float
    yaw: float
    holding: str | None = None
    command: str | None = msgspec.field(default=None, name="doing")
    faults: tuple[Fault, ...] = ()
    possible_faults: tuple[Fault, ...] = ()


async def simulated_devices(addresses: Addresses) -> tuple[Mapping[str, SimulatedDeviceView], TrafficState]:
    """The simulated devices by name, and their traffic; both empty if there is no simulator, or if it does not answer within
    `PATIENCE`."""
    if addresses.simulator is None:
        return {}, NO_TRAFFIC
    try:
        async with answering(addresses) as operator:
            devices, traffic = await operator.devices(), await operator.traffic()
    except SomrsError:
        return {}, NO_TRAFFIC
    return {name: _view(device) for name, device in devices.items()}, traffic


def _view(device: LinkedDevice) -> SimulatedDeviceView:
    """The state of a device, with its pose rounded so that a robot that stands still does not change."""
    state = device.state
    x, y, yaw = (round(value, 2) for value in (state.x, state.y, state.yaw))
    return SimulatedDeviceView(
        x=x,
        y=y,
        yaw=yaw,
        holding=state.holding,
        command=state.activity,
        faults=state.faults,
        possible_faults=device.possible_faults,
    )


async def break_or_mend(addresses: Addresses, device: str, fault: Fault, *, repair: bool) -> None:
    """Inject a fault into a simulated device, or with `repair` remove it.

    Raises:
        UsageError: there is no such device, or it cannot have the fault.
        RemoteError: the system has no simulator.
    """
    if addresses.simulator is None:
        raise RemoteError("this system has no simulator; faults can be injected into simulated devices only")
    async with operator_link(addresses) as operator:
        await (operator.repair if repair else operator.fault)(device, fault)


async def put_robot(addresses: Addresses, robot: str, x: float, y: float, z: float, yaw: float) -> None:
    """Put a simulated robot elsewhere. Raises UsageError if it is none or does not fit there, and RemoteError without a simulator."""
    if addresses.simulator is None:
        raise RemoteError("this system has no simulator; only simulated robots can be put elsewhere")
    async with answering(addresses) as operator:
        if robot not in await operator.robots():
            raise UsageError(f"{robot} is no simulated robot: carry it there, and it reports where it is")
        await operator.move(robot, x, y, z, yaw)


@asynccontextmanager
async def answering(addresses: Addresses) -> AsyncIterator[OperatorLink]:
    """A link for a few questions. Raises RemoteError if they are not answered within `PATIENCE`."""
    try:
        async with asyncio.timeout(PATIENCE), operator_link(addresses) as operator:
            yield operator
    except TimeoutError:
        raise RemoteError(f"the simulator did not answer within {PATIENCE:g} s; try again") from None
