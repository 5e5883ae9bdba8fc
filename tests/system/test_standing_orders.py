"""Standing orders in a system of real processes: the windows are killed again and again, and each time is stated once."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import time
from pathlib import Path

import pytest

from somrs.cli.api_client import Windows
from somrs.client.client import Addresses, Client
from somrs.deployment.system import System, free_ports
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.frp import Outcome
from somrs.scheduling.recurrence import Every
from somrs.scheduling.standing_orders import OrderSaved, Run, Runs, RunState, StandingOrder
from tests.support.paths import SCENARIO_1

pytestmark = pytest.mark.long

pytest.importorskip("nicegui", reason="the windows' libraries are not installed")

PERIOD = 6.0
TIMES = 3


async def answered(windows: Windows, order: str) -> tuple[Run, ...]:
    """What came of its times, once the windows are there."""
    while True:
        with contextlib.suppress(RemoteError):
            return (await windows.get(Runs, "orders", order, "runs")).runs
        await asyncio.sleep(0.2)


def test_an_order_is_stated_once_each_time_though_the_windows_are_killed(tmp_path: Path) -> None:
    async def run() -> None:
        async with System([SCENARIO_1], tmp_path / "run", speed="max", windows=True) as system, Client(system.addresses) as client:
            keeping = asyncio.create_task(system.keep_running(lambda text: None))
            async with Windows(system.addresses) as windows:
                wish = Submit(effect="Jar002 isOn ?Shelf: Cupboard")  # as it is
                given = OrderSaved(name="Often", when=Every(minutes=PERIOD / 60), task=wish, by="Ada")
                order = await windows.post(StandingOrder, "orders", body=given)
                assert order.next is not None
                for number in range(TIMES):
                    # Just when the task is stated: before, and a moment after.
                    await asyncio.sleep(max(0.0, order.next + number * PERIOD - time.time() + (-0.05, 0.01, 0.2)[number]))
                    os.kill(system.programs["gui"].process.pid, signal.SIGKILL)
                    await asyncio.sleep(0.5)
                    await answered(windows, order.id)
                await asyncio.sleep(PERIOD)
                paused = await windows.post(StandingOrder, "orders", order.id, "pause")
                assert not paused.enabled
                runs = await answered(windows, order.id)
                while any(run.open for run in runs):
                    await asyncio.sleep(0.2)
                    runs = await answered(windows, order.id)
            keeping.cancel()
            stated = [run for run in runs if run.state is RunState.SUBMITTED]
            dues = [round((run.due - order.next) / PERIOD, 3) for run in runs]
            assert dues == [*map(float, reversed(range(len(runs))))], "each time is there once"
            assert stated, "the windows are there most of the time"
            assert {run.state for run in runs} <= {RunState.SUBMITTED, RunState.MISSED}, (
                "a time at which nobody was there is told as missed"
            )
            assert {run.outcome for run in stated} == {Outcome.ACCOMPLISHED}, [run.note for run in stated]
            known = {view.task for view in await client.tasks()}
            assert known == {run.task for run in stated}
            assert len(known) == len(stated)

    asyncio.run(run())


def test_without_windows_the_command_line_says_what_to_do() -> None:
    async def run() -> None:
        (port,) = free_ports("127.0.0.1", 1)
        nobody = Addresses(repository="", registry="", task_manager="", gui=f"http://127.0.0.1:{port}")
        async with Windows(nobody) as windows:
            with pytest.raises(RemoteError, match=r"do not answer.*`somrs up` starts them"):
                await windows.get(Runs, "orders", "x", "runs")
        with pytest.raises(UsageError, match="this system has no windows"):
            Windows(Addresses(repository="", registry="", task_manager=""))

    asyncio.run(run())
