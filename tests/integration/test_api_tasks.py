"""Tasks through the public API: stated, watched while they run and afterwards, cancelled; over sockets, and from real files."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import get_args
from urllib.request import urlopen

import msgspec
import pytest

from somrs.api.remote import LiveApi
from somrs.api.tasks import TaskChanged, TasksChanged
from somrs.cli.task_commands import task as show_task
from somrs.client.hub import News
from somrs.client.refusals import NotFound
from somrs.errors import UsageError
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import ContractView, MessageView, Phase
from somrs.task_manager import state
from tests.support.hang import HANG_TIME
from tests.support.small_system import Porter, SmallSystem, running

GOAL = "Jar002 isOn Platform001"

Scenario = Callable[[SmallSystem, LiveApi], Awaitable[None]]


def run_scenario(data: Path, scenario: Scenario, *porters: Porter) -> None:
    async def run() -> None:
        async with asyncio.timeout(HANG_TIME), running(data, *porters) as (system, api):
            await scenario(system, api)

    asyncio.run(run())


async def wait_for_end(api: LiveApi, task: str) -> None:
    while (await api.tasks.read(task)).view.phase is not Phase.ENDED:
        await asyncio.sleep(0.05)


async def all_messages(api: LiveApi, task: str) -> list[MessageView]:
    message_views: list[MessageView] = []
    is_incomplete = True
    while is_incomplete:
        page = await api.tasks.messages(task, len(message_views))
        message_views += page.messages
        is_incomplete = page.more
    return message_views


def test_a_task_is_seen_whole_while_it_runs_and_when_it_is_over(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=GOAL, priority=3), by="Ada")).task
        while (task_details := await api.tasks.read(task)).view.phase is not Phase.EXECUTING:
            await asyncio.sleep(0.02)
        assert task_details.view.client == "urn:so-mrs:client:Ada"
        assert task_details.view.priority == 3
        assert {(bid.service, bid.price, bid.accepted) for bid in task_details.contracts} == {
            ("Robot1.TransferObject", 10, True),
            ("Robot2.TransferObject", 20, False),
        }
        early = await all_messages(api, task)
        assert task_details.messages is not None
        assert len(early) >= task_details.messages >= 7
        await wait_for_end(api, task)
        final_details = await api.tasks.read(task)
        assert [event.number for event in final_details.events] == [*range(1, len(final_details.events) + 1)]
        assert final_details.events[: len(task_details.events)] == task_details.events
        assert {(bid.service, bid.state, bid.reason) for bid in final_details.contracts} == {
            ("Robot1.TransferObject", State.COMPLETED, ""),
            ("Robot2.TransferObject", State.ENDED, "another service was chosen by price"),
        }
        late = await all_messages(api, task)
        assert late[: len(early)] == early
        assert late[-1].type == "End"
        assert final_details.messages == len(late)

    run_scenario(tmp_path, scenario, Porter("Robot1", price=10), Porter("Robot2", price=20))


async def collect_news(api: LiveApi, task: str, news_list: list[News]) -> None:
    with api.context.hub.subscribe(f"task {task}") as listening:
        await listening.wait_until_followed()
        async for news in listening:
            news_list.append(news)
            if isinstance(news.value, TaskChanged) and news.value.view.phase is Phase.ENDED:
                return


def test_news_of_a_task_add_up_to_it_for_two_listeners_over_a_restart_of_the_task_manager(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        news_lists: list[list[News]] = [[], []]
        following = [asyncio.create_task(collect_news(api, task, news_list)) for news_list in news_lists]
        await asyncio.sleep(0.5)
        await system.stop_manager()
        await asyncio.sleep(0.3)
        await system.start_manager()
        await asyncio.gather(*following)
        whole = await api.tasks.read(task)
        for news_list in news_lists:
            changes = [news.value for news in news_list if isinstance(news.value, TaskChanged)]
            assert len(changes) == len(news_list), "nothing was missed"
            assert [event.number for change in changes for event in change.events] == [event.number for event in whole.events]
            contracts: dict[str, ContractView] = {}
            for change in changes:
                contracts |= {contract.participant: contract for contract in change.contracts}
            assert {*contracts.values()} == {*whole.contracts}
            assert changes[-1].messages == whole.messages
        assert whole.view.outcome is Outcome.ACCOMPLISHED

    run_scenario(tmp_path, scenario, Porter("Robot1", seconds=1.5, steps=15), Porter("Robot2", price=20))


def test_the_list_tells_of_tasks_that_come_and_change(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task_states: dict[str, str] = {}

        async def follow(condition: Callable[[], bool]) -> None:
            with api.context.hub.subscribe("tasks") as listening:
                await listening.wait_until_followed()
                async for news in listening:
                    assert isinstance(news.value, TasksChanged)
                    if news.value.anew:
                        task_states.clear()
                    task_states.update({row.task: str(row.outcome or row.phase) for row in news.value.rows})
                    if condition():
                        return

        first = (await api.tasks.submit(Submit(effect=GOAL))).task
        following = asyncio.create_task(follow(lambda: len(task_states) == 2 and {*task_states.values()} == {"accomplished"}))
        await asyncio.sleep(0.1)
        second = (await api.tasks.submit(Submit(effect="Tin001 isOn Cupboard002"))).task
        await asyncio.wait_for(following, HANG_TIME)
        assert task_states == {first: "accomplished", second: "accomplished"}
        assert [row.task for row in (await api.tasks.list()).rows] == [second, first]
        assert (await api.tasks.list(running=True)).rows == ()
        first_page = await api.tasks.list(limit=1)
        assert [row.task for row in first_page.rows] == [second]
        assert (first_page.more, first_page.total) == (True, 2)
        last_page = await api.tasks.list(limit=1, behind=second)
        assert [row.task for row in last_page.rows] == [first]
        assert (last_page.more, last_page.total) == (False, 2)
        with pytest.raises(UsageError, match="hold no task task-1"):
            await api.tasks.list(behind="task-1")
        with pytest.raises(UsageError, match="at least 1"):
            await api.tasks.list(limit=0)

    run_scenario(tmp_path, scenario, Porter("Robot1"))


def test_whoever_stops_listening_leaves_nobody_asking(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        await wait_for_end(api, task)
        tasks_before = asyncio.all_tasks()
        with api.context.hub.subscribe("tasks", f"task {task}") as listening:
            await listening.wait_until_followed()
            await asyncio.wait_for(listening.next_news(), HANG_TIME)
        quiet_count = 0
        while quiet_count < 5:  # whoever asks has always a request under way
            await asyncio.sleep(0.05)
            quiet_count = quiet_count + 1 if asyncio.all_tasks() <= tasks_before else 0

    run_scenario(tmp_path, scenario, Porter("Robot1"))


def test_a_task_sent_twice_with_the_same_word_is_one(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        first = await api.tasks.submit(Submit(effect=GOAL), once="my word")
        assert await api.tasks.submit(Submit(effect=GOAL), once="my word") == first
        assert await api.tasks.submit(Submit(effect=GOAL), once="another") != first

    run_scenario(tmp_path, scenario, Porter("Robot1"))


def test_a_task_is_found_by_the_beginning_of_its_id_even_if_it_was_long_ago(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state, "REMEMBERED", 1)

    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        old = (await api.tasks.submit(Submit(effect=GOAL))).task
        await wait_for_end(api, old)
        new = (await api.tasks.submit(Submit(effect="Tin001 isOn Cupboard002"))).task
        await wait_for_end(api, new)
        assert old not in system.manager.state.tasks
        task_details = await api.tasks.read(old.rpartition(":")[2][:12])
        assert (task_details.view.task, task_details.view.outcome, len(task_details.contracts)) == (old, Outcome.ACCOMPLISHED, 1)
        assert task_details.events[-1].text == "accomplished"
        assert [message.type for message in await all_messages(api, old)][:2] == ["Arrange", "Terms"]
        assert [row.task for row in (await api.tasks.list()).rows] == [new]
        for name in ("ffffffffffff", f"{old[:-1]}x", "nonsense"):
            with pytest.raises(NotFound, match="there is no task"):
                await api.tasks.read(name)
        with pytest.raises(UsageError, match="begin with urn:uuid:"):
            await api.tasks.read("urn:uuid:")

    run_scenario(tmp_path, scenario, Porter("Robot1"))


def test_an_ended_task_is_submitted_once_more_and_names_the_old_one(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        (robot,) = system.porters
        robot.refuses = "it is too heavy"
        task = (await api.tasks.submit(Submit(effect=GOAL, priority=2, deadline=600.0, waits=False))).task
        await wait_for_end(api, task)
        robot.refuses = ""
        retries = [(await api.tasks.retry(task, once="one click")).task for _ in range(2)]
        assert retries[0] == retries[1] != task
        await wait_for_end(api, retries[0])
        view = (await api.tasks.read(retries[0])).view
        assert (view.outcome, view.retry_of) == (Outcome.ACCOMPLISHED, task)
        assert (view.effect, view.priority, view.deadline, view.waits) == (GOAL, 2, 600.0, False)
        record = await api.records.read(retries[0])
        assert record.retry_of == task

    run_scenario(tmp_path, scenario, Porter("Robot1"))


def test_a_task_that_runs_cannot_be_retried(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        with pytest.raises(UsageError, match="has not ended yet"):
            await api.tasks.retry(task)
        await api.tasks.cancel(task)

    run_scenario(tmp_path, scenario, Porter("Robot1", seconds=5))


def test_a_task_is_cancelled_for_a_reason_that_is_told(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        while (await api.tasks.read(task)).view.phase is not Phase.EXECUTING:
            await asyncio.sleep(0.02)
        await api.tasks.cancel(task, "it rains")
        await wait_for_end(api, task)
        task_details = await api.tasks.read(task)
        assert task_details.view.outcome is Outcome.CANCELLED
        assert task_details.view.explanation.startswith("it rains")
        assert "stopping: it rains" in [event.text for event in task_details.events]

    run_scenario(tmp_path, scenario, Porter("Robot1", seconds=5))


def test_a_thousand_messages_are_followed_without_reading_them_again(tmp_path: Path) -> None:
    """The page asks for what it has not: the answers together are as long as the whole, once."""

    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        message_views: list[MessageView] = []
        pages = 0
        news_list: list[News] = []
        following = asyncio.create_task(collect_news(api, task, news_list))
        while not following.done():
            page = await api.tasks.messages(task, len(message_views))
            pages += 1
            message_views += page.messages
            await asyncio.sleep(0.05)
        message_views += (await api.tasks.messages(task, len(message_views))).messages
        assert len(message_views) > 1000
        assert len({(message.id, message.at) for message in message_views}) == len(message_views)
        assert len(news_list) < 100, "what happens in a fifth of a second is told together"

    run_scenario(tmp_path, scenario, Porter("Robot1", seconds=3, steps=1000))


def test_the_command_line_shows_bids_and_messages_of_a_task_that_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        system.addresses.write(tmp_path)
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        while (await api.tasks.read(task)).view.phase is not Phase.EXECUTING:
            await asyncio.sleep(0.02)
        await show_task(task, tmp_path, messages=False, picture=None, json=False)
        output = capsys.readouterr().out
        assert "✔ 10 EUR" in output
        assert "another service was" in output
        await show_task(task, tmp_path, messages=True, picture=None, json=False)
        assert "Execute" in capsys.readouterr().out

    run_scenario(tmp_path, scenario, Porter("Robot1", price=10, seconds=5), Porter("Robot2", price=20))


def test_an_event_comes_as_a_struct_for_programs_and_as_a_sentence_for_people(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        await wait_for_end(api, task)
        events = msgspec.to_builtins(await api.tasks.read(task))["events"]
        completion = next(event for event in events if event["event"]["type"] == "StepCompleted")
        assert completion["event"] == {"type": "StepCompleted", "service": "Robot1.TransferObject", "situation": GOAL}
        assert completion["text"] == f"Robot1.TransferObject completed: {GOAL}"
        assert events[-1]["event"] == {"type": "TaskEnded", "outcome": "accomplished"}

    run_scenario(tmp_path, scenario, Porter("Robot1"))


def test_the_description_of_the_api_has_every_kind_of_event(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi) -> None:
        described_at = f"{api.client.url}/openapi.json"
        schemas = json.loads(await asyncio.to_thread(lambda: urlopen(described_at).read()))["components"]["schemas"]
        described, _ = schemas["TaskEvent"]["properties"]["event"]["anyOf"]  # or null, in records of SO-MRS 0.1
        names = {kind.__name__ for kind in get_args(Event)}
        assert {schema["$ref"].rpartition("/")[2] for schema in described["anyOf"]} == names
        assert set(described["discriminator"]["mapping"]) == names
        assert schemas["StepFailed"]["properties"]["type"] == {"enum": ["StepFailed"]}

    run_scenario(tmp_path, scenario, Porter("Robot1"))
