"""Two rooms with a carrying robot, a patrol robot and a camera, and their drivers, for tests of observation."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from somrs.devices.simulator.drivers.fixed_camera import FixedCamera
from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.devices.simulator.drivers.patrol import PatrolRobot
from somrs.devices.simulator.drivers.simulated import SimulatedDevice
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.server.server import Server
from somrs.ontology.map import Map
from somrs.repository.component import Repository
from somrs.service_manager.sdk.device import Device
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Advance, Halt, Order, Perform, Quote, Undo, WorkDone
from tests.support import robot_lab
from tests.support.building import building
from tests.support.virtual_devices import make_ask

SITE = (
    building("TwoRooms", 12, 6, "Wall1: {type: Wall, at: [6, 2, 0], Shape: {Form: Box, Width: 0.1, Depth: 4, Height: 2.5}}")
    + """
  Table1: {type: Table, at: [1, 4, 0], Shape: {Form: Box, Width: 0.6, Depth: 1, Height: 0.7}}
  Platform1: {type: Platform, at: [10.5, 4, 0], Shape: {Form: Box, Width: 0.8, Depth: 0.8, Height: 0.3}}
  Shelf1: {type: Shelf, at: [8, 0.6, 0], Shape: {Form: Box, Width: 1.2, Depth: 0.6, Height: 0.9}}
  Jar1: {type: Jar, at: [1.15, 4, 0.7]}
  Robot1: {type: PioneerP3DX, at: [2, 1.5, 0], Price: 10 EUR, Speed: 0.8}
  Patrol1: {type: PatrolRobot, at: [8, 5, 0], Price: 3 EUR, Speed: 1.0}
  Camera1: {type: Camera, at: [11.9, 5.9, 2.3], turned: -135 deg, Price: 1 EUR}
facts:
  - Jar1 isOn Table1
"""
)

KINDS: dict[str, type[SimulatedDevice]] = {"Robot1": Manipulator, "Patrol1": PatrolRobot, "Camera1": FixedCamera}


def map_after(situation: str | None) -> Map:
    """Return the map of the rooms after the situation was made to hold."""
    return robot_lab.map_after(situation, SITE)


def look_order(object: str) -> Order:
    return Order(participant="p", method="recognize", inputs={"Object": object}, effect=f"{object}.Unknown = FALSE")


def carry_order(object: str, destination: str) -> Order:
    inputs = {"Object": object, "Destination": destination}
    return Order(participant="q", method="transfer", inputs=inputs, effect=f"{object} isOn {destination}")


@dataclass
class Lab:
    """The simulated rooms, their map in a Repository, and the opened devices."""

    server: Server
    operator: OperatorLink
    repository: Repository
    devices: dict[str, Device] = field(default_factory=dict)
    advances: list[Advance] = field(default_factory=list)

    async def open(self, name: str, **settings: object) -> Device:
        device = KINDS[name](name, f"{self.server.host}:{self.server.port}")
        for setting, value in settings.items():
            setattr(device, setting, value)
        device.map = MapReader(make_ask(self.repository, lambda: 0.0))
        self.devices[name] = device
        await device.open()
        return device

    async def run_task(self, device: Device, work: Quote | Perform | Halt | Undo) -> object:
        return await robot_lab.run_work(device, work, self.repository, self.advances)

    async def recognize(self, device: Device, object: str) -> str:
        """Return the situation that the device reports of an object."""
        result = await self.run_task(device, Perform(look_order(object)))
        assert isinstance(result, WorkDone)
        assert result.situation is not None
        return result.situation


@asynccontextmanager
async def lab(speed: float | None = None) -> AsyncIterator[Lab]:
    async with robot_lab.simulator(speed, SITE) as server, OperatorLink(server.host, server.port) as operator:
        rooms = Lab(server, operator, robot_lab.repository(SITE))
        try:
            yield rooms
        finally:
            for device in rooms.devices.values():
                await device.close()
