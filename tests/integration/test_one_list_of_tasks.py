"""Several Task Managers, as clients of the API and the command line see them: one list of tasks, each of which is found wherever it is."""

from __future__ import annotations

import asyncio
import csv
import io
from collections import Counter
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from somrs.api.remote import LiveApi
from somrs.api.tasks import TasksChanged
from somrs.cli import task_commands
from somrs.client.client import Client
from somrs.client.refusals import NotFound
from somrs.errors import FormulaError, RemoteError, UsageError
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.previews import Preview
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import Phase
from tests.support.hang import HANG_TIME
from tests.support.small_system import Porter, SmallSystem, running

FIRST, SECOND = "Jar002 isOn Platform001", "Jar001 isOn Platform001"

Scenario = Callable[[SmallSystem, LiveApi], Awaitable[None]]


def run_scenario(data: Path, scenario: Scenario, seconds: float = 0.2) -> None:
    async def run() -> None:
        porters = [Porter("Robot1", seconds=seconds), Porter("Robot2", price=20, seconds=seconds)]
        async with asyncio.timeout(HANG_TIME), running(data, *porters, managers=2) as (system, api):
            system.addresses.write(data)
            await scenario(system, api)

    asyncio.run(run())


async def submit_two(api: LiveApi) -> list[str]:
    """Two tasks, stated at none in particular."""
    return [(await api.tasks.submit(Submit(effect=effect))).task for effect in (FIRST, SECOND)]


async def wait_for_end(api: LiveApi, *tasks: str) -> list[Outcome | None]:
    """How the tasks end."""
    outcomes: list[Outcome | None] = []
    for task in tasks:
        while (view := (await api.tasks.read(task)).view).phase is not Phase.ENDED:
            await asyncio.sleep(0.05)
        outcomes.append(view.outcome)
    return outcomes


def owners(system: SmallSystem) -> dict[str, int]:
    """The numbers of the Task Managers that have the tasks."""
    return {task: number for number in (1, 2) for task in tasks_at(system, number)}


def tasks_at(system: SmallSystem, number: int) -> list[str]:
    return [*system.manager_at(number).state.tasks]


def test_tasks_stated_at_none_in_particular_are_spread_and_in_one_list(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        tasks = await submit_two(api)
        assert Counter(owners(system).values()) == {1: 1, 2: 1}
        assert await wait_for_end(api, *tasks) == [Outcome.ACCOMPLISHED] * 2
        listed = await api.tasks.list()
        assert [(row.task, row.task_manager) for row in listed.rows] == [
            (task, f"TaskManager{owners(system)[task]}") for task in reversed(tasks)
        ]
        assert (listed.total, listed.silent) == (2, ())
        pages = [await api.tasks.list(limit=1), await api.tasks.list(limit=1, behind=tasks[1])]
        assert [[row.task for row in page.rows] for page in pages] == [[tasks[1]], [tasks[0]]]
        assert [(page.more, page.total) for page in pages] == [(True, 2), (False, 2)]

    run_scenario(tmp_path, scenario)


def test_records_of_all_task_managers_are_one_list(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        tasks = await submit_two(api)
        await wait_for_end(api, *tasks)
        page = await api.records.find()
        assert {record.task: record.task_manager for record in page.records} == {
            task: f"TaskManager{number}" for task, number in owners(system).items()
        }
        assert page.total == 2
        latest, earlier = page.records
        assert [record.task for record in (await api.records.find(limit=1, behind=latest.task)).records] == [earlier.task]
        for task in tasks:
            assert (await api.records.read(short_id(task))).task == task
        table = csv.DictReader(io.StringIO((await api.records.export()).content.decode()))
        assert [row["task"] for row in table] == [latest.task, earlier.task]

    run_scenario(tmp_path, scenario)


def test_a_task_is_cancelled_paused_and_read_wherever_it_is(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        tasks = await submit_two(api)
        for task in tasks:
            while (await api.tasks.read(short_id(task))).view.phase is not Phase.EXECUTING:
                await asyncio.sleep(0.05)
            assert (await api.tasks.pause(short_id(task), "Ada")).paused
            assert not (await api.tasks.resume(task, "Ada")).paused
            assert (await api.tasks.messages(task)).messages
            assert b"<svg" in (await api.tasks.chart(task)).content
            await api.tasks.cancel(short_id(task), "no longer needed")
        assert await wait_for_end(api, *tasks) == [Outcome.CANCELLED] * 2
        assert (await api.tasks.preview(Preview(effect=FIRST))).steps
        with pytest.raises(NotFound, match="there is no task"):
            await api.tasks.read("00000000")

    run_scenario(tmp_path, scenario, seconds=30.0)


def test_live_news_are_of_all_task_managers_over_a_restart_of_one(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        states: dict[str, Outcome | None] = {}
        with api.context.hub.subscribe("tasks") as subscription:
            await subscription.wait_until_followed()
            tasks = await submit_two(api)
            await system.stop_manager(2)
            await system.start_manager(2)
            while states != dict.fromkeys(tasks, Outcome.ACCOMPLISHED):
                news = await subscription.next_news()
                assert isinstance(news.value, TasksChanged)
                states = ({} if news.value.anew else states) | {row.task: row.outcome for row in news.value.rows}

    run_scenario(tmp_path, scenario, seconds=1.0)


def test_when_one_does_not_answer_the_tasks_of_the_others_are_listed_and_it_is_said_which(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        tasks = await submit_two(api)
        await wait_for_end(api, *tasks)
        numbers = owners(system)
        silent, answering = tasks if numbers[tasks[0]] == 1 else tasks[::-1]
        await system.stop_manager(1)
        listed = await api.tasks.list()
        assert [row.task for row in listed.rows] == [answering]
        assert listed.silent == ("TaskManager1",)
        page = await api.records.find()
        assert ([record.task for record in page.records], page.silent) == ([answering], ("TaskManager1",))
        assert (await api.tasks.read(answering)).view.outcome is Outcome.ACCOMPLISHED
        with pytest.raises(RemoteError, match="cannot be reached"):
            await api.tasks.read(silent)
        with pytest.raises(NotFound, match="TaskManager1 does not answer"):
            await api.tasks.read(short_id(silent))
        parts = {part.name: part.milliseconds is not None for part in (await api.system.read()).parts}
        assert (parts["TaskManager1"], parts["TaskManager2"]) == (False, True)
        await task_commands.tasks(tmp_path, history=True, limit=5, json=False)
        printed = capsys.readouterr()
        assert "TaskManager1 does not answer" in printed.err
        assert "TaskManager2" in printed.out
        third = (await api.tasks.submit(Submit(effect="Tin001 isOn Platform001"))).task
        assert await wait_for_end(api, third) == [Outcome.ACCOMPLISHED]
        await system.start_manager(1)
        assert [row.task for row in (await api.tasks.list()).rows] == [third, *reversed(tasks)]

    run_scenario(tmp_path, scenario)


def test_submissions_with_one_key_are_one_task_though_the_one_that_took_it_is_gone_for_a_while(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=FIRST), once="key")).task
        ((_, number),) = owners(system).items()
        await system.stop_manager(number)
        assert (await api.tasks.submit(Submit(effect=FIRST), once="key")).task == task
        assert not system.manager_at(3 - number).state.tasks
        await system.start_manager(number)
        assert (await api.tasks.submit(Submit(effect=FIRST), once="key")).task == task
        assert await wait_for_end(api, task) == [Outcome.ACCOMPLISHED]
        assert (await api.tasks.list()).total == 1

    run_scenario(tmp_path, scenario)


def test_a_task_goes_to_the_task_manager_that_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        tasks = [(await api.tasks.submit(Submit(effect=effect), task_manager="TaskManager2")).task for effect in (FIRST, SECOND)]
        assert owners(system) == dict.fromkeys(tasks, 2)
        with pytest.raises(UsageError, match="there is no Task Manager Nobody here; there is TaskManager1, TaskManager2"):
            await api.tasks.submit(Submit(effect=FIRST), task_manager="Nobody")
        assert await wait_for_end(api, *tasks) == [Outcome.ACCOMPLISHED] * 2
        third = Submit(effect="Tin001 isOn Platform001")
        assert await task_commands.run_task(third, tmp_path, wait=True, json=False, task_manager="TaskManager1") == 0
        assert [*owners(system).values()].count(1) == 1

    run_scenario(tmp_path, scenario)


def test_many_submissions_at_once_with_one_key_are_one_task(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        submitted = await asyncio.gather(*(api.tasks.submit(Submit(effect=FIRST), once="key") for _ in range(8)))
        assert len({answer.task for answer in submitted}) == 1
        assert len(owners(system)) == 1
        await wait_for_end(api, submitted[0].task)

    run_scenario(tmp_path, scenario)


def test_a_task_with_a_mistake_is_refused_by_any(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        with pytest.raises(FormulaError, match="NoSuchJar"):
            await api.tasks.submit(Submit(effect="NoSuchJar isOn Platform001"))
        assert not owners(system)

    run_scenario(tmp_path, scenario)


def test_the_command_line_lists_shows_and_cancels_tasks_of_all_also_when_the_system_is_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        async with Client(system.addresses) as client:
            tasks = [await client.submit(Submit(effect=effect)) for effect in (FIRST, SECOND)]
        await task_commands.tasks(tmp_path, history=False, limit=5, json=False)
        printed = capsys.readouterr().out
        for text in ("TaskManager1", "TaskManager2", *map(short_id, tasks)):
            assert text in printed
        for task in tasks:
            await task_commands.cancel(short_id(task), "no longer needed", tmp_path)
        await wait_for_end(api, *tasks)
        capsys.readouterr()
        for task in tasks:
            await task_commands.task(short_id(task), tmp_path, messages=False, picture=None, json=False)
            assert f"TaskManager{owners(system)[task]}" in capsys.readouterr().out
            await task_commands.task(short_id(task), tmp_path, messages=True, picture=None, json=False)
            assert "Arrange" in capsys.readouterr().out

    run_scenario(tmp_path, scenario, seconds=30.0)
    (tmp_path / "system.json").unlink()
    asyncio.run(task_commands.tasks(tmp_path, history=True, limit=5, json=False))
    printed = capsys.readouterr().out
    assert printed.count("cancelled") == 2
    assert "TaskManager1" in printed
    assert "TaskManager2" in printed


def test_a_device_submits_tasks_to_any_and_asks_for_them_wherever_they_are(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        device = system.porters[0]
        tasks = [await device.tasks.submit(Submit(effect=effect)) for effect in (FIRST, SECOND)]
        assert Counter(owners(system).values()) == {1: 1, 2: 1}
        assert [await device.tasks.is_running(task) for task in tasks] == [True, True]
        await wait_for_end(api, *tasks)
        assert [await device.tasks.is_running(task) for task in tasks] == [False, False]
        assert not await device.tasks.is_running("urn:uuid:nobody-knows")
        assert (await api.tasks.read(tasks[0])).view.client == f"urn:so-mrs:client:{device.name}"
        await system.stop_manager(1)
        await device.tasks.submit(Submit(effect="Tin001 isOn Platform001"))
        assert len(tasks_at(system, 2)) == 2

    run_scenario(tmp_path, scenario, seconds=1.0)
