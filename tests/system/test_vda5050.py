"""A whole system whose robots are VDA 5050 vehicles: tasks are accomplished as with any robots."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.files.dump import dump_map
from somrs.ontology.files.loading import upper
from somrs.ontology.files.site import dump_site
from somrs.ontology.objects import Fact, Object
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.task_views import TaskView
from somrs.sites.openrmf import import_building
from tests.support import warm
from tests.support.accomplishing import accomplish
from tests.support.building import building
from tests.support.hang import HANG_TIME
from tests.support.paths import SHARED
from tests.support.simulated_tower import tower

pytestmark = pytest.mark.long

HOTEL = SHARED / "sites" / "hotel.building.yaml"

SITE = (
    building("Lab", 8, 6, "Wall1: {type: Wall, at: [4, 0.8, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.6, Height: 2.5}}")
    + """
  Table1: {type: Table, at: [1, 4, 0], Shape: {Form: Box, Width: 0.6, Depth: 1, Height: 0.7}}
  Platform1: {type: Platform, at: [6.5, 4, 0], Shape: {Form: Box, Width: 0.8, Depth: 0.8, Height: 0.3}}
  Jar1: {type: Jar, at: [1.15, 4, 0.7]}
  Robot1: {type: PioneerP3DX, at: [2, 1.5, 0], Price: 10 EUR, Speed: 0.8}
  Robot2: {type: PioneerP3DX, at: [6, 1.5, 0], Price: 25 EUR, Speed: 1.0}
facts:
  - Jar1 isOn Table1
adapters:
  vda5050:
    broker: own
    vehicles:
      Robot1: {simulated: "2.1"}
      Robot2: {simulated: "3.0"}
"""
)


def two_storeys() -> str:
    """A building with a lift, whose robot is a vehicle. Nobody names its maps."""
    jar = Object(name="Jar1", type="Jar", values={"PositionX": 2.0, "PositionY": 5.0, "PositionZ": 0.74})
    map = tower((2.0, 2.0, 0.0), extra_objects=[jar], extra_facts=[Fact("isOn", ("Jar1", "Table1"))])
    return f"""{dump_map(map, upper())}
adapters:
  vda5050:
    broker: own
    vehicles: {{Robot1: {{simulated: "3.0"}}}}
"""


@contextlib.asynccontextmanager
async def system(folder: Path, text: str, *, speed: str = "1", world: WorldKind = WorldKind.PHYSICS) -> AsyncIterator[Client]:
    site, data = folder / "site.yaml", folder / "data"
    site.write_text(text)
    async with (
        asyncio.timeout(HANG_TIME),
        System([site], data, speed=speed, world=world, launcher=warm.launcher(), certificates=False),
        Client(Addresses.read(data)) as client,
    ):
        yield client


def operator(client: Client) -> OperatorLink:
    assert client.addresses.simulator is not None
    return OperatorLink.at(client.addresses.simulator)


async def stop(client: Client, robot: str, *, stopped: bool = True) -> None:
    """Stop a robot, as an operator does, or let it go on."""
    await client.update(UpdateMap(situation=f"{robot}.Paused = {str(stopped).upper()}"))


async def until_standing(link: OperatorLink, robot: str) -> None:
    pose = None
    while pose != (pose := (await link.robots())[robot].y):
        await asyncio.sleep(0.5)


def providers(view: TaskView) -> list[str]:
    return [work.service.partition(".")[0] for work in view.work]


def test_vehicles_accomplish_tasks_also_when_one_breaks_down(tmp_path: Path) -> None:
    async def run() -> None:
        async with system(tmp_path, SITE) as client, operator(client) as link:
            working = asyncio.create_task(accomplish(client, "Jar1 isOn Platform1"))
            while (await link.robots())["Robot1"].y < 2.0:
                await asyncio.sleep(0.05)
            await stop(client, "Robot1")
            await until_standing(link, "Robot1")
            await stop(client, "Robot1", stopped=False)
            while (await link.robots())["Robot1"].y < 2.6:
                await asyncio.sleep(0.05)
            await link.fault("Robot1", Fault.DRIVE)
            view = await working
            assert view.outcome is Outcome.ACCOMPLISHED
            assert providers(view) == ["Robot1", "Robot2"]
            await link.repair("Robot1", Fault.DRIVE)
            view = await accomplish(client, "Jar1 isOn Table1")
            assert view.outcome is Outcome.ACCOMPLISHED

    asyncio.run(run())


def test_a_vehicle_that_was_cut_off_on_its_way_works_again_afterwards(tmp_path: Path) -> None:
    async def run() -> None:
        async with system(tmp_path, SITE) as client, operator(client) as link:
            working = asyncio.create_task(accomplish(client, "Jar1 isOn Platform1"))
            while (await link.robots())["Robot1"].y < 2.0:
                await asyncio.sleep(0.05)
            await link.fault("Robot1", Fault.LINK)
            while not (await client.query("Robot1.Working = FALSE")).rows:
                await asyncio.sleep(0.5)
            assert not working.done()
            await link.repair("Robot1", Fault.LINK)
            assert (await working).outcome is Outcome.ACCOMPLISHED

    asyncio.run(run())


def test_a_vehicle_rides_a_lift_to_another_of_its_maps(tmp_path: Path) -> None:
    async def run() -> None:
        async with system(tmp_path, two_storeys(), speed="3", world=WorldKind.KINEMATIC) as client:
            view = await accomplish(client, "Jar1 isOn Table2")
            assert view.outcome is Outcome.ACCOMPLISHED
            assert providers(view) == ["Robot1"]

    asyncio.run(run())


@pytest.mark.skipif(not HOTEL.exists(), reason=f"NOT TESTED: there is no {HOTEL}")
@pytest.mark.slow
def test_vehicles_of_two_sizes_ride_the_lifts_of_a_hotel(tmp_path: Path) -> None:
    """Seen in Open-RMF's hotel: vehicles did not take part in its large traffic, and those that did lost the storey on which they were."""
    vehicles = {"tinyBot_1": {"simulated": "2.1"}, "deliveryBot_1": {"simulated": "3.0"}}
    hotel = import_building(HOTEL)
    text = f"{dump_site(hotel.ontology, hotel.map)}\nadapters: {json.dumps({'vda5050': {'broker': 'own', 'vehicles': vehicles}})}\n"

    async def run() -> None:
        async with system(tmp_path, text, speed="4", world=WorldKind.KINEMATIC) as client:
            views = await asyncio.gather(*(accomplish(client, f"{robot} isAt L2_room1") for robot in vehicles))
            assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 2
            for robot in vehicles:
                assert (await client.query(f"{robot}.PositionZ = 8")).rows

    asyncio.run(run())
