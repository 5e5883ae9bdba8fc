"""Whole systems of real processes that are killed while tasks are under way: the tasks go on, and end as tasks end."""

from __future__ import annotations

import asyncio
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from somrs.client.client import Client
from somrs.client.trace import Follower
from somrs.deployment.supervision import keep_running
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from tests.support import warm
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1

pytestmark = pytest.mark.long

REQUEST = Submit(effect="Jar002 isOn Platform001")


async def wait_for_message(follower: Follower, kind: str) -> None:
    """Return when a message of that kind passed, of those that were not looked at before."""
    while kind not in [line.type for line in follower.new()]:
        await asyncio.sleep(0.02)


async def ended(client: Client, task: str) -> TaskView:
    """The task when it is over, whatever happens to the Task Manager meanwhile."""
    views = [news.view async for news in client.news(task)]
    return views[-1]


def test_tasks_outlive_their_task_manager(tmp_path: Path) -> None:
    """It is killed three times, each time at another message of a task."""
    places = {"Arrange": "Jar002 isOn Platform001", "Accept": "Jar003 isOn Platform001", "Execute": "Jar002 isOn Table001"}

    async def run() -> None:
        async with (
            System([SCENARIO_1], tmp_path, speed="8", world=WorldKind.KINEMATIC, launcher=warm.launcher()) as system,
            Client(system.addresses) as client,
        ):
            notices: list[str] = []
            supervisor = asyncio.create_task(keep_running(system, notices.append))
            manager = system.programs["task-manager"]
            address_before = manager.address
            follower = Follower(tmp_path / "messages.jsonl")
            for number, (kind, effect) in enumerate(places.items(), start=1):
                [*follower.new()]
                task = await client.submit(Submit(effect=effect))
                async with asyncio.timeout(HANG_TIME):
                    await wait_for_message(follower, kind)
                    manager.process.kill()
                    view = await ended(client, task)
                assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
                assert notices.count("task-manager is back") == number
                assert manager.address == address_before
                assert (await client.query(effect)).rows
            second_task = await client.submit(Submit(effect="Jar003 isOn Table001"))
            assert (await asyncio.wait_for(ended(client, second_task), HANG_TIME)).outcome is Outcome.ACCOMPLISHED
            supervisor.cancel()

    asyncio.run(run())


def test_a_task_outlives_the_whole_system(tmp_path: Path) -> None:
    """All processes are killed at once, as by a power cut, and started again with the same data: first while somebody else has the
    address of one of them."""

    async def run() -> None:
        system = System([SCENARIO_1], tmp_path, speed="8", world=WorldKind.KINEMATIC, launcher=warm.launcher())
        try:
            await system.start()
            addresses = system.addresses
            async with Client(addresses) as client:
                task = await client.submit(REQUEST)
                async with asyncio.timeout(HANG_TIME):
                    await wait_for_message(Follower(tmp_path / "messages.jsonl"), "Execute")
        finally:
            for program in system.programs.values():
                program.process.kill()
            await asyncio.gather(*(program.process.wait() for program in system.programs.values()))
            await system.stop()
        system.addresses.write(tmp_path)  # a power cut leaves it behind
        place = urlsplit(addresses.task_manager)
        async with await asyncio.start_server(lambda reader, writer: None, place.hostname, place.port):
            with pytest.raises(UsageError, match="1 task is open") as raised:
                async with System([SCENARIO_1], tmp_path, speed="8", world=WorldKind.KINEMATIC, launcher=warm.launcher()):
                    pass
            assert f"belongs to {addresses.task_manager}" in str(raised.value)
        async with (
            System([SCENARIO_1], tmp_path, speed="8", world=WorldKind.KINEMATIC, launcher=warm.launcher()) as system,
            Client(system.addresses) as client,
        ):
            assert system.addresses.task_manager == addresses.task_manager
            view = await asyncio.wait_for(ended(client, task), HANG_TIME)
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert (await client.query("Jar002 isOn Platform001")).rows

    asyncio.run(run())
