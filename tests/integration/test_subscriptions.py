"""Watching tasks as they run: rows of a list, and of one task its events, bids and messages, only what is new."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.kernel.codec import Codec, encode
from somrs.kernel.component import Answered, Ask, Input, Received, Send, Started
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Fault, Outcome, State
from somrs.protocol.messages.records import Records
from somrs.protocol.messages.task_news import Messages, ReadMessages, ReadTasks, TaskNews, TasksNews, WatchTask, WatchTasks
from somrs.protocol.messages.task_views import ContractView, MessageView, Phase, StepView
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Advance, Order, WorkDone
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.state import REMEMBERED, TaskManagerState
from somrs.task_manager.subscriptions import TaskSubscriptions
from somrs.task_manager.transaction.transaction import Transaction
from tests.integration.test_task_manager import GOAL, breaks
from tests.support.event_sentences import texts
from tests.support.examples import examples
from tests.support.relay import Relay
from tests.support.virtual_system import Robot, VirtualSystem, transfer_effect

HUGE_NUMBER = 1_000_000


def two_robot_system() -> VirtualSystem:
    """The first one breaks. Numbers are as they come off the wire, and out of a journal."""
    return VirtualSystem(Robot("Robot1", price=10.0, duration=60.0, works=breaks), Robot("Robot2", price=25.0, duration=30.0))


def news(system: VirtualSystem, task: str, **options: float) -> TaskNews:
    reply = system.ask(WatchTask(task=task, **options))  # type: ignore[arg-type]  # keyword arguments of WatchTask
    assert isinstance(reply, TaskNews), reply
    return reply


def rows(system: VirtualSystem, version: int, wait: float = 0.0) -> TasksNews:
    reply = system.ask(WatchTasks(after=version, wait=wait))
    assert isinstance(reply, TasksNews), reply
    return reply


def messages(system: VirtualSystem, task: str, known_count: int = 0) -> Messages:
    reply = system.ask(ReadMessages(task=task, after=known_count))
    assert isinstance(reply, Messages), reply
    return reply


def run_until_state(system: VirtualSystem, task: str, state: State) -> None:
    assert system.world.run(60, lambda: any(step.state is state for step in system.view(task).steps))


def test_bids_are_seen_while_the_task_runs_and_who_lost_says_why() -> None:
    system = two_robot_system()
    task = system.submit(GOAL)
    run_until_state(system, task, State.EXECUTING)
    task_news = news(system, task, contracts=0, wait=0)
    bids = {contract.service: contract for contract in task_news.contracts}
    assert {(bid.price, bid.duration) for bid in bids.values()} == {(10, 60), (25, 30)}
    won, lost = bids["Robot1.TransferObject"], bids["Robot2.TransferObject"]
    assert (won.accepted, won.state) == (True, State.EXECUTING)
    assert won.start is not None
    assert won.finish == won.start + 60
    assert (lost.accepted, lost.state, lost.reason) == (False, State.ENDED, "another service was chosen by price")


def test_only_contracts_that_changed_come_again() -> None:
    system = two_robot_system()
    task = system.submit(GOAL)
    run_until_state(system, task, State.EXECUTING)
    first_news = news(system, task, contracts=0, wait=0)
    repeated_news = news(
        system, task, contracts=first_news.contracts_at, after=len(first_news.events), messages=first_news.messages, wait=0
    )
    assert repeated_news.contracts == ()
    assert repeated_news.contracts_at == first_news.contracts_at
    assert system.world.run(60, lambda: any("failed" in text for text in texts(system.manager.state.tasks[task])))
    later_news = news(system, task, contracts=first_news.contracts_at, after=len(first_news.events))
    assert (later_news.contracts[0].service, later_news.contracts[0].state) == ("Robot1.TransferObject", State.FAILED)


def test_a_message_that_tells_of_no_event_is_news_to_those_who_follow_messages() -> None:
    def works(order: Order) -> Work:
        yield 5.0, Advance(fraction=0.5)
        yield 20.0, WorkDone(situation=transfer_effect(order))

    system = VirtualSystem(Robot("Robot1", 10, 25, works=works))
    task = system.submit(GOAL)
    run_until_state(system, task, State.EXECUTING)
    first_news = news(system, task, wait=0)
    start_time = system.world.now
    second_news = news(system, task, after=len(first_news.events), messages=first_news.messages)
    assert second_news.messages > first_news.messages
    assert second_news.view.steps[0].fraction > 0 or second_news.events == ()
    assert system.world.now - start_time < 10


@pytest.mark.parametrize("silent", [False, True], ids=["breaks", "silent"])
@pytest.mark.parametrize("awaited", ["events", "messages", "contracts", "rows"])
def test_nobody_waits_for_what_is_there(awaited: str, silent: bool) -> None:
    """Whatever happens to a task, those who wait for that hear it at once: looked at after every input."""
    systems: list[VirtualSystem] = []

    def look(address: str, event: Input) -> None:
        if address == "tm" and systems:
            state = systems[0].manager.state
            subscriptions = TaskSubscriptions(state.subscriptions, state.tasks)
            assert not [watcher for watcher in state.subscriptions.watchers.values() if subscriptions.has_news(watcher.query)], event

    robots = (Robot("Robot1", 10, 60, works=breaks), Robot("Robot2", 25, 30)) if not silent else (Robot("Robot1", 10, 600),)
    system = VirtualSystem(*robots, watch=look)
    systems.append(system)
    task = system.submit(GOAL, waits=False)
    version, known_count, latest_news = 0, 0, news(system, task, contracts=0, wait=0)
    while latest_news.view.outcome is None:
        if silent and any(step.state is State.EXECUTING for step in latest_news.view.steps):
            system.world.remove("devices/Robot1")
            silent = False
        start_time = system.world.now
        if awaited == "rows":
            version = rows(system, version, wait=60).version
        else:
            positions = {"events": HUGE_NUMBER, "messages": HUGE_NUMBER, "contracts": HUGE_NUMBER} | {awaited: known_count}
            reply = news(system, task, after=positions["events"], messages=positions["messages"], contracts=positions["contracts"], wait=60)
            known_count = {"events": known_count + len(reply.events), "messages": reply.messages, "contracts": reply.contracts_at}[awaited]
        assert system.world.now - start_time < 60
        latest_news = news(system, task, contracts=0, wait=0)


def test_messages_are_read_behind_those_that_are_known_and_stay_where_they_are_when_the_task_is_over() -> None:
    system = two_robot_system()
    task = system.submit(GOAL)
    run_until_state(system, task, State.EXECUTING)
    first = messages(system, task)
    assert [message.type for message in first.messages[:2]] == ["Arrange", "Arrange"]
    assert messages(system, task, known_count=len(first.messages)).messages == ()
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    record = system.task_record()
    assert record.messages[: len(first.messages)] == first.messages
    assert news(system, task).messages == len(record.messages)


def test_a_thousand_messages_come_in_pages_that_fit_the_wire() -> None:
    def works(order: Order) -> Work:
        for number in range(1200):
            yield 1.0, Advance(fraction=number / 1200, situation=None, note="")
        yield 1.0, WorkDone(situation=transfer_effect(order))

    system = VirtualSystem(Robot("Robot1", 10, 1200, works=works))
    task = system.submit(GOAL)
    assert system.world.run(1190, lambda: system.manager.state.tasks[task].message_count > 1100)
    message_views: list[MessageView] = []
    has_next_page = True
    while has_next_page:
        page = messages(system, task, known_count=len(message_views))
        assert len(soap.encode(_from_manager(page))) < MOST_BYTES
        message_views += page.messages
        has_next_page = page.more
    assert len(message_views) >= 1100
    assert [message.type for message in message_views].count("Execute") == 1


def _from_manager(body: object) -> Message:
    return Message(header=Header(sender="tm", recipient="client", message_id="urn:uuid:1"), body=body)  # type: ignore[arg-type]


def test_the_list_tells_of_what_changed_only() -> None:
    system = two_robot_system()
    first_rows = rows(system, 0)
    assert first_rows.rows == ()
    task = system.submit(GOAL, priority=7)
    new_rows = rows(system, first_rows.version)
    assert [(row.task, row.effect, row.priority) for row in new_rows.rows] == [(task, GOAL, 7)]
    other_task = system.submit("Tin001 isOn Cupboard001")
    system.finish(other_task)
    changed_rows = rows(system, new_rows.version)
    assert {row.task for row in changed_rows.rows} == {task, other_task}
    (row,) = [row for row in changed_rows.rows if row.task == other_task]
    assert (row.outcome, row.fraction) == (Outcome.ACCOMPLISHED, 1.0)
    system.finish(task)
    assert {row.task: row.phase for row in rows(system, 0).rows} == {task: Phase.ENDED, other_task: Phase.ENDED}
    (row,) = [row for row in rows(system, 0).rows if row.task == task]
    assert row.setbacks == 1
    assert (row.steps, row.done) == (1, 1)


def test_a_list_that_nothing_happens_to_is_answered_when_its_time_is_over() -> None:
    system = two_robot_system()
    version, start_time = rows(system, 0).version, system.world.now
    assert rows(system, version, wait=12).rows == ()
    assert 12 <= system.world.now - start_time < 13


def test_a_row_shows_who_works_and_how_far_it_is() -> None:
    def works(order: Order) -> Work:
        yield 5.0, Advance(fraction=0.5)
        yield 60.0, WorkDone(situation=transfer_effect(order))

    system = VirtualSystem(Robot("Robot1", 10, 60, works=works))
    task = system.submit(GOAL)
    run_until_state(system, task, State.EXECUTING)
    system.world.run(10)
    (row,) = rows(system, 0).rows
    assert (row.task, row.services, row.fraction) == (task, ("Robot1.TransferObject",), 0.5)


def test_who_follows_the_list_is_told_that_a_new_task_manager_knows_nothing_of_it() -> None:
    system = two_robot_system()
    system.submit(GOAL)
    rows_before = rows(system, 0)
    system.world.remove("tm")
    system.add_manager("tm")
    system.world.run(5)
    rows_after = rows(system, rows_before.version)
    assert rows_after.begun != rows_before.begun
    assert rows_after.rows == ()


def test_the_list_goes_on_where_it_was_after_a_restart() -> None:
    system = two_robot_system()
    task = system.submit(GOAL)
    run_until_state(system, task, State.EXECUTING)
    rows_before = rows(system, 0)
    for snapshot in (False, True):
        system.restart_manager(snapshot=snapshot)
        rows_after = rows(system, rows_before.version)
        assert rows_after.begun == rows_before.begun
        assert rows_after.version >= rows_before.version
    system.finish(task)
    assert [row.outcome for row in rows(system, rows_before.version).rows] == [Outcome.ACCOMPLISHED]


def test_tasks_that_are_forgotten_are_not_in_the_list() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 1))
    tasks = [system.submit("Tin001 isOn Cupboard001") for _ in range(REMEMBERED + 3)]
    system.finish(tasks[-1])
    task_ids: set[str] = set()
    version, has_next_page = 0, True
    while has_next_page:
        page = rows(system, version)
        assert len(soap.encode(_from_manager(page))) < MOST_BYTES
        task_ids |= {row.task for row in page.rows}
        version, has_next_page = page.version, page.more
    assert task_ids == {*tasks[3:]}


def test_a_task_of_long_ago_has_its_messages_in_the_archive() -> None:
    """The Task Manager asks its records; here they are answered by hand."""
    system = two_robot_system()
    task = system.submit(GOAL)
    system.finish(task)
    manager = system.manager
    header = Header(sender="client", recipient="tm", message_id="urn:uuid:q1", reply_to="client")
    effects = manager.handle(Received(Message(header=header, body=ReadMessages(task="urn:uuid:gone"))), system.world.now)
    (archive_ask,) = [effect for effect in effects if isinstance(effect, Ask)]
    (answer,) = manager.handle(Answered(archive_ask.question, Records(records=())), system.world.now)
    assert isinstance(answer, Send)
    assert isinstance(answer.message.body, Fault)
    assert "there is no task urn:uuid:gone" in answer.message.body.text


@examples(15)
@given(pauses=st.lists(st.floats(0.0, 30.0), min_size=1, max_size=8), restart=st.booleans())
def test_news_put_together_are_the_whole(pauses: list[float], restart: bool) -> None:
    """Whoever follows a task by its news, however slowly, has in the end what whoever asks for all of it gets."""
    system = two_robot_system()
    task = system.submit(GOAL)
    events, message_count, contracts, contracts_at = 0, 0, dict[str, ContractView](), 0
    passed: list[MessageView] = []
    for pause in pauses:
        system.world.run(pause)
        if restart:
            system.restart_manager()
            system.world.run(0.1)
        if system.manager.state.tasks[task].outcome is not None:
            break
        reply = news(system, task, after=events, messages=message_count, contracts=contracts_at, wait=0)
        assert [event.number for event in reply.events] == [*range(events + 1, events + 1 + len(reply.events))]
        events, message_count, contracts_at = events + len(reply.events), reply.messages, reply.contracts_at
        contracts |= {contract.participant: contract for contract in reply.contracts}
        if system.manager.state.tasks[task].outcome is None:
            passed += messages(system, task, known_count=len(passed)).messages
    if system.manager.state.tasks[task].outcome is None:
        whole = news(system, task, contracts=0, wait=0)
        last_news = news(system, task, after=events, contracts=contracts_at, wait=0)
        contracts |= {contract.participant: contract for contract in last_news.contracts}
        assert contracts == {contract.participant: contract for contract in whole.contracts}
        assert events + len(last_news.events) == len(whole.events)
        assert [*messages(system, task).messages][: len(passed)] == passed


def copy_manager(manager: TaskManager) -> TaskManager:
    """What is read of what was written of it."""
    return TaskManager.restored(Codec[TaskManagerState](TaskManagerState).decode(encode(manager.state)))


def test_a_manager_that_is_watched_is_data() -> None:
    system = two_robot_system()
    task = system.submit(GOAL)
    run_until_state(system, task, State.EXECUTING)
    count = len(system.manager.state.tasks[task].events)
    manager = copy_manager(system.manager)
    header = Header(sender="client", recipient="tm", message_id="urn:uuid:q1", reply_to="client")
    manager.handle(Received(Message(header=header, body=WatchTask(task=task, after=count))), system.world.now)
    second_copy = copy_manager(manager)
    effects = second_copy.handle(Started("tm"), system.world.now)
    assert not [effect for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, TaskNews)]
    [*Transaction(second_copy.state.tasks[task], second_copy._context).cancel(system.world.now, "enough")]
    assert texts(second_copy.state.tasks[task])[-1] == "stopping: enough"
    later_effects = second_copy.handle(Started("tm"), system.world.now)
    assert [effect for effect in later_effects if isinstance(effect, Send) and isinstance(effect.message.body, TaskNews)]


def test_a_plan_that_is_too_long_for_a_message_comes_in_parts() -> None:
    relay = Relay(couriers=10, parcels=10)
    task = relay.submit(relay.goal)
    assert relay.world.run(600, lambda: relay.manager.state.tasks[task].phase is Phase.EXECUTING)
    whole, parts, rest = relay.view(task), list[object](), 0
    while True:
        page = news(relay, task, parts=rest, contracts=0, wait=0)
        assert len(soap.encode(_from_manager(page))) < MOST_BYTES
        parts += [*page.view.steps, *page.view.work]
        if page.rest is None:
            break
        rest = page.rest
    assert rest > 0
    assert [part.step for part in parts if isinstance(part, StepView)] == [step.step for step in whole.steps]
    assert len(parts) == len(whole.steps) + len(whole.work)
    contracts, events = [*page.contracts], len(page.events)
    while page.more:
        page = news(relay, task, parts=rest, contracts=page.contracts_at, after=events, wait=0)
        assert len(soap.encode(_from_manager(page))) < MOST_BYTES
        contracts, events = [*contracts, *page.contracts], events + len(page.events)
    assert len({contract.participant for contract in contracts}) == len(whole.steps)
    listed = relay.ask(ReadTasks())
    assert len(soap.encode(_from_manager(listed))) < MOST_BYTES
