"""A body in the simulator of SO-MRS: it drives, grips and charges by the robot link."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Mapping
from types import MappingProxyType

from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.mqtt import BrokerAddress
from somrs.adapters.vda5050.simulated.body import Charge, Command, Drive, Drop, Pick, Rest, Sensed
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.simulated.program import MqttVehicle, serve
from somrs.adapters.vda5050.simulated.vehicle import SimulatedVehicle
from somrs.adapters.vda5050.topics import VehicleAddress
from somrs.devices.link_security import link_credentials
from somrs.devices.simulator.link.commands import Fault, RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import RobotLink, link_address

log = logging.getLogger(__name__)

NO_LEVELS: Mapping[str, float] = MappingProxyType({})

REACH = 0.5
"""How far before their middles robots of the simulator put things down, m."""
CONTOUR = 0.2
"""How far the smallest robots of the simulator extend around their middle, m."""


class LinkBody:
    """The body of a robot of the simulator, which takes part in traffic from outside of it. `levels`: the heights of the floors, by the
    maps of which the vehicle is told which one it is on; without any, it is on one map always."""

    def __init__(self, link: RobotLink, state: RobotState, levels: Mapping[str, float]) -> None:
        self._link, self._first_state, self._levels = link, state, levels
        self._number = self._finished = 0
        self._failure: str | None = None
        self._command: Command | None = None
        self._task: asyncio.Task[None] | None = None

    def begin(self, number: int, command: Command) -> None:
        if self._task is not None:
            self._task.cancel()
        self._number, self._command, self._failure = number, command, None
        self._task = asyncio.create_task(self._carry_out(number, command))

    def sense(self, now: float) -> Sensed:
        state = self._link.state or self._first_state
        is_charging = isinstance(self._command, Charge)
        return Sensed(
            x=state.x,
            y=state.y,
            yaw=state.yaw,
            charge=state.charge if state.charge is not None else 100.0,
            is_moving=isinstance(self._command, Drive),
            is_charging=is_charging,
            finished=self._number if is_charging else self._finished,
            failure=self._failure,
            load=state.holding,
            reach=REACH,
            fault="the drive is dead" if Fault.DRIVE in state.faults else None,
            map_id=min(self._levels, key=lambda map_id: abs(self._levels[map_id] - (state.z or 0.0)), default=None),
        )

    @property
    def is_reachable(self) -> bool:
        """Whether its radio works."""
        return self._link.connected and not self._link.silent

    async def _carry_out(self, number: int, command: Command) -> None:
        failure = None
        try:
            match command:
                case Drive(points=points, speed=speed, backward=backward, yaw=yaw):
                    await self._link.drive_along(points, yaw, speed=speed, backward=backward)
                case Pick(load=load):
                    await self._link.grip(load)
                case Drop(station=station) if station:
                    await self._link.place(station)
                case Drop():
                    await self._link.put_down_object()
                case Charge():
                    await self._link.charge()
                case Rest():
                    await self._link.stop()
        except RobotGaveUp as failed:
            failure = failed.description
        if number == self._number:
            self._finished, self._failure = number, failure
            self._command = None if not isinstance(command, Charge) else command


@contextlib.asynccontextmanager
async def simulated_vehicles(
    robots: Mapping[str, tuple[VehicleAddress, Version]], simulator: str, broker: BrokerAddress, levels: Mapping[str, float] = NO_LEVELS
) -> AsyncIterator[list[MqttVehicle]]:
    """Put robots of the simulator at an address behind a broker, as vehicles at these addresses. Run them by `serve`."""
    host, port, map = link_address(simulator)
    credentials = link_credentials(simulator, None)
    async with contextlib.AsyncExitStack() as stack:
        vehicles = []
        for name, (address, version) in robots.items():
            link = RobotLink(host, port, name, rate=20, map=map, outside=True, credentials=credentials)
            await stack.enter_async_context(link)
            body = LinkBody(link, (await link.status()).state, levels)
            first_map = body.sense(0.0).map_id or "map"
            vehicle = SimulatedVehicle(version, factsheet(), map_id=first_map, maps=levels, contour=CONTOUR)
            vehicles.append(MqttVehicle(address, vehicle, body, broker))
        yield vehicles


async def serve_simulated(
    robots: Mapping[str, tuple[VehicleAddress, Version]], simulator: str, broker: BrokerAddress, levels: Mapping[str, float] = NO_LEVELS
) -> None:
    """Run `simulated_vehicles` until cancelled."""
    async with simulated_vehicles(robots, simulator, broker, levels) as vehicles:
        for vehicle in vehicles:
            log.info("%s: VDA 5050 %s", vehicle.address, vehicle.vehicle.version)
        await serve(vehicles)
