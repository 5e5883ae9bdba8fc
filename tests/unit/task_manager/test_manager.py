"""Which requests of clients a Task Manager takes, and what it answers."""

from __future__ import annotations

import pytest

from somrs.kernel.codec import encode
from somrs.kernel.component import Answered, Ask, DeliveryFailed, Effect, ErrorAnswer, Received, Send, SetTimer, Started, TimerFired
from somrs.kernel.replica import Replica, ReplicaDue
from somrs.protocol.messages import frp, previews, records, submission, task_news, task_views
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, reply
from somrs.protocol.messages.knowledge import (
    Definitions,
    Event,
    MapChanged,
    MapPage,
    MapSubscribed,
    OntologyPage,
    Rejected,
    SubscribeMap,
    Updated,
)
from somrs.protocol.messages.submission import Policy, Submit
from somrs.task_manager.context import MOST_PRIORITY, find_task_error
from somrs.task_manager.manager import SCHEMA, TaskManager
from somrs.task_manager.state import UnsettledReport
from somrs.task_manager.timers import MapDue, NewsDue, RecordsWanted
from tests.unit.task_manager.transaction.test_participant_events import GOAL, TaskManagerHarness, bodies


def send_request(manager: TaskManager, body: Body, now: float = 10.0, id: str = "request") -> list[Effect]:
    header = Header(sender="client", recipient="tm", message_id=id, reply_to="client")
    return manager.handle(Received(Message(header=header, body=body)), now)


def answers(effects: list[Effect]) -> list[Body]:
    return [effect.message.body for effect in effects if isinstance(effect, Send) and effect.message.header.recipient == "client"]


def record(task: str) -> records.TaskRecord:
    message = task_views.MessageView(at=1.0, type="End", sender="tm", recipient="r", participant="p", id="1", relates_to=None, body="{}")
    return records.TaskRecord(
        task=task, client="client", effect=GOAL, submitted_at=0.0, ended_at=1.0, outcome=frp.Outcome.FAILED, messages=(message,)
    )


@pytest.mark.parametrize("body", [submission.Submit(effect=GOAL), previews.Preview(effect=GOAL)])
def test_who_wants_something_before_the_map_is_known_waits_for_it(body: Body) -> None:
    manager = TaskManager("tm", repository="repository", registry="registry")
    assert send_request(manager, body, 10.0) == [SetTimer(MapDue("request"), 40.0)]
    (fault,) = answers(manager.handle(TimerFired(MapDue("request")), 40.0))
    assert fault == frp.Fault(
        code="env:Receiver",
        text="the map of the environment is not known yet, because repository does not answer; try again later",
    )
    assert manager.handle(TimerFired(MapDue("request")), 41.0) == []
    assert answers(send_request(manager, task_news.ReadTasks(), 42.0, "other")) == [task_news.Tasks(tasks=(), total=0)]


@pytest.mark.parametrize("body", [submission.CancelTask(task="no task"), task_news.WatchTask(task="no task")])
def test_a_task_that_is_not_known_is_said_to_be_none(body: Body) -> None:
    assert answers(send_request(TaskManagerHarness().manager, body)) == [frp.Fault(code="env:Sender", text="there is no task no task here")]


@pytest.mark.parametrize("body", [frp.Fault(code="", text=""), Updated(version=3)])
def test_what_is_no_request_is_not_answered(body: Body) -> None:
    assert send_request(TaskManagerHarness().manager, body) == []


def test_a_request_for_others_is_answered_with_a_fault() -> None:
    (fault,) = answers(send_request(TaskManagerHarness().manager, frp.Query()))
    assert fault == frp.Fault(code="wsa:ActionNotSupported", text="a Task Manager does not understand Query")


def test_a_task_that_is_stated_twice_by_one_message_is_one_task() -> None:
    manager = TaskManagerHarness().manager
    first = answers(send_request(manager, submission.Submit(effect="Jar001 isOn Platform001"), 10.0, "again"))
    second = answers(send_request(manager, submission.Submit(effect="Jar001 isOn Platform001"), 11.0, "again"))
    assert first == second
    assert len(manager.open) == 2
    rejected = answers(send_request(manager, submission.Submit(effect="Jar001 isOn Platform001", deadline=0.0), 12.0, "wrong"))
    assert [type(body) for body in rejected] == [submission.TaskRejected]
    assert len(manager.state.tasks) == 2


def test_tasks_are_listed_from_the_newest_and_by_pages() -> None:
    harness = TaskManagerHarness()
    first = harness.task.id
    submitted_ids = []
    for number, jar in enumerate(("Jar001", "Tin001")):
        (body,) = answers(send_request(harness.manager, submission.Submit(effect=f"{jar} isOn Platform001"), 10.0 + number, jar))
        assert isinstance(body, submission.Submitted)
        submitted_ids.append(body.task)
    second, third = submitted_ids
    send_request(harness.manager, submission.CancelTask(task=second), 20.0, "cancel")

    def listed(**options: object) -> tuple[list[str], bool]:
        (listing,) = answers(send_request(harness.manager, task_news.ReadTasks(**options), 30.0))  # type: ignore[arg-type]  # fields of ReadTasks
        assert isinstance(listing, task_news.Tasks)
        return [view.task for view in listing.tasks], listing.more

    assert listed() == ([third, second, first], False)
    assert listed(running=True) == ([third, first], False)
    assert listed(limit=2) == ([third, second], True)
    assert listed(limit=0) == ([], True)
    assert listed(limit=-1) == ([], True)
    assert listed(behind=third) == ([second, first], False)
    assert listed(behind=second, running=True) == ([first], False)
    assert listed(behind="no task") == ([], False)


def test_messages_of_a_task_that_is_under_way_are_read_behind_those_that_are_known() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    types = ["Arrange", "Terms", "Accept", "Execute"]
    for offset, expected in ((-1, types), (0, types), (3, types[3:]), (4, []), (9, [])):
        (page,) = answers(send_request(harness.manager, task_news.ReadMessages(task=harness.task.id, after=offset)))
        assert isinstance(page, task_news.Messages)
        assert ([message.type for message in page.messages], page.more) == (expected, False)


def test_messages_of_a_task_that_is_over_are_read_from_its_record() -> None:
    manager = TaskManagerHarness().manager
    other_parts = tuple(name for name in records.PARTS if name != "messages")
    for offset, expected_offset in ((-2, 0), (5, 5)):
        (ask,) = [effect for effect in send_request(manager, task_news.ReadMessages(task="old", after=offset)) if isinstance(effect, Ask)]
        assert ask == Ask(RecordsWanted("request"), records.ReadRecords(task="old", limit=1, after=expected_offset, without=other_parts))
    task_record = record("old")
    (body,) = answers(manager.handle(Answered(RecordsWanted("request"), records.Records(records=(task_record,))), 11.0))
    assert body == task_news.Messages(messages=task_record.messages)
    assert manager.handle(Answered(RecordsWanted("request"), records.Records(records=(task_record,))), 11.0) == []


@pytest.mark.parametrize(
    ("body", "value", "answer"),
    [
        (task_news.ReadMessages(task="old"), records.Records(records=()), frp.Fault(code="env:Sender", text="there is no task old here")),
        (
            task_news.ReadMessages(task="old"),
            ErrorAnswer("the disk is full"),
            frp.Fault(code="env:Receiver", text="the records cannot be read: the disk is full"),
        ),
        (
            records.ReadRecords(),
            ValueError(),
            frp.Fault(code="env:Receiver", text="the records cannot be read: ValueError"),
        ),
        (records.ReadRecords(), records.Records(records=()), records.Records(records=())),
    ],
)
def test_what_the_archive_says_is_told_to_who_asked(body: Body, value: object, answer: Body) -> None:
    manager = TaskManagerHarness().manager
    send_request(manager, body)
    assert answers(manager.handle(Answered(RecordsWanted("request"), value), 11.0)) == [answer]
    assert manager.state.awaiting_records == {}


@pytest.mark.parametrize(("wait", "fire_time"), [(5.0, 15.0), (90.0, 70.0), (float("nan"), 70.0), (float("inf"), 70.0)])
def test_who_waits_for_news_is_answered_in_time(wait: float, fire_time: float) -> None:
    harness = TaskManagerHarness()
    news = len(harness.task.events)
    effects = send_request(harness.manager, task_news.WatchTask(task=harness.task.id, after=news, wait=wait))
    assert effects == [SetTimer(NewsDue("request"), fire_time)]
    (body,) = answers(harness.manager.handle(TimerFired(NewsDue("request")), fire_time))
    assert isinstance(body, task_news.TaskNews)
    assert (body.events, body.more, body.messages, body.contracts, body.contracts_at) == ((), False, 1, (), 0)
    assert harness.manager.handle(TimerFired(NewsDue("request")), fire_time) == []


@pytest.mark.parametrize(
    ("options", "answered"),
    [
        ({"after": 2}, True),
        ({"after": 3}, False),
        ({"after": 3, "messages": 0}, True),
        ({"after": 3, "messages": 1}, False),
        ({"after": 3, "contracts": 0}, True),
        ({"after": 3, "contracts": 1}, False),
    ],
)
def test_who_waits_for_news_is_told_what_is_new(options: dict[str, int], answered: bool) -> None:
    harness = TaskManagerHarness()
    effects = send_request(harness.manager, task_news.WatchTask(task=harness.task.id, **options))
    assert bool(answers(effects)) is answered
    assert [effect for effect in effects if isinstance(effect, SetTimer)] == ([] if answered else [SetTimer(NewsDue("request"), 30.0)])


def test_news_number_events_and_contracts() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    (first,) = answers(send_request(harness.manager, task_news.WatchTask(task=harness.task.id, contracts=0)))
    assert isinstance(first, task_news.TaskNews)
    assert [event.number for event in first.events] == [1, 2, 3]
    assert ([contract.number for contract in first.contracts], first.contracts_at, first.messages) == ([1, 2], 2, 2)
    harness.offer(12.0)
    (second,) = answers(send_request(harness.manager, task_news.WatchTask(task=harness.task.id, after=3, contracts=2), 13.0))
    assert isinstance(second, task_news.TaskNews)
    assert [event.number for event in second.events] == [4]
    assert ([contract.number for contract in second.contracts], second.contracts_at) == ([1], 3)


def test_the_list_tells_which_tasks_changed_since() -> None:
    harness = TaskManagerHarness()
    send_request(harness.manager, submission.Submit(effect="Jar001 isOn Platform001"), 10.0, "other")
    other_id = harness.manager.open[1]

    def rows(known_version: int) -> tuple[list[str], int] | None:
        news = answers(send_request(harness.manager, task_news.WatchTasks(after=known_version), 20.0))
        assert all(isinstance(body, task_news.TasksNews) and not body.more for body in news)
        return ([row.task for row in news[0].rows], news[0].version) if news and isinstance(news[0], task_news.TasksNews) else None

    version = harness.manager.state.subscriptions.version
    assert rows(0) == ([harness.manager.open[0], other_id], version)
    assert rows(version) is None
    assert rows(version + 5) == ([harness.manager.open[0], other_id], version)
    assert rows(version - 1) == ([other_id], version)


# The map


def changed(version: int) -> Received:
    """The Repository tells that its map is at that version."""
    header = Header(sender="repository", recipient="tm", message_id=f"event {version}")
    return Received(Message(header=header, body=MapChanged(event=Event(version=version, at=0.0, author="", changes=()))))


@pytest.mark.parametrize(
    ("answer", "problems"),
    [(Updated(version=2), ()), (Rejected(problems=("no such place",), version=2), ("no such place",))],
    ids=["updated", "rejected"],
)
def test_what_was_reported_counts_once_the_map_is_known_that_shows_it(answer: Body, problems: tuple[str, ...]) -> None:
    harness = TaskManagerHarness()
    harness.executing()
    state, event_count = harness.manager.state, len(harness.task.events) + 1
    effects = harness.manager.handle(Received(harness.message(frp.Completed(situation=GOAL))), 50.0)
    (update,) = [effect.message for effect in effects if isinstance(effect, Send)]
    harness.manager.handle(Received(reply(update, answer, "repository")), 51.0)
    assert state.unsettled == [UnsettledReport(version=2, task=harness.task.id, problems=problems)]
    harness.manager.handle(changed(1), 52.0)
    assert (len(state.unsettled), state.map_version, harness.task.events[event_count:]) == (1, 1, [])
    harness.manager.handle(changed(2), 53.0)
    assert (state.unsettled, state.map_version) == ([], 2)
    assert [type(entry.event).__name__ for entry in harness.task.events[event_count:]][:1] == (
        ["ReportRejected"] if problems else ["Replanned"]
    )


def test_what_was_reported_to_another_store_is_not_waited_for() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    state = harness.manager.state
    state.replica.version = state.map_version = 7
    effects = harness.manager.handle(Received(harness.message(frp.Completed(situation=GOAL))), 50.0)
    (update,) = [effect.message for effect in effects if isinstance(effect, Send)]
    harness.manager.handle(Received(reply(update, Updated(version=9), "repository")), 51.0)
    effects = harness.manager.handle(Started("tm"), 52.0)
    objects, facts = tuple(state.replica.map.objects.values()), tuple(state.replica.map.facts())
    for body in (
        MapSubscribed(version=3, until=90.0),
        OntologyPage(definitions=Definitions(), version=3, next=0, more=False),
        MapPage(objects=objects, facts=facts, version=3, more=False),
    ):
        assert len(state.unsettled) == 1
        question = next(
            effect.message for effect in effects if isinstance(effect, Send) and effect.message.header.recipient == "repository"
        )
        effects = harness.manager.handle(Received(reply(question, body, "repository")), 53.0)
    assert (state.unsettled, state.map_version, state.replica.version) == ([], 3, 3)


def test_who_waited_for_the_map_is_served_once_it_is_read() -> None:
    manager, replica = TaskManager("tm", repository="repository", registry="registry"), TaskManagerHarness().replica
    send_request(manager, submission.Submit(effect=GOAL), 10.0, "first")
    manager.state.replica.ontology, manager.state.replica.map = replica.ontology, replica.map
    manager.handle(changed(3), 11.0)
    assert [*manager.state.awaiting_map] == ["first"], "it is not read yet"
    manager.state.replica.version = 3
    effects = manager.handle(TimerFired(ReplicaDue()), 12.0)
    assert SetTimer(MapDue("first"), None) in effects
    assert [type(body) for body in answers(effects)] == [submission.Submitted]
    assert (manager.state.awaiting_map, len(manager.open)) == ({}, 1)


def restarted(version: int) -> TaskManagerHarness:
    """A Task Manager that was down until 50.0, while the map came to the version."""
    harness = TaskManagerHarness()
    effects = harness.manager.handle(Started("tm"), 50.0)
    (question,) = [effect.message for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, SubscribeMap)]
    assert answers(send_request(harness.manager, submission.Submit(effect="Tin001 isOn Platform001"), 50.1, "first")) == []
    assert [*harness.manager.state.awaiting_map] == ["first"], "what has changed meanwhile is not known"
    own = harness.manager.state.replica.version
    answered = harness.manager.handle(Received(reply(question, MapSubscribed(version=own + version, until=90.0), "repository")), 50.2)
    assert bool(answers(answered)) is (version == 0)
    return harness


def test_after_a_restart_a_task_waits_until_the_map_is_as_the_repository_has_it() -> None:
    assert len(restarted(0).manager.open) == 2
    harness = restarted(2)
    first = harness.manager.state.replica.version + 1
    assert answers(harness.manager.handle(changed(first), 50.3)) == []
    effects = harness.manager.handle(changed(first + 1), 50.4)
    assert [type(body) for body in answers(effects)] == [submission.Submitted]
    assert len(harness.manager.open) == 2


def test_if_the_repository_does_not_tell_what_has_changed_the_map_as_it_was_is_used() -> None:
    harness = restarted(2)
    effects = harness.manager.handle(TimerFired(MapDue("first")), 80.1)
    assert [type(body) for body in answers(effects)] == [submission.Submitted]


def test_tasks_are_known_since_the_first_start() -> None:
    harness = TaskManagerHarness()
    for now in (7.0, 9.0):
        harness.manager.handle(Started("tm"), now)
    (news,) = answers(send_request(harness.manager, task_news.WatchTasks(after=0), 20.0))
    assert isinstance(news, task_news.TasksNews)
    assert (news.begun, harness.manager.state.requests.incarnation) == (7.0, 7.0)


# What is kept


def test_the_oldest_tasks_that_are_over_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.task_manager.state.REMEMBERED", 2)
    harness = TaskManagerHarness()
    first = harness.task.id
    for number, jar in enumerate(("Jar001", "Tin001")):
        send_request(harness.manager, submission.Submit(effect=f"{jar} isOn Platform001"), 10.0 + number, jar)
    _, second, third = harness.manager.open
    assert [*harness.manager.state.tasks] == [first, second, third], "none of them is over"
    send_request(harness.manager, submission.CancelTask(task=second), 20.0, "cancel")
    assert [*harness.manager.state.tasks] == harness.manager.open == [first, third]
    assert second not in harness.manager.state.subscriptions.changed
    send_request(harness.manager, submission.CancelTask(task=first), 21.0, "cancel again")
    assert ([*harness.manager.state.tasks], harness.manager.open) == ([first, third], [third])


def test_more_messages_than_fit_are_behind_those_that_do() -> None:
    manager = TaskManagerHarness().manager
    send_request(manager, task_news.ReadMessages(task="old"))
    archive_page = records.Records(records=(record("old"),), rest=1)
    (body,) = answers(manager.handle(Answered(RecordsWanted("request"), archive_page), 11.0))
    assert body == task_news.Messages(messages=archive_page.records[0].messages, more=True)


@pytest.mark.parametrize(("participant", "expected"), [("p", ["Cancel"]), (None, [])])
def test_who_takes_part_in_nothing_that_is_known_is_sent_home(participant: str | None, expected: list[str]) -> None:
    harness = TaskManagerHarness()
    header = Header(sender="r", recipient="tm", message_id="m", reply_to="r", transaction="no task", participant=participant)
    message = Message(header=header, body=frp.Terms(effect=GOAL, price=1.0, duration=1.0))
    assert bodies(harness.manager.handle(Received(message), 5.0)) == expected
    assert harness.manager.handle(DeliveryFailed(message, "no route"), 6.0) == []


# What is no task


@pytest.mark.parametrize(
    ("options", "fits"),
    [
        ({}, True),
        ({"deadline": 0.5}, True),
        ({"deadline": 0.0}, False),
        ({"deadline": -1.0}, False),
        ({"deadline": float("inf")}, False),
        ({"deadline": float("nan")}, False),
        ({"time_value": float("inf")}, False),
        ({"time_value": -1.0, "policy": Policy.WEIGHTED}, True),
        ({"priority": MOST_PRIORITY}, True),
        ({"priority": -MOST_PRIORITY}, True),
        ({"priority": MOST_PRIORITY + 1}, False),
        ({"priority": -MOST_PRIORITY - 1}, False),
        ({"precondition": "Jar002 isOn Nothing"}, False),
        ({"effect": "Jar002 isOn Nothing"}, False),
    ],
)
def test_what_a_task_may_be(options: dict[str, object], fits: bool) -> None:
    replica: Replica = TaskManagerHarness().replica
    assert (find_task_error(Submit(**{"effect": GOAL, **options}), replica) is None) is fits  # type: ignore[arg-type]  # fields of Submit


@pytest.mark.parametrize(
    ("body", "reply_to", "reads"),
    [
        (task_news.ReadTasks(), ANONYMOUS, True),
        (task_news.ReadTasks(), "client", False),
        (task_news.WatchTasks(wait=0), ANONYMOUS, True),
        (task_news.WatchTasks(wait=0, after=77), ANONYMOUS, True),
        (task_news.WatchTask(task="no task", wait=0), ANONYMOUS, True),
        (task_news.WatchTasks(), ANONYMOUS, False),
        (records.ReadRecords(), ANONYMOUS, False),
        (submission.CancelTask(task="no task"), ANONYMOUS, False),
    ],
)
def test_what_only_reads_changes_nothing_and_is_answered_at_once(body: Body, reply_to: str, reads: bool) -> None:
    harness = TaskManagerHarness()
    message = Message(header=Header(sender="client", recipient="tm", message_id="request", reply_to=reply_to), body=body)
    assert SCHEMA.is_read_only(Received(message)) is reads
    if reads:
        state = encode(harness.manager.state)
        assert len(harness.manager.handle(Received(message), 20.0)) == 1
        assert encode(harness.manager.state) == state
