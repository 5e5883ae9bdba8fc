"""A whole system of real processes on a bus of its own."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.api.remote import live_api
from somrs.client.addresses import Addresses
from somrs.client.api_client import local_token_reader
from somrs.client.client import Client
from somrs.client.credentials import credentials_in
from somrs.deployment.bus import find_site
from somrs.deployment.supervision import keep_running
from somrs.deployment.system import OWN_BUS, System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.records import ReadRecords
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from tests.support import warm
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1

pytestmark = pytest.mark.long


async def ended(client: Client, task: str) -> TaskView:
    return [news.view async for news in client.news(task)][-1]


def test_a_system_on_a_bus_goes_on_when_the_server_of_the_bus_or_the_gateway_is_killed(tmp_path: Path) -> None:
    async def run() -> None:
        system = System([SCENARIO_1], tmp_path, speed="4", world=WorldKind.KINEMATIC, launcher=warm.launcher(), bus=OWN_BUS, name="lab")
        async with system, Client(system.addresses) as client:
            bus = system.addresses.bus
            assert bus is not None
            assert {address.rpartition("/")[0] for address in (system.addresses.repository, system.addresses.task_manager)} == {bus.gateway}
            assert await find_site(bus.servers, credentials=credentials_in(tmp_path, bus.servers)) == system.addresses
            notices: list[str] = []
            supervisor = asyncio.create_task(keep_running(system, notices.append))
            for number, (program, effect) in enumerate((("bus", "Jar002 isOn Platform001"), ("gateway", "Jar002 isOn Table001")), start=1):
                task = await client.submit(Submit(effect=effect))
                while not any(step.state == "Executing" for view in await client.tasks(running=True) for step in view.steps):
                    await asyncio.sleep(0.05)
                system.programs[program].process.kill()
                view = await ended(client, task)
                assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
                assert (await client.query(effect)).rows
                while f"{program} is back" not in notices:
                    await asyncio.sleep(0.05)
                assert len([notice for notice in notices if notice.endswith("is back")]) == number, "no other program has ended"
            supervisor.cancel()
            # The API, and so the windows, need no gateway.
            system.programs["gateway"].process.kill()
            assert system.addresses.api is not None
            async with live_api(system.addresses.api, local_token_reader(system.data)) as api:
                assert [task.effect for task in (await api.tasks.list()).rows] == ["Jar002 isOn Table001", "Jar002 isOn Platform001"]

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


@pytest.mark.slow
def test_a_system_that_changes_to_a_bus_and_back_works_and_does_no_task_again(tmp_path: Path) -> None:
    earlier: dict[str, float] = {}

    async def addresses(bus: str | None, place: str) -> Addresses:
        system = System([SCENARIO_1], tmp_path, speed="max", world=WorldKind.KINEMATIC, launcher=warm.launcher(), bus=bus, name="lab")
        async with system, Client(system.addresses) as client:
            view = await ended(client, await client.submit(Submit(effect=f"Jar002 isOn {place}")))
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            submissions = {record.task: record.submitted_at for record in (await client.records(ReadRecords(brief=True))).records}
            assert {task: submissions.get(task) for task in earlier} == earlier
            earlier.update(submissions)
        return system.addresses

    async def run() -> None:
        on_bus = await addresses(OWN_BUS, "Platform001")
        assert await addresses(OWN_BUS, "Table001") == on_bus
        await addresses(None, "Platform001")
        await addresses(OWN_BUS, "Table001")

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))
