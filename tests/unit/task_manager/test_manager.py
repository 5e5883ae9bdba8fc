"""Which requests of clients a Task Manager takes, and what it answers."""

from __future__ import annotations

import pytest

from somrs.kernel.component import Answered, Ask, DeliveryFailed, Effect, ErrorAnswer, Received, Send, SetTimer, Started, TimerFired
from somrs.kernel.replica import Replica, ReplicaDue
from somrs.protocol.messages import clients, frp, records
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import Policy, Submit
from somrs.protocol.messages.directory import Discover
from somrs.protocol.messages.envelope import Header, Message, reply
from somrs.protocol.messages.knowledge import Definitions, Event, MapChanged, MapPage, MapSubscribed, OntologyPage, Rejected, Updated
from somrs.task_manager.context import MOST_PRIORITY, find_task_error
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.state import UnsettledReport
from somrs.task_manager.timers import MapDue, NewsDue, RecordsWanted
from tests.unit.task_manager.transaction.test_participant_events import WISH, Desk, bodies


def asked(manager: TaskManager, body: Body, now: float = 10.0, id: str = "request") -> list[Effect]:
    header = Header(sender="client", recipient="tm", message_id=id, reply_to="client")
    return manager.handle(Received(Message(header=header, body=body)), now)


def answers(effects: list[Effect]) -> list[Body]:
    return [effect.message.body for effect in effects if isinstance(effect, Send) and effect.message.header.recipient == "client"]


def record(task: str) -> records.TaskRecord:
    message = clients.MessageView(at=1.0, type="End", sender="tm", recipient="r", participant="p", id="1", relates_to=None, body="{}")
    return records.TaskRecord(
        task=task, client="client", effect=WISH, submitted_at=0.0, ended_at=1.0, outcome=frp.Outcome.FAILED, messages=(message,)
    )


@pytest.mark.parametrize("body", [clients.Submit(effect=WISH), clients.Preview(effect=WISH)])
def test_who_wants_something_before_the_map_is_known_waits_for_it(body: Body) -> None:
    manager = TaskManager("tm", repository="repository", registry="registry")
    assert asked(manager, body, 10.0) == [SetTimer(MapDue("request"), 40.0)]
    (fault,) = answers(manager.handle(TimerFired(MapDue("request")), 40.0))
    assert fault == frp.Fault(
        code="env:Receiver",
        text="the map of the environment is not known yet, because repository does not answer; try again later",
    )
    assert manager.handle(TimerFired(MapDue("request")), 41.0) == []
    assert answers(asked(manager, clients.ReadTasks(), 42.0, "other")) == [clients.Tasks(tasks=())]


@pytest.mark.parametrize("body", [clients.CancelTask(task="no task"), clients.WatchTask(task="no task")])
def test_a_task_that_is_not_known_is_said_to_be_none(body: Body) -> None:
    assert answers(asked(Desk().manager, body)) == [frp.Fault(code="env:Sender", text="there is no task no task here")]


@pytest.mark.parametrize("body", [frp.Fault(code="", text=""), Updated(version=3)])
def test_what_is_no_request_is_not_answered(body: Body) -> None:
    assert asked(Desk().manager, body) == []


def test_a_request_for_others_is_answered_with_a_fault() -> None:
    (fault,) = answers(asked(Desk().manager, frp.Query()))
    assert fault == frp.Fault(code="wsa:ActionNotSupported", text="a Task Manager does not take Query")


def test_a_task_that_is_stated_twice_by_one_message_is_one_task() -> None:
    manager = Desk().manager
    first = answers(asked(manager, clients.Submit(effect="Jar001 isOn Platform001"), 10.0, "again"))
    second = answers(asked(manager, clients.Submit(effect="Jar001 isOn Platform001"), 11.0, "again"))
    assert first == second
    assert len(manager.open) == 2
    rejected = answers(asked(manager, clients.Submit(effect="Jar001 isOn Platform001", deadline=0.0), 12.0, "wrong"))
    assert [type(body) for body in rejected] == [clients.TaskRejected]
    assert len(manager.state.tasks) == 2


def test_tasks_are_listed_from_the_newest_and_by_pages() -> None:
    desk = Desk()
    first = desk.task.id
    more = []
    for number, jar in enumerate(("Jar001", "Tin001")):
        (body,) = answers(asked(desk.manager, clients.Submit(effect=f"{jar} isOn Platform001"), 10.0 + number, jar))
        assert isinstance(body, clients.Submitted)
        more.append(body.task)
    second, third = more
    asked(desk.manager, clients.CancelTask(task=second), 20.0, "cancel")

    def listed(**wanted: object) -> tuple[list[str], bool]:
        (found,) = answers(asked(desk.manager, clients.ReadTasks(**wanted), 30.0))  # type: ignore[arg-type]  # fields of ReadTasks
        assert isinstance(found, clients.Tasks)
        return [view.task for view in found.tasks], found.more

    assert listed() == ([third, second, first], False)
    assert listed(running=True) == ([third, first], False)
    assert listed(limit=2) == ([third, second], True)
    assert listed(limit=0) == ([], True)
    assert listed(limit=-1) == ([], True)
    assert listed(behind=third) == ([second, first], False)
    assert listed(behind=second, running=True) == ([first], False)
    assert listed(behind="no task") == ([], False)


def test_messages_of_a_task_that_is_under_way_are_read_behind_those_that_are_known() -> None:
    desk = Desk()
    desk.executing()
    types = ["Arrange", "Terms", "Accept", "Execute"]
    for after, expected in ((-1, types), (0, types), (3, types[3:]), (4, []), (9, [])):
        (found,) = answers(asked(desk.manager, clients.ReadMessages(task=desk.task.id, after=after)))
        assert isinstance(found, clients.Messages)
        assert ([message.type for message in found.messages], found.more) == (expected, False)


def test_messages_of_a_task_that_is_over_are_read_from_its_record() -> None:
    manager = Desk().manager
    without = tuple(name for name in records.PARTS if name != "messages")
    for after, wanted in ((-2, 0), (5, 5)):
        (ask,) = [one for one in asked(manager, clients.ReadMessages(task="old", after=after)) if isinstance(one, Ask)]
        assert ask == Ask(RecordsWanted("request"), records.ReadRecords(task="old", limit=1, after=wanted, without=without))
    found = record("old")
    (body,) = answers(manager.handle(Answered(RecordsWanted("request"), records.Records(records=(found,))), 11.0))
    assert body == clients.Messages(messages=found.messages)
    assert manager.handle(Answered(RecordsWanted("request"), records.Records(records=(found,))), 11.0) == []


@pytest.mark.parametrize(
    ("body", "value", "answer"),
    [
        (clients.ReadMessages(task="old"), records.Records(records=()), frp.Fault(code="env:Sender", text="there is no task old here")),
        (
            clients.ReadMessages(task="old"),
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
    manager = Desk().manager
    asked(manager, body)
    assert answers(manager.handle(Answered(RecordsWanted("request"), value), 11.0)) == [answer]
    assert manager.state.awaiting_records == {}


@pytest.mark.parametrize(("wait", "at"), [(5.0, 15.0), (0.0, 10.0), (-3.0, 10.0), (90.0, 70.0), (float("nan"), 70.0), (float("inf"), 70.0)])
def test_who_waits_for_news_is_answered_in_time(wait: float, at: float) -> None:
    desk = Desk()
    news = len(desk.task.events)
    effects = asked(desk.manager, clients.WatchTask(task=desk.task.id, after=news, wait=wait))
    assert effects == [SetTimer(NewsDue("request"), at)]
    (body,) = answers(desk.manager.handle(TimerFired(NewsDue("request")), at))
    assert isinstance(body, clients.TaskNews)
    assert (body.events, body.more, body.messages, body.contracts, body.contracts_at) == ((), False, 1, (), 0)
    assert desk.manager.handle(TimerFired(NewsDue("request")), at) == []


@pytest.mark.parametrize(
    ("wanted", "told"),
    [
        ({"after": 2}, True),
        ({"after": 3}, False),
        ({"after": 3, "messages": 0}, True),
        ({"after": 3, "messages": 1}, False),
        ({"after": 3, "contracts": 0}, True),
        ({"after": 3, "contracts": 1}, False),
    ],
)
def test_who_waits_for_news_is_told_what_is_new(wanted: dict[str, int], told: bool) -> None:
    desk = Desk()
    effects = asked(desk.manager, clients.WatchTask(task=desk.task.id, **wanted))
    assert bool(answers(effects)) is told
    assert [effect for effect in effects if isinstance(effect, SetTimer)] == ([] if told else [SetTimer(NewsDue("request"), 30.0)])


def test_news_number_events_and_contracts() -> None:
    desk = Desk("Robot1", "Robot2")
    (first,) = answers(asked(desk.manager, clients.WatchTask(task=desk.task.id, contracts=0)))
    assert isinstance(first, clients.TaskNews)
    assert [event.number for event in first.events] == [1, 2, 3]
    assert ([contract.number for contract in first.contracts], first.contracts_at, first.messages) == ([1, 2], 2, 2)
    desk.offer(12.0)
    (second,) = answers(asked(desk.manager, clients.WatchTask(task=desk.task.id, after=3, contracts=2), 13.0))
    assert isinstance(second, clients.TaskNews)
    assert [event.number for event in second.events] == [4]
    assert ([contract.number for contract in second.contracts], second.contracts_at) == ([1], 3)


def test_the_list_tells_which_tasks_changed_since() -> None:
    desk = Desk()
    asked(desk.manager, clients.Submit(effect="Jar001 isOn Platform001"), 10.0, "other")
    other = desk.manager.open[1]

    def rows(after: int) -> tuple[list[str], int] | None:
        found = answers(asked(desk.manager, clients.WatchTasks(after=after), 20.0))
        assert all(isinstance(body, clients.TasksNews) and not body.more for body in found)
        return ([row.task for row in found[0].rows], found[0].version) if found and isinstance(found[0], clients.TasksNews) else None

    version = desk.manager.state.subscriptions.version
    assert rows(0) == ([desk.manager.open[0], other], version)
    assert rows(version) is None
    assert rows(version + 5) == ([desk.manager.open[0], other], version)
    assert rows(version - 1) == ([other], version)


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
    desk = Desk()
    desk.executing()
    state, since = desk.manager.state, len(desk.task.events) + 1
    effects = desk.manager.handle(Received(desk.message(frp.Completed(situation=WISH))), 50.0)
    (update,) = [one.message for one in effects if isinstance(one, Send)]
    desk.manager.handle(Received(reply(update, answer, "repository")), 51.0)
    assert state.unsettled == [UnsettledReport(version=2, task=desk.task.id, problems=problems)]
    desk.manager.handle(changed(1), 52.0)
    assert (len(state.unsettled), state.map_version, desk.task.events[since:]) == (1, 1, [])
    desk.manager.handle(changed(2), 53.0)
    assert (state.unsettled, state.map_version) == ([], 2)
    assert [type(one.event).__name__ for one in desk.task.events[since:]][:1] == (["ReportRejected"] if problems else ["Replanned"])


def test_what_was_reported_to_another_store_is_not_waited_for() -> None:
    desk = Desk()
    desk.executing()
    state = desk.manager.state
    state.replica.version = state.map_version = 7
    effects = desk.manager.handle(Received(desk.message(frp.Completed(situation=WISH))), 50.0)
    (update,) = [one.message for one in effects if isinstance(one, Send)]
    desk.manager.handle(Received(reply(update, Updated(version=9), "repository")), 51.0)
    effects = desk.manager.handle(Started("tm"), 52.0)
    objects, facts = tuple(state.replica.map.objects.values()), tuple(state.replica.map.facts())
    for body in (
        MapSubscribed(version=3, until=90.0),
        OntologyPage(definitions=Definitions(), version=3, next=0, more=False),
        MapPage(objects=objects, facts=facts, version=3, more=False),
    ):
        assert len(state.unsettled) == 1
        question = next(one.message for one in effects if isinstance(one, Send) and one.message.header.recipient == "repository")
        effects = desk.manager.handle(Received(reply(question, body, "repository")), 53.0)
    assert (state.unsettled, state.map_version, state.replica.version) == ([], 3, 3)


def test_who_waited_for_the_map_is_served_once_it_is_read() -> None:
    manager, replica = TaskManager("tm", repository="repository", registry="registry"), Desk().replica
    asked(manager, clients.Submit(effect=WISH), 10.0, "first")
    manager.state.replica.ontology, manager.state.replica.map = replica.ontology, replica.map
    manager.handle(changed(3), 11.0)
    assert [*manager.state.awaiting_map] == ["first"], "it is not read yet"
    manager.state.replica.version = 0
    effects = manager.handle(TimerFired(ReplicaDue()), 12.0)
    assert SetTimer(MapDue("first"), None) in effects
    assert [type(body) for body in answers(effects)] == [clients.Submitted]
    assert (manager.state.awaiting_map, len(manager.open)) == ({}, 1)


def test_tasks_are_known_since_the_first_start() -> None:
    desk = Desk()
    for now in (7.0, 9.0):
        desk.manager.handle(Started("tm"), now)
    (news,) = answers(asked(desk.manager, clients.WatchTasks(after=0), 20.0))
    assert isinstance(news, clients.TasksNews)
    assert (news.begun, desk.manager.state.requests.incarnation) == (7.0, 7.0)


# What is kept


def test_the_oldest_tasks_that_are_over_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.task_manager.manager.REMEMBERED", 2)
    desk = Desk()
    first = desk.task.id
    for number, jar in enumerate(("Jar001", "Tin001")):
        asked(desk.manager, clients.Submit(effect=f"{jar} isOn Platform001"), 10.0 + number, jar)
    _, second, third = desk.manager.open
    assert [*desk.manager.state.tasks] == [first, second, third], "none of them is over"
    asked(desk.manager, clients.CancelTask(task=second), 20.0, "cancel")
    assert [*desk.manager.state.tasks] == desk.manager.open == [first, third]
    assert second not in desk.manager.state.subscriptions.changed
    asked(desk.manager, clients.CancelTask(task=first), 21.0, "cancel again")
    assert ([*desk.manager.state.tasks], desk.manager.open) == ([first, third], [third])


def test_more_messages_than_fit_are_behind_those_that_do() -> None:
    manager = Desk().manager
    asked(manager, clients.ReadMessages(task="old"))
    found = records.Records(records=(record("old"),), rest=1)
    (body,) = answers(manager.handle(Answered(RecordsWanted("request"), found), 11.0))
    assert body == clients.Messages(messages=found.records[0].messages, more=True)


@pytest.mark.parametrize(("participant", "sent"), [("p", ["Cancel"]), (None, [])])
def test_who_takes_part_in_nothing_that_is_known_is_sent_home(participant: str | None, sent: list[str]) -> None:
    desk = Desk()
    header = Header(sender="r", recipient="tm", message_id="m", reply_to="r", transaction="no task", participant=participant)
    message = Message(header=header, body=frp.Terms(effect=WISH, price=1.0, duration=1.0))
    assert bodies(desk.manager.handle(Received(message), 5.0)) == sent
    assert desk.manager.handle(DeliveryFailed(message, "no route"), 6.0) == []


def test_what_the_registry_could_not_be_questionis_questionagain() -> None:
    manager = Desk().manager
    effects = asked(manager, clients.Submit(effect="Jar001 isOn Platform001"))
    (discover,) = [one.message for one in effects if isinstance(one, Send) and isinstance(one.message.body, Discover)]
    again = manager.handle(DeliveryFailed(discover, "no route"), 12.0)
    assert [one.message for one in again if isinstance(one, Send)] == [discover]


# What is no task


@pytest.mark.parametrize(
    ("wanted", "fits"),
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
def test_what_a_task_may_be(wanted: dict[str, object], fits: bool) -> None:
    replica: Replica = Desk().replica
    assert (find_task_error(Submit(**{"effect": WISH, **wanted}), replica) is None) is fits  # type: ignore[arg-type]  # fields of Submit
