"""A device gives tasks to the Task Manager, as any client does."""

from __future__ import annotations

import asyncio

import pytest

from somrs.errors import RemoteError
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.submission import Submit
from somrs.service_manager.sdk.device import Device
from somrs.service_manager.sdk.tasks import TaskSubmitter
from tests.support.virtual_system import Robot, VirtualSystem


def submitter(system: VirtualSystem) -> TaskSubmitter:
    async def ask(body: Body) -> Body:
        return system.ask(body)  # type: ignore[return-value]  # the answers of a Task Manager

    return TaskSubmitter(ask)


def test_a_task_of_a_device_runs_until_it_ends() -> None:
    system = VirtualSystem(Robot("Robot1", price=10, duration=60))
    tasks = submitter(system)
    task = asyncio.run(tasks.submit(Submit(effect="Jar002 isOn Platform001")))
    assert asyncio.run(tasks.is_running(task))
    system.finish(task)
    assert not asyncio.run(tasks.is_running(task))


def test_a_task_that_is_not_valid_is_rejected_and_one_that_nobody_knows_does_not_run() -> None:
    tasks = submitter(VirtualSystem(Robot("Robot1", price=10, duration=60)))
    with pytest.raises(RemoteError, match="Jar2"):
        asyncio.run(tasks.submit(Submit(effect="Jar2 isOn Platform001")))
    assert not asyncio.run(tasks.is_running("no such task"))


def test_a_device_that_no_program_runs_cannot_submit_tasks() -> None:
    with pytest.raises(RemoteError, match="no program runs the device"):
        asyncio.run(Device("Robot1").tasks.submit(Submit(effect="Robot1.Charge >= 90")))
