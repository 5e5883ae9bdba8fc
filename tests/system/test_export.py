"""A whole system of real processes: what is said of tasks at the command line, and what is kept of them over kills and restarts."""

from __future__ import annotations

import asyncio
from pathlib import Path

import msgspec
import pytest

from somrs.cli.task_commands import run_task, tasks
from somrs.client.export import Format, Table, export
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.submission import Submit
from tests.support import warm
from tests.support.paths import SCENARIO_1

pytestmark = pytest.mark.long


async def exported(data: Path, target: Path) -> list[TaskRecord]:
    await export(target, data, Format.JSONL, Table.TASKS)
    return [msgspec.json.decode(line, type=TaskRecord) for line in target.read_bytes().splitlines()]


def test_what_is_over_is_exported_while_the_system_runs_when_it_is_killed_and_when_it_is_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, target = tmp_path / "run", tmp_path / "tasks.jsonl"

    async def run() -> None:
        async with System([SCENARIO_1], data, speed="max", world=WorldKind.KINEMATIC, launcher=warm.launcher()) as system:
            assert await run_task(Submit(effect="Jar002 isOn Platform001"), data, wait=True, json=False) == 0
            output = capsys.readouterr().out
            assert output.count("✔ accomplished") == 1
            assert output.count("\n") == len(output.splitlines()), "the last line is a whole one"
            assert await run_task(Submit(effect="Jar003 isOn Platform001", deadline=0.001), data, wait=True, json=False) == 1
            assert capsys.readouterr().out.count("the deadline of 0.001 s is over") == 1
            running = await exported(data, target)
            assert [record.outcome for record in running] == [Outcome.FAILED, Outcome.ACCOMPLISHED]
            assert {message.type for message in running[1].messages} >= {"Arrange", "Terms", "Accept", "Execute", "Completed", "End"}
            system.programs["task-manager"].process.kill()
            await system.programs["task-manager"].process.wait()
            assert await exported(data, target) == running, "its addresses are still there, and nobody listens at them"
        assert await exported(data, target) == running
        async with System([SCENARIO_1], data, speed="max", world=WorldKind.KINEMATIC, launcher=warm.launcher()):
            assert await exported(data, target) == running
            capsys.readouterr()
            await tasks(data, history=False, limit=20, json=False)
            assert "no task is running" in capsys.readouterr().out
            await tasks(data, history=True, limit=20, json=False)
            assert running[1].task.rpartition(":")[2][:8] in capsys.readouterr().out

    asyncio.run(run())
