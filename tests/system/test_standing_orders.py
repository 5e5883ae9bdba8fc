"""Standing orders in a system of real processes: the Scheduler is killed again and again, and each time is stated once."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import time
from pathlib import Path

import pytest

from somrs.api.remote import Api, api_of
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment.supervision import keep_running
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import RemoteError, UsageError
from somrs.ports import Reservation
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.orders import Every, OrderSaved, Run, RunState
from somrs.protocol.messages.submission import Submit
from tests.support import warm
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1

pytestmark = pytest.mark.long

PERIOD = 6.0
TIMES = 3


async def answered(api: Api, order: str) -> tuple[Run, ...]:
    """What came of its times, once the Scheduler is there."""
    while True:
        with contextlib.suppress(RemoteError):
            return (await api.orders.runs(order)).runs
        await asyncio.sleep(0.2)


def test_an_order_is_stated_once_each_time_though_the_scheduler_is_killed(tmp_path: Path) -> None:
    async def run() -> None:
        async with (
            System([SCENARIO_1], tmp_path / "run", speed="max", world=WorldKind.KINEMATIC, launcher=warm.launcher()) as system,
            Client(system.addresses) as client,
        ):
            supervisor = asyncio.create_task(keep_running(system, lambda text: None))
            async with api_of(system.data) as api:
                request = Submit(effect="Jar002 isOn ?Shelf: Cupboard")  # as it is
                saved_order = OrderSaved(name="Often", when=Every(minutes=PERIOD / 60), task=request, by="Ada", skip=False)
                order = await api.orders.add_order(saved_order)
                assert order.next is not None
                for number in range(TIMES):
                    # Just when the task is stated: before, and a moment after.
                    await asyncio.sleep(max(0.0, order.next + number * PERIOD - time.time() + (-0.05, 0.01, 0.2)[number]))
                    os.kill(system.programs["scheduler"].process.pid, signal.SIGKILL)
                    await asyncio.sleep(0.5)
                    await answered(api, order.id)
                await asyncio.sleep(PERIOD)
                paused = await api.orders.pause_order(order.id)
                assert not paused.enabled
                runs = await answered(api, order.id)
                while any(run.open for run in runs):
                    await asyncio.sleep(0.2)
                    runs = await answered(api, order.id)
            supervisor.cancel()
            stated = [run for run in runs if run.state is RunState.SUBMITTED]
            dues = [round((run.due - order.next) / PERIOD, 3) for run in runs]
            assert dues == [*map(float, reversed(range(len(runs))))], "each time is there once"
            assert stated, "the Scheduler is there most of the time"
            assert {run.state for run in runs} <= {RunState.SUBMITTED, RunState.MISSED}, (
                "a time at which nobody was there is told as missed"
            )
            assert {run.outcome for run in stated} == {Outcome.ACCOMPLISHED}, [run.note for run in stated]
            known_tasks = {view.task for view in await client.tasks()}
            assert known_tasks == {run.task for run in stated}
            assert len(known_tasks) == len(stated)

    asyncio.run(run())


def test_orders_are_stated_while_neither_the_api_nor_the_windows_run(tmp_path: Path) -> None:
    async def run() -> None:
        async with (
            System([SCENARIO_1], tmp_path / "run", speed="max", world=WorldKind.KINEMATIC, launcher=warm.launcher()) as system,
            Client(system.addresses) as client,
        ):
            async with api_of(system.data) as api:
                request = Submit(effect="Jar002 isOn ?Shelf: Cupboard")
                order = await api.orders.add_order(OrderSaved(name="Often", when=Every(minutes=PERIOD / 60), task=request))
            os.kill(system.programs["api"].process.pid, signal.SIGKILL)
            await system.programs["api"].process.wait()
            async with asyncio.timeout(HANG_TIME):
                while len(await client.tasks()) < 2:
                    await asyncio.sleep(0.2)
            await system.restart("api")
            async with api_of(system.data) as api:
                known_tasks = {run.task for run in (await api.orders.runs(order.id)).runs if run.state is RunState.SUBMITTED}
            assert {view.task for view in await client.tasks()} <= known_tasks | {None}

    asyncio.run(run())


def test_without_the_api_the_command_line_says_what_to_do(tmp_path: Path) -> None:
    async def run() -> None:
        with Reservation("127.0.0.1", 1) as free:
            dead_addresses = Addresses(repository="", registry="", task_manager="", api=f"http://127.0.0.1:{free.ports[0]}/api")
            dead_addresses.write(tmp_path)
            async with api_of(tmp_path) as api:
                with pytest.raises(RemoteError, match=r"does not answer.*`somrs up` starts it"):
                    await api.orders.runs("x")
        Addresses(repository="", registry="", task_manager="").write(tmp_path)
        with pytest.raises(UsageError, match="without the API"):
            async with api_of(tmp_path):
                pass

    asyncio.run(run())
