"""Who waits for news of tasks, and what they hear."""

from __future__ import annotations

import math

import pytest

from somrs.entish.parse import parse
from somrs.kernel.component import SetTimer
from somrs.planner.model.plan import Step
from somrs.protocol.messages import events, frp
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import Submit, TaskNews, TasksNews, WatchTask, WatchTasks
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.events import GoalKind
from somrs.protocol.messages.frp import Outcome, State
from somrs.task_manager.execution.execution_log import Work
from somrs.task_manager.subscriptions import Replies, Subscriptions, TaskSubscriptions
from somrs.task_manager.timers import NewsDue
from somrs.task_manager.transaction.state import GoalExecution, LoggedEvent, TaskState
from somrs.task_manager.transaction.views import event_view, view
from tests.unit.task_manager.execution.test_participants import WORK, Table

LONG = "x" * 15_000
"""Two go on a page, and not three."""


def task(id: str = "a", effect: str = "Jar1.Clean = TRUE") -> TaskState:
    goal = GoalExecution.create(id, 1, effect, GoalKind.TASK)
    return TaskState(id=id, task=Submit(effect=effect), submitted_at=1.0, client="client", goal=goal)


def request(body: Body, id: str = "request") -> Message:
    return Message(header=Header(sender="client", recipient="tm", message_id=id, reply_to="client"), body=body)


def watching(*tasks: TaskState) -> tuple[Subscriptions, TaskSubscriptions]:
    state = Subscriptions()
    return state, TaskSubscriptions(state, {task.id: task for task in tasks})


def answers(reply: Replies) -> list[Body]:
    return [one[1] for one in reply if not isinstance(one, SetTimer)]


def asked(subscriptions: TaskSubscriptions, wanted: WatchTask | WatchTasks) -> list[Body]:
    return [*answers(subscriptions.wait(request(wanted), wanted, 0.0)), *answers(subscriptions.timer_fired("request"))]


def news(task: TaskState, wanted: WatchTask) -> TaskNews:
    """What one hears at once, or when the time is over."""
    _, subscriptions = watching(task)
    (answer,) = asked(subscriptions, wanted)
    assert isinstance(answer, TaskNews)
    return answer


def rows(subscriptions: TaskSubscriptions, after: int) -> TasksNews:
    wanted = WatchTasks(after=after)
    (answer,) = asked(subscriptions, wanted)
    assert isinstance(answer, TasksNews)
    return answer


def heard(subscriptions: TaskSubscriptions, after: int) -> tuple[list[str], int, bool]:
    found = rows(subscriptions, after)
    return [row.task for row in found.rows], found.version, found.more


def test_since_when_tasks_are_known_is_kept() -> None:
    state, subscriptions = watching(task())
    state.start(5.0)
    state.start(9.0)
    assert state.started_at == 5.0
    assert rows(subscriptions, 0) == TasksNews(rows=(), version=0, begun=5.0)


@pytest.mark.parametrize(
    ("wait", "until"), [(5.0, 105.0), (0.0, 100.0), (-1.0, 100.0), (60.0, 160.0), (61.0, 160.0), (math.inf, 160.0), (math.nan, 160.0)]
)
@pytest.mark.parametrize("wanted", [WatchTask, WatchTasks])
def test_a_client_waits_as_long_as_it_wants_and_a_minute_at_most(wanted: type, wait: float, until: float) -> None:
    state, subscriptions = watching(task())
    body = WatchTask(task="a", wait=wait) if wanted is WatchTask else WatchTasks(wait=wait)
    assert [*subscriptions.wait(request(body), body, 100.0)] == [SetTimer(NewsDue("request"), until)]
    assert [(id, watcher.request, watcher.query) for id, watcher in state.watchers.items()] == [("request", request(body), body)]


def test_when_the_time_is_over_a_client_hears_that_there_is_nothing_and_waits_no_more() -> None:
    one = task()
    state, subscriptions = watching(one)
    wanted = WatchTask(task="a")
    assert answers(subscriptions.wait(request(wanted), wanted, 0.0)) == []
    assert [*subscriptions.timer_fired("request")] == [(request(wanted), TaskNews(view=view(one), events=()))]
    assert state.watchers == {}
    assert [*subscriptions.timer_fired("request")] == []


def test_who_waits_hears_what_happened_and_others_wait_on() -> None:
    one, other = task("a"), task("b")
    state, subscriptions = watching(one, other)
    for id in ("a", "b"):
        wanted = WatchTask(task=id)
        assert answers(subscriptions.wait(request(wanted, id), wanted, 0.0)) == []
    everything = WatchTasks()
    assert answers(subscriptions.wait(request(everything, "all"), everything, 0.0)) == []
    assert [*subscriptions.notify_watchers({})] == []
    one.events.append(LoggedEvent(3.0, events.Planned(steps=1), "step1", GoalKind.TASK))
    touched: dict[str, None] = {"a": None, "gone": None}
    told = [*subscriptions.notify_watchers(touched)]
    assert told[0] == SetTimer(NewsDue("a"), None)
    assert told[1] == (request(WatchTask(task="a"), "a"), TaskNews(view=view(one), events=(event_view(1, one.events[0]),)))
    assert told[2] == SetTimer(NewsDue("all"), None)
    assert [one[1] for one in told if not isinstance(one, SetTimer)][1] == rows(subscriptions, 0)
    assert len(told) == 4
    assert ([*state.watchers], touched, state.version, state.changed) == (["b"], {}, 1, {"a": 1})


def test_tasks_are_heard_of_in_the_order_in_which_they_changed_last() -> None:
    state, subscriptions = watching(*(task(id) for id in "abc"))
    for id in "abca":
        assert answers(subscriptions.notify_watchers({id: None})) == []
    assert state.changed == {"b": 2, "c": 3, "a": 4}
    assert heard(subscriptions, 0) == (["b", "c", "a"], 4, False)
    assert heard(subscriptions, 2) == (["c", "a"], 4, False)
    assert heard(subscriptions, 3) == (["a"], 4, False)
    assert heard(subscriptions, 4) == ([], 4, False)
    assert heard(subscriptions, 5) == (["b", "c", "a"], 4, False), "what it heard of is forgotten"
    state.forget("c")
    state.forget("nobody")
    assert heard(subscriptions, 0) == (["b", "a"], 4, False)
    assert [*subscriptions.notify_watchers({"b": None, "a": None})] == []
    assert heard(subscriptions, 4) == (["b", "a"], 6, False)


@pytest.mark.parametrize(("after", "waits"), [(0, False), (1, True), (2, False)])
def test_who_heard_of_other_changes_than_there_were_hears_at_once(after: int, waits: bool) -> None:
    _, subscriptions = watching(task())
    assert [*subscriptions.notify_watchers({"a": None})] == []
    wanted = WatchTasks(after=after)
    assert (answers(subscriptions.wait(request(wanted), wanted, 0.0)) == []) is waits


def test_what_does_not_fit_a_message_comes_with_the_next() -> None:
    _, subscriptions = watching(*(task(id, LONG) for id in "abc"))
    assert [*subscriptions.notify_watchers({"a": None, "b": None, "c": None})] == []
    assert heard(subscriptions, 0) == (["a", "b"], 2, True)
    assert heard(subscriptions, 2) == (["c"], 3, False)


@pytest.mark.parametrize(
    ("wanted", "told"),
    [
        (WatchTask(task="a", after=2), False),
        (WatchTask(task="a", after=1), True),
        (WatchTask(task="a", after=2, messages=3, contracts=4), False),
        (WatchTask(task="a", after=2, messages=2), True),
        (WatchTask(task="a", after=2, contracts=3), True),
        (WatchTask(task="a", after=3, messages=0), True),
    ],
)
@pytest.mark.parametrize("over", [False, True])
def test_there_is_news_when_there_is_more_than_a_client_knows(wanted: WatchTask, told: bool, over: bool) -> None:
    one = task()
    one.events += [LoggedEvent(1.0, events.Planned(steps=1)), LoggedEvent(2.0, events.Planned(steps=2))]
    one.message_count, one.members.change_count = 3, 4
    one.outcome = Outcome.FAILED if over else None
    _, subscriptions = watching(one)
    assert (answers(subscriptions.wait(request(wanted), wanted, 0.0)) != []) is (told or over)


@pytest.mark.parametrize(("after", "numbers"), [(-1, [1, 2, 3]), (0, [1, 2, 3]), (1, [2, 3]), (3, []), (9, [])])
def test_of_a_task_the_events_are_told_that_come_behind(after: int, numbers: list[int]) -> None:
    one = task()
    one.events += [LoggedEvent(float(number), events.Planned(steps=number)) for number in range(3)]
    one.message_count = 7
    found = news(one, WatchTask(task="a", after=after))
    assert found == TaskNews(view=view(one), events=tuple(event_view(number, one.events[number - 1]) for number in numbers), messages=7)


def test_events_come_as_far_as_they_fit_beside_the_task() -> None:
    one = task(effect=LONG)
    one.events += [
        LoggedEvent(1.0, events.ProgressNoted(service="s", note="x" * 7_000)) for _ in range(4)
    ]  # each said twice: for people, too
    found = news(one, WatchTask(task="a", contracts=0))
    assert ([event.number for event in found.events], found.more, found.contracts) == ([1], True, ())
    found = news(one, WatchTask(task="a", after=3))
    assert ([event.number for event in found.events], found.more) == ([4], False)


def participants(one: TaskState) -> None:
    """Three, of whom the first changed last."""
    table = Table()
    one.members = table.members
    first = table.invited()
    for _ in range(2):
        table.invited()
    table.says(first, frp.Terms(effect="", price=5.0, duration=30.0))


@pytest.mark.parametrize(
    ("contracts", "outcome", "numbers", "at"),
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
    contracts: int | None, outcome: Outcome | None, numbers: list[int], at: int
) -> None:
    one = task()
    participants(one)
    one.outcome = outcome
    found = news(one, WatchTask(task="a", contracts=contracts))
    assert ([contract.number for contract in found.contracts], found.contracts_at, found.more) == (numbers, at, False)


def test_contracts_come_as_far_as_they_fit_beside_the_events() -> None:
    one = task()
    participants(one)
    for member in one.members:
        member.exit_reason = "x" * 9_000
    one.events.append(LoggedEvent(1.0, events.ProgressNoted(service="s", note="x" * 9_000)))
    found = news(one, WatchTask(task="a", contracts=0))
    assert ([contract.number for contract in found.contracts], found.contracts_at, found.more) == ([2, 3], 3, True)
    one.task = Submit(effect=LONG)
    found = news(one, WatchTask(task="a", after=1, contracts=0))
    assert ([contract.number for contract in found.contracts], found.contracts_at, found.more) == ([2, 3], 3, True)
    found = news(one, WatchTask(task="a", after=1, contracts=3))
    assert ([contract.number for contract in found.contracts], found.contracts_at, found.more) == ([1], 4, False)


@pytest.mark.parametrize(("parts", "steps", "rest"), [(-1, 2, 2), (0, 2, 2), (1, 2, None), (2, 1, None)])
def test_a_task_that_is_too_long_for_a_message_comes_in_parts_before_anything_else(parts: int, steps: int, rest: int | None) -> None:
    one = task()
    participants(one)
    one.events.append(LoggedEvent(1.0, events.Planned(steps=3)))
    one.message_count = 7
    step = Step("step1", "Work", {}, parse("Jar1.Clean = TRUE"))
    one.log.works += [
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
    found = news(one, WatchTask(task="a", contracts=2, parts=parts))
    assert (len(found.view.work), found.rest, found.messages) == (steps, rest, 7)
    said = len(found.events), found.more, found.contracts_at, len(found.contracts)
    assert said == ((0, True, 2, 0) if rest is not None else (1, False, 4, 2))
