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
from somrs.cli.task_commands import task as shown
from somrs.client.hub import News
from somrs.client.refusals import NotFound
from somrs.errors import UsageError
from somrs.protocol.messages.clients import ContractView, MessageView, Phase, Submit
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import Outcome, State
from somrs.task_manager import manager
from tests.support.small_system import Porter, SmallSystem, running

WISH = "Jar002 isOn Platform001"

Scenario = Callable[[SmallSystem, LiveApi], Awaitable[None]]


def played(data: Path, scenario: Scenario, *porters: Porter) -> None:
    async def run() -> None:
        async with asyncio.timeout(120), running(data, *porters) as (system, desk):
            await scenario(system, desk)

    asyncio.run(run())


async def ended(desk: LiveApi, task: str) -> None:
    while (await desk.tasks.read(task)).view.phase is not Phase.ENDED:
        await asyncio.sleep(0.05)


async def all_messages(desk: LiveApi, task: str) -> list[MessageView]:
    found: list[MessageView] = []
    more = True
    while more:
        page = await desk.tasks.messages(task, len(found))
        found += page.messages
        more = page.more
    return found


def test_a_task_is_seen_whole_while_it_runs_and_when_it_is_over(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        task = (await desk.tasks.submit(Submit(effect=WISH, priority=3), by="Ada")).task
        while (seen := await desk.tasks.read(task)).view.phase is not Phase.EXECUTING:
            await asyncio.sleep(0.02)
        assert seen.view.client == "urn:so-mrs:client:Ada"
        assert seen.view.priority == 3
        assert {(bid.service, bid.price, bid.accepted) for bid in seen.contracts} == {
            ("Robot1.TransferObject", 10, True),
            ("Robot2.TransferObject", 20, False),
        }
        early = await all_messages(desk, task)
        assert seen.messages is not None
        assert len(early) >= seen.messages >= 7
        await ended(desk, task)
        over = await desk.tasks.read(task)
        assert [event.number for event in over.events] == [*range(1, len(over.events) + 1)]
        assert over.events[: len(seen.events)] == seen.events
        assert {(bid.service, bid.state, bid.reason) for bid in over.contracts} == {
            ("Robot1.TransferObject", State.COMPLETED, ""),
            ("Robot2.TransferObject", State.ENDED, "another service was chosen by price"),
        }
        late = await all_messages(desk, task)
        assert late[: len(early)] == early
        assert late[-1].type == "End"
        assert over.messages == len(late)

    played(tmp_path, scenario, Porter("Robot1", price=10), Porter("Robot2", price=20))


async def followed(desk: LiveApi, task: str, heard: list[News]) -> None:
    with desk.context.hub.subscribe(f"task {task}") as listening:
        await listening.wait_until_followed()
        async for news in listening:
            heard.append(news)
            if isinstance(news.value, TaskChanged) and news.value.view.phase is Phase.ENDED:
                return


def test_news_of_a_task_add_up_to_it_for_two_listeners_over_a_restart_of_the_task_manager(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        task = (await desk.tasks.submit(Submit(effect=WISH))).task
        both: list[list[News]] = [[], []]
        following = [asyncio.create_task(followed(desk, task, heard)) for heard in both]
        await asyncio.sleep(0.5)
        await system.stop_manager()
        await asyncio.sleep(0.3)
        await system.start_manager()
        await asyncio.gather(*following)
        whole = await desk.tasks.read(task)
        for heard in both:
            changes = [news.value for news in heard if isinstance(news.value, TaskChanged)]
            assert len(changes) == len(heard), "nothing was missed"
            assert [event.number for change in changes for event in change.events] == [event.number for event in whole.events]
            contracts: dict[str, ContractView] = {}
            for change in changes:
                contracts |= {contract.participant: contract for contract in change.contracts}
            assert {*contracts.values()} == {*whole.contracts}
            assert changes[-1].messages == whole.messages
        assert whole.view.outcome is Outcome.ACCOMPLISHED

    played(tmp_path, scenario, Porter("Robot1", seconds=1.5, steps=15), Porter("Robot2", price=20))


def test_the_list_tells_of_tasks_that_come_and_change(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        known: dict[str, str] = {}

        async def follow(until: Callable[[], bool]) -> None:
            with desk.context.hub.subscribe("tasks") as listening:
                await listening.wait_until_followed()
                async for news in listening:
                    assert isinstance(news.value, TasksChanged)
                    if news.value.anew:
                        known.clear()
                    known.update({row.task: str(row.outcome or row.phase) for row in news.value.rows})
                    if until():
                        return

        first = (await desk.tasks.submit(Submit(effect=WISH))).task
        following = asyncio.create_task(follow(lambda: len(known) == 2 and {*known.values()} == {"accomplished"}))
        await asyncio.sleep(0.1)
        second = (await desk.tasks.submit(Submit(effect="Tin001 isOn Cupboard002"))).task
        await asyncio.wait_for(following, 120)
        assert known == {first: "accomplished", second: "accomplished"}
        assert [row.task for row in (await desk.tasks.list()).rows] == [second, first]
        assert (await desk.tasks.list(running=True)).rows == ()
        assert len((await desk.tasks.list(limit=1)).rows) == 1

    played(tmp_path, scenario, Porter("Robot1"))


def test_whoever_stops_listening_leaves_nobody_asking(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        task = (await desk.tasks.submit(Submit(effect=WISH))).task
        await ended(desk, task)
        before = asyncio.all_tasks()
        with desk.context.hub.subscribe("tasks", f"task {task}") as listening:
            await listening.wait_until_followed()
            await asyncio.wait_for(listening.next_news(), 120)
        await asyncio.sleep(0.1)
        assert asyncio.all_tasks() <= before

    played(tmp_path, scenario, Porter("Robot1"))


def test_a_task_sent_twice_with_the_same_word_is_one(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        first = await desk.tasks.submit(Submit(effect=WISH), once="my word")
        assert await desk.tasks.submit(Submit(effect=WISH), once="my word") == first
        assert await desk.tasks.submit(Submit(effect=WISH), once="another") != first

    played(tmp_path, scenario, Porter("Robot1"))


def test_a_task_is_found_by_the_beginning_of_its_id_even_if_it_was_long_ago(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(manager, "REMEMBERED", 1)

    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        old = (await desk.tasks.submit(Submit(effect=WISH))).task
        await ended(desk, old)
        new = (await desk.tasks.submit(Submit(effect="Tin001 isOn Cupboard002"))).task
        await ended(desk, new)
        assert old not in system.manager.state.tasks
        seen = await desk.tasks.read(old.rpartition(":")[2][:12])
        assert (seen.view.task, seen.view.outcome, len(seen.contracts)) == (old, Outcome.ACCOMPLISHED, 1)
        assert seen.events[-1].text == "accomplished"
        assert [message.type for message in await all_messages(desk, old)][:2] == ["Arrange", "Terms"]
        assert [row.task for row in (await desk.tasks.list()).rows] == [new]
        for name in ("ffffffffffff", f"{old[:-1]}x", "nonsense"):
            with pytest.raises(NotFound, match="there is no task"):
                await desk.tasks.read(name)
        with pytest.raises(UsageError, match="begin with urn:uuid:"):
            await desk.tasks.read("urn:uuid:")

    played(tmp_path, scenario, Porter("Robot1"))


def test_a_task_is_cancelled_for_a_reason_that_is_told(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        task = (await desk.tasks.submit(Submit(effect=WISH))).task
        while (await desk.tasks.read(task)).view.phase is not Phase.EXECUTING:
            await asyncio.sleep(0.02)
        await desk.tasks.cancel(task, "it rains")
        await ended(desk, task)
        seen = await desk.tasks.read(task)
        assert seen.view.outcome is Outcome.CANCELLED
        assert seen.view.explanation.startswith("it rains")
        assert "stopping: it rains" in [event.text for event in seen.events]

    played(tmp_path, scenario, Porter("Robot1", seconds=5))


def test_a_thousand_messages_are_followed_without_reading_them_again(tmp_path: Path) -> None:
    """The page asks for what it has not: the answers together are as long as the whole, once."""

    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        task = (await desk.tasks.submit(Submit(effect=WISH))).task
        found: list[MessageView] = []
        pages = 0
        heard: list[News] = []
        following = asyncio.create_task(followed(desk, task, heard))
        while not following.done():
            page = await desk.tasks.messages(task, len(found))
            pages += 1
            found += page.messages
            await asyncio.sleep(0.05)
        found += (await desk.tasks.messages(task, len(found))).messages
        assert len(found) > 1000
        assert len({(message.id, message.at) for message in found}) == len(found)
        assert len(heard) < 100, "what happens in a fifth of a second is told together"

    played(tmp_path, scenario, Porter("Robot1", seconds=3, steps=1000))


def test_the_command_line_shows_bids_and_messages_of_a_task_that_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        system.addresses.write(tmp_path)
        task = (await desk.tasks.submit(Submit(effect=WISH))).task
        while (await desk.tasks.read(task)).view.phase is not Phase.EXECUTING:
            await asyncio.sleep(0.02)
        await shown(task, tmp_path, messages=False, picture=None, json=False)
        said = capsys.readouterr().out
        assert "✔ 10 EUR" in said
        assert "another service was" in said
        await shown(task, tmp_path, messages=True, picture=None, json=False)
        assert "Execute" in capsys.readouterr().out

    played(tmp_path, scenario, Porter("Robot1", price=10, seconds=5), Porter("Robot2", price=20))


def test_an_event_comes_as_a_struct_for_programs_and_as_a_sentence_for_people(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        task = (await desk.tasks.submit(Submit(effect=WISH))).task
        await ended(desk, task)
        events = msgspec.to_builtins(await desk.tasks.read(task))["events"]
        done = next(event for event in events if event["event"]["type"] == "StepCompleted")
        assert done["event"] == {"type": "StepCompleted", "service": "Robot1.TransferObject", "situation": WISH}
        assert done["text"] == f"Robot1.TransferObject completed: {WISH}"
        assert events[-1]["event"] == {"type": "TaskEnded", "outcome": "accomplished"}

    played(tmp_path, scenario, Porter("Robot1"))


def test_the_description_of_the_api_has_every_kind_of_event(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, desk: LiveApi) -> None:
        described_at = f"{desk.client.url}/openapi.json"
        schemas = json.loads(await asyncio.to_thread(lambda: urlopen(described_at).read()))["components"]["schemas"]
        described, _ = schemas["TaskEvent"]["properties"]["event"]["anyOf"]  # or null, in records of SO-MRS 0.1
        names = {kind.__name__ for kind in get_args(Event)}
        assert {one["$ref"].rpartition("/")[2] for one in described["anyOf"]} == names
        assert set(described["discriminator"]["mapping"]) == names
        assert schemas["StepFailed"]["properties"]["type"] == {"enum": ["StepFailed"]}

    played(tmp_path, scenario, Porter("Robot1"))
