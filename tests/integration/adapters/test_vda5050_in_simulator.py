"""Robots of the simulator as VDA 5050 vehicles at a real broker: they drive, halt, pick and drop."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.adapters.vda5050.control.exchange import ActionEnded, Follow, Halt, Halted, Passed, Perform
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.orders import ActionParameter
from somrs.adapters.vda5050.mqtt import Certificates, broker_address
from somrs.adapters.vda5050.simulated.link_body import simulated_vehicles
from somrs.adapters.vda5050.simulated.program import address_of, serve
from somrs.devices.road_robot import Way, Waypoint
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support.building import jar_lab
from tests.support.mqtt_broker import MqttBroker
from tests.support.robot_lab import simulator
from tests.support.vda5050_fleet import NotedFleet, fleet_control, wait_until

SITE = jar_lab("Robot1: {type: PioneerP3DX, at: [3, 3, 0], Speed: 0.8}")

JAR = (ActionParameter(key="loadId", value="Jar1"), ActionParameter(key="stationName", value="Table1"))


def points(*points: tuple[float, float], first: int = 0) -> Way:
    return tuple(
        Waypoint(number=first + index, name=f"Place{first + index}", x=x, y=y, level=0.0, released=True)
        for index, (x, y) in enumerate(points)
    )


async def perform(fleet: NotedFleet, action_type: str) -> str | None:
    """Have Robot1 perform an action with the jar. Returns why it failed; None if it did not."""
    effects = fleet.effects["Robot1"]
    effects.clear()
    fleet.devices["Robot1"].session.give(Perform(action_type=action_type, parameters=JAR))
    await wait_until(lambda: any(isinstance(effect, ActionEnded) for effect in effects))
    return next(effect.failure for effect in effects if isinstance(effect, ActionEnded))


@pytest.mark.parametrize("version", [Version.V2_1, Version.V3_0])
def test_a_robot_of_the_simulator_is_a_vehicle(tmp_path: Path, version: Version) -> None:
    async def test(broker: MqttBroker) -> None:
        settings = {"broker": broker.url, "vehicles": {"Robot1": {"manufacturer": "SOMRS", "serialNumber": "Robot1"}}}
        address = broker_address(broker.url, Certificates(), Path())
        async with (
            simulator(1, SITE, WorldKind.KINEMATIC) as server,
            OperatorLink(server.host, server.port) as operator,
            simulated_vehicles(
                {"Robot1": (address_of("Robot1", version, "SOMRS"), version)}, f"{server.host}:{server.port}", address
            ) as vehicles,
            fleet_control(settings) as fleet,
        ):
            running = asyncio.create_task(serve(vehicles))
            try:
                await wait_until(lambda: "Robot1" in fleet.devices)
                session = fleet.devices["Robot1"].session
                session.give(Follow(way=points((3.0, 3.0), (6.0, 3.0))))
                await wait_until(lambda: session.control.vehicle.pose is not None and session.control.vehicle.pose.x > 3.5)
                session.give(Halt())
                await wait_until(lambda: fleet.has("Robot1", Halted()))
                halted = (await operator.robots())["Robot1"]
                assert 3.4 < halted.x < 5.5
                session.give(Follow(way=points((3.0, 3.0), (3.0, 4.0), (1.75, 4.0), first=10)))
                await wait_until(lambda: fleet.has("Robot1", Passed(number=12)))
                assert await perform(fleet, "pick") is None
                assert (await operator.robots())["Robot1"].holding == "Jar1"
                assert await perform(fleet, "drop") is None
                assert (await operator.observe("Jar1")).support == "Table1"
                assert await perform(fleet, "drop") is not None
            finally:
                running.cancel()
                await asyncio.wait({running})

    with MqttBroker(tmp_path) as broker:
        asyncio.run(test(broker))
