"""Who waits for news of tasks, and what they hear."""

from __future__ import annotations

import math

import pytest
from msgspec import structs

from somrs.entish.parse import parse
from somrs.kernel.component import SetTimer
from somrs.planner.model.plan import Step
from somrs.protocol.messages import events, frp
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_news import TaskNews, TasksNews, WatchTask, WatchTasks
from somrs.task_manager.execution.execution_log import Work
from somrs.task_manager.subscriptions import Replies, Subscriptions, TaskSubscriptions
from somrs.task_manager.timers import NewsDue
from somrs.task_manager.transaction.state import GoalExecution, LoggedEvent, TaskState
from somrs.task_manager.transaction.views import event_view, view
from tests.unit.task_manager.execution.test_participants import WORK, TransactionHarness

LONG = "x" * 15_000
"""Two go on a page, and not three."""


def task(id: str = "a", effect: str = "Jar1.Clean = TRUE") -> TaskState:
    goal = GoalExecution.create(id, 1, effect, GoalKind.TASK)
    return TaskState(id=id, task=Submit(effect=effect), submitted_at=1.0, client="client", goal=goal)


def request(body: Body, id: str = "request") -> Message:
    return Message(header=Header(sender="client", recipient="tm", message_id=id, reply_to="client"), body=body)


def make_subscriptions(*tasks: TaskState) -> tuple[Subscriptions, TaskSubscriptions]:
    state = Subscriptions()
    return state, TaskSubscriptions(state, {task.id: task for task in tasks})


def answers(reply: Replies) -> list[Body]:
    return [entry[1] for entry in reply if not isinstance(entry, SetTimer)]


def watch_answers(subscriptions: TaskSubscriptions, query: WatchTask | WatchTasks) -> list[Body]:
    return [*answers(subscriptions.wait(request(query), query, 0.0)), *answers(subscriptions.timer_fired("request"))]


def news(task: TaskState, query: WatchTask) -> TaskNews:
    """What one hears at once, or when the time is over."""
    _, subscriptions = make_subscriptions(task)
    (answer,) = watch_answers(subscriptions, query)
    assert isinstance(answer, TaskNews)
    return answer


def rows(subscriptions: TaskSubscriptions, known_version: int) -> TasksNews:
    query = WatchTasks(after=known_version)
    (answer,) = watch_answers(subscriptions, query)
    assert isinstance(answer, TasksNews)
    return answer


def row_summary(subscriptions: TaskSubscriptions, known_version: int) -> tuple[list[str], int, bool]:
    page = rows(subscriptions, known_version)
    return [row.task for row in page.rows], page.version, page.more


def test_since_when_tasks_are_known_is_kept() -> None:
    state, subscriptions = make_subscriptions(task())
    state.start(5.0)
    state.start(9.0)
    assert state.started_at == 5.0
    assert rows(subscriptions, 0) == TasksNews(rows=(), version=0, begun=5.0)


@pytest.mark.parametrize(("wait", "fire_time"), [(5.0, 105.0), (60.0, 160.0), (61.0, 160.0), (math.inf, 160.0), (math.nan, 160.0)])
@pytest.mark.parametrize("query_type", [WatchTask, WatchTasks])
def test_a_client_waits_as_long_as_it_wants_and_a_minute_at_most(query_type: type, wait: float, fire_time: float) -> None:
    state, subscriptions = make_subscriptions(task())
    body = WatchTask(task="a", wait=wait) if query_type is WatchTask else WatchTasks(wait=wait)
    assert [*subscriptions.wait(request(body), body, 100.0)] == [SetTimer(NewsDue("request"), fire_time)]
    assert [(id, watcher.request, watcher.query) for id, watcher in state.watchers.items()] == [("request", request(body), body)]


@pytest.mark.parametrize("wait", [0.0, -1.0])
@pytest.mark.parametrize("body", [WatchTask(task="a"), WatchTasks()])
def test_who_does_not_want_to_wait_is_answered_at_once(body: WatchTask | WatchTasks, wait: float) -> None:
    state, subscriptions = make_subscriptions(task())
    query = structs.replace(body, wait=wait)
    (answer,) = answers(subscriptions.wait(request(query), query, 100.0))
    assert isinstance(answer, TaskNews | TasksNews)
    assert state.watchers == {}


def test_when_the_time_is_over_a_client_hears_that_there_is_nothing_and_waits_no_more() -> None:
    watched_task = task()
    state, subscriptions = make_subscriptions(watched_task)
    query = WatchTask(task="a")
    assert answers(subscriptions.wait(request(query), query, 0.0)) == []
    assert [*subscriptions.timer_fired("request")] == [(request(query), TaskNews(view=view(watched_task), events=()))]
    assert state.watchers == {}
    assert [*subscriptions.timer_fired("request")] == []


def test_who_waits_hears_what_happened_and_others_wait_on() -> None:
    first_task, second_task = task("a"), task("b")
    state, subscriptions = make_subscriptions(first_task, second_task)
    for id in ("a", "b"):
        query = WatchTask(task=id)
        assert answers(subscriptions.wait(request(query, id), query, 0.0)) == []
    list_query = WatchTasks()
    assert answers(subscriptions.wait(request(list_query, "all"), list_query, 0.0)) == []
    assert [*subscriptions.notify_watchers({})] == []
    first_task.events.append(LoggedEvent(3.0, events.Planned(steps=1), "step1", GoalKind.TASK))
    touched: dict[str, None] = {"a": None, "gone": None}
    replies = [*subscriptions.notify_watchers(touched)]
    assert replies[0] == SetTimer(NewsDue("a"), None)
    assert replies[1] == (request(WatchTask(task="a"), "a"), TaskNews(view=view(first_task), events=(event_view(1, first_task.events[0]),)))
    assert replies[2] == SetTimer(NewsDue("all"), None)
    assert [entry[1] for entry in replies if not isinstance(entry, SetTimer)][1] == rows(subscriptions, 0)
    assert len(replies) == 4
    assert ([*state.watchers], touched, state.version, state.changed) == (["b"], {}, 1, {"a": 1})


def test_tasks_are_heard_of_in_the_order_in_which_they_changed_last() -> None:
    state, subscriptions = make_subscriptions(*(task(id) for id in "abc"))
    for id in "abca":
        assert answers(subscriptions.notify_watchers({id: None})) == []
    assert state.changed == {"b": 2, "c": 3, "a": 4}
    assert row_summary(subscriptions, 0) == (["b", "c", "a"], 4, False)
    assert row_summary(subscriptions, 2) == (["c", "a"], 4, False)
    assert row_summary(subscriptions, 3) == (["a"], 4, False)
    assert row_summary(subscriptions, 4) == ([], 4, False)
    assert row_summary(subscriptions, 5) == (["b", "c", "a"], 4, False), "what it heard of is forgotten"
    state.forget("c")
    state.forget("nobody")
    assert row_summary(subscriptions, 0) == (["b", "a"], 4, False)
    assert [*subscriptions.notify_watchers({"b": None, "a": None})] == []
    assert row_summary(subscriptions, 4) == (["b", "a"], 6, False)


@pytest.mark.parametrize(("known_version", "waits"), [(0, False), (1, True), (2, False)])
def test_who_heard_of_other_changes_than_there_were_hears_at_once(known_version: int, waits: bool) -> None:
    _, subscriptions = make_subscriptions(task())
    assert [*subscriptions.notify_watchers({"a": None})] == []
    query = WatchTasks(after=known_version)
    assert (answers(subscriptions.wait(request(query), query, 0.0)) == []) is waits


def test_what_does_not_fit_a_message_comes_with_the_next() -> None:
    _, subscriptions = make_subscriptions(*(task(id, LONG) for id in "abc"))
    assert [*subscriptions.notify_watchers({"a": None, "b": None, "c": None})] == []
    assert row_summary(subscriptions, 0) == (["a", "b"], 2, True)
    assert row_summary(subscriptions, 2) == (["c"], 3, False)


@pytest.mark.parametrize(
    ("query", "expects_news"),
    [
        (WatchTask(task="a", after=2), False),
        (WatchTask(task="a", after=1), True),
        (WatchTask(task="a", after=2, messages=3, contracts=4), False),
        (WatchTask(task="a", after=2, messages=2), True),
        (WatchTask(task="a", after=2, contracts=3), True),
        (WatchTask(task="a", after=3, messages=0), True),
    ],
)
@pytest.mark.parametrize("ended", [False, True])
def test_there_is_news_when_there_is_more_than_a_client_knows(query: WatchTask, expects_news: bool, ended: bool) -> None:
    watched_task = task()
    watched_task.events += [LoggedEvent(1.0, events.Planned(steps=1)), LoggedEvent(2.0, events.Planned(steps=2))]
    watched_task.message_count, watched_task.members.change_count = 3, 4
    watched_task.outcome = Outcome.FAILED if ended else None
    _, subscriptions = make_subscriptions(watched_task)
    assert (answers(subscriptions.wait(request(query), query, 0.0)) != []) is (expects_news or ended)


@pytest.mark.parametrize(("event_offset", "numbers"), [(-1, [1, 2, 3]), (0, [1, 2, 3]), (1, [2, 3]), (3, []), (9, [])])
def test_of_a_task_the_events_are_told_that_come_behind(event_offset: int, numbers: list[int]) -> None:
    watched_task = task()
    watched_task.events += [LoggedEvent(float(number), events.Planned(steps=number)) for number in range(3)]
    watched_task.message_count = 7
    answer = news(watched_task, WatchTask(task="a", after=event_offset))
    assert answer == TaskNews(
        view=view(watched_task), events=tuple(event_view(number, watched_task.events[number - 1]) for number in numbers), messages=7
    )


def test_events_come_as_far_as_they_fit_beside_the_task() -> None:
    watched_task = task(effect=LONG)
    watched_task.events += [
        LoggedEvent(1.0, events.ProgressNoted(service="s", note="x" * 7_000)) for _ in range(4)
    ]  # each said twice: for people, too
    answer = news(watched_task, WatchTask(task="a", contracts=0))
    assert ([event.number for event in answer.events], answer.more, answer.contracts) == ([1], True, ())
    answer = news(watched_task, WatchTask(task="a", after=3))
    assert ([event.number for event in answer.events], answer.more) == ([4], False)


def participants(watched_task: TaskState) -> None:
    """Three, of whom the first changed last."""
    transaction = TransactionHarness()
    watched_task.members = transaction.members
    first = transaction.invited()
    for _ in range(2):
        transaction.invited()
    transaction.member_says(first, frp.Terms(effect="", price=5.0, duration=30.0))


@pytest.mark.parametrize(
    ("contracts", "outcome", "numbers", "change_number"),
    [
        (None, None, [], 0),
        (0, None, [2, 3, 1], 4),
        (2, None, [3, 1], 4),
        (3, None, [1], 4),
        (4, None, [], 4),
        (2, Outcome.FAILED, [], 2),
    ],
)
def test_contracts_are_told_in_the_order_in_which_they_changed(
    contracts: int | None, outcome: Outcome | None, numbers: list[int], change_number: int
) -> None:
    watched_task = task()
    participants(watched_task)
    watched_task.outcome = outcome
    answer = news(watched_task, WatchTask(task="a", contracts=contracts))
    assert ([contract.number for contract in answer.contracts], answer.contracts_at, answer.more) == (numbers, change_number, False)


def test_contracts_come_as_far_as_they_fit_beside_the_events() -> None:
    watched_task = task()
    participants(watched_task)
    for member in watched_task.members:
        member.exit_reason = "x" * 9_000
    watched_task.events.append(LoggedEvent(1.0, events.ProgressNoted(service="s", note="x" * 9_000)))
    answer = news(watched_task, WatchTask(task="a", contracts=0))
    assert ([contract.number for contract in answer.contracts], answer.contracts_at, answer.more) == ([2, 3], 3, True)
    watched_task.task = Submit(effect=LONG)
    answer = news(watched_task, WatchTask(task="a", after=1, contracts=0))
    assert ([contract.number for contract in answer.contracts], answer.contracts_at, answer.more) == ([2, 3], 3, True)
    answer = news(watched_task, WatchTask(task="a", after=1, contracts=3))
    assert ([contract.number for contract in answer.contracts], answer.contracts_at, answer.more) == ([1], 4, False)


@pytest.mark.parametrize(("parts", "steps", "rest"), [(-1, 2, 2), (0, 2, 2), (1, 2, None), (2, 1, None)])
def test_a_task_that_is_too_long_for_a_message_comes_in_parts_before_anything_else(parts: int, steps: int, rest: int | None) -> None:
    watched_task = task()
    participants(watched_task)
    watched_task.events.append(LoggedEvent(1.0, events.Planned(steps=3)))
    watched_task.message_count = 7
    step = Step("step1", "Work", {}, parse("Jar1.Clean = TRUE"))
    watched_task.log.works += [
        Work(
            number=number,
            label="step1",
            key="step1",
            step=step,
            service_type=WORK,
            participant="p",
            service="s",
            provider="r",
            started_at=1.0,
            state=State.COMPLETED,
            situation=LONG,
        )
        for number in range(3)
    ]
    answer = news(watched_task, WatchTask(task="a", contracts=2, parts=parts))
    assert (len(answer.view.work), answer.rest, answer.messages) == (steps, rest, 7)
    summary = len(answer.events), answer.more, answer.contracts_at, len(answer.contracts)
    assert summary == ((0, True, 2, 0) if rest is not None else (1, False, 4, 2))
