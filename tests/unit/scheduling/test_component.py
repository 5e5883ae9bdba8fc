"""The Scheduler without sockets and disks: what it is told, and what it says, in order; and how it comes back from its journal."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from zoneinfo import ZoneInfo

import pytest

from somrs.kernel.codec import encode
from somrs.kernel.component import DeliveryFailed, Effect, Input, Notified, Received, Send, Started, TimerFired
from somrs.kernel.durability import JournalCodec, JournaledComponent
from somrs.ontology.files.loading import load_text
from somrs.protocol.messages import orders
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.frp import Fault, Outcome
from somrs.protocol.messages.knowledge import SubscribeMap
from somrs.protocol.messages.orders import Daily, Every, OrderSaved, Run, RunState
from somrs.protocol.messages.records import ReadRecords, Records
from somrs.protocol.messages.submission import Submit, Submitted, TaskRejected
from somrs.protocol.messages.task_news import TaskNews, WatchTask
from somrs.protocol.messages.task_views import Phase, TaskView
from somrs.scheduling.book import Book
from somrs.scheduling.component import SCHEMA, Scheduler
from somrs.scheduling.execution import LATE, WAIT, message_for, task_for
from somrs.scheduling.state import Located, OrdersDue
from tests.support.virtual_system import SITE

SCHEDULER, REPOSITORY, MANAGER, CLIENT = "http://here/scheduler", "http://there/repository", "http://there/task-manager", "http://there/api"
TASK = Submit(effect="Jar002 isOn Platform001")
HOUR = 3600.0
TICK = TimerFired(OrdersDue())


class JournaledScheduler:
    """A Scheduler that has read the map, and its journal."""

    def __init__(self, zone: str = "") -> None:
        self.located = Located(REPOSITORY, MANAGER, zone)
        self._written = JournalCodec(SCHEMA)
        self.journaled = JournaledComponent(Scheduler(SCHEDULER, self.located), SCHEMA)
        loaded = load_text(SITE, "site.yaml")
        assert loaded.map is not None
        self.scheduler.handle(Started(SCHEDULER), 0.0)
        replica = self.scheduler.replica
        replica.ontology, replica.map, replica.version = loaded.ontology, loaded.map, 0
        self._snapshot()

    @property
    def scheduler(self) -> Scheduler:
        assert isinstance(self.journaled.component, Scheduler)
        return self.journaled.component

    @property
    def book(self) -> Book:
        return self.scheduler.book

    def handle(self, event: Input, now: float) -> list[Effect]:
        if SCHEMA.is_read_only(event):
            return self.scheduler.handle(event, now)
        entry = self.journaled.make_entry(event, now)
        self._entries.append(self._written.encode_entry(entry))
        return [effect for effect, _ in self.journaled.handle(entry)]

    def restart(self, now: float, *, orderly: bool = False, located: Located | None = None, address: str = SCHEDULER) -> list[Effect]:
        """As after a kill, or an orderly stop: what is sent again, and what comes of the start."""
        if orderly:
            self._snapshot()
        self.journaled = self._written.decode_snapshot(self._state)
        self.journaled.replay(self._written.decode_batch(self._written.encode_batch(self._entries)))
        effects: list[Effect] = [
            Send(sent_message.message, sent_message.expires_at)
            for sent_message in self.journaled.pending.messages.values()
            if sent_message.expires_at > now
        ]
        for sent_message in [
            pending_message for pending_message in self.journaled.pending.messages.values() if pending_message.expires_at <= now
        ]:
            effects += self.handle(DeliveryFailed(sent_message.message, "its time was over"), now)
        self.handle(Notified(located or self.located), now)
        return [*effects, *self.handle(Started(address), now)]

    def _snapshot(self) -> None:
        self._state = self._written.encode_snapshot(self.journaled)
        self._entries: list[bytes] = []


def scheduler() -> JournaledScheduler:
    return JournaledScheduler()


def ask(target: JournaledScheduler, body: Body, now: float, id: str = "urn:uuid:1") -> Sequence[Effect]:
    header = Header(sender=CLIENT, recipient=SCHEDULER, message_id=id, reply_to=CLIENT)
    return target.handle(Received(Message(header=header, body=body)), now)


def answer(target: JournaledScheduler, question: Message, body: Body, now: float) -> Sequence[Effect]:
    for number, sent_message in [*target.journaled.pending.messages.items()]:
        if sent_message.message == question:
            target.journaled.mark_delivered(number)
    header = Header(sender=MANAGER, recipient=SCHEDULER, message_id=f"{question.header.message_id}a", relates_to=question.header.message_id)
    return target.handle(Received(Message(header=header, body=body)), now)


def sent_messages(effects: Sequence[Effect], kind: type[Body]) -> list[Message]:
    return [effect.message for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, kind)]


def ordered(target: JournaledScheduler, now: float = 0.0, *, skip: bool = True) -> str:
    effects = ask(target, orders.SaveOrder(saved=OrderSaved(name="Often", when=Every(minutes=60), task=TASK, skip=skip)), now)
    (reply,) = sent_messages(effects, orders.OrderKept)
    assert isinstance(reply.body, orders.OrderKept)
    assert reply.body.order.next == now + HOUR
    return reply.body.order.id


def view(task: str, phase: Phase = Phase.EXECUTING, outcome: Outcome | None = None) -> TaskNews:
    return TaskNews(view=TaskView(task=task, effect=TASK.effect, phase=phase, submitted_at=HOUR, outcome=outcome), events=())


def test_a_time_is_noted_and_its_task_is_stated_and_followed_to_its_end() -> None:
    target = scheduler()
    id = ordered(target)
    assert not sent_messages(target.handle(TICK, HOUR - 1), Submit)
    effects: Sequence[Effect] = target.handle(TICK, HOUR)
    task = task_for(id, HOUR)
    assert target.book.runs_of(id) == (Run(due=HOUR, state=RunState.SUBMITTING, at=HOUR, task=task),)
    (stated,) = sent_messages(effects, Submit)
    assert stated.header.message_id == message_for(id, HOUR)
    assert (stated.header.sender, stated.header.reply_to) == ("urn:so-mrs:client:order%20Often", SCHEDULER)
    (watched,) = sent_messages(answer(target, stated, Submitted(task=task), HOUR + 1), WatchTask)
    (second_watch,) = sent_messages(answer(target, watched, view(task), HOUR + 2), WatchTask)
    answer(target, second_watch, view(task, Phase.ENDED, Outcome.ACCOMPLISHED), HOUR + 3)
    (run,) = target.book.runs_of(id)
    assert (run.state, run.outcome, run.open) == (RunState.SUBMITTED, Outcome.ACCOMPLISHED, False)


@pytest.mark.parametrize("orderly", [False, True], ids=["killed", "stopped"])
@pytest.mark.parametrize("step", range(5))
def test_what_was_open_goes_on_and_the_task_is_stated_once(step: int, orderly: bool) -> None:
    """It is restarted behind one of the steps, and the answers that come reach it then."""
    target = scheduler()
    id = ordered(target)
    task, reached = task_for(id, HOUR), 0

    def expect_message(effects: Sequence[Effect], kind: type[Body], now: float) -> Message:
        nonlocal reached
        (question,) = sent_messages(effects, kind)
        if reached == step:
            resent_effects = target.restart(now, orderly=orderly)
            questions = [message for body_type in (Submit, WatchTask, ReadRecords) for message in sent_messages(resent_effects, body_type)]
            assert questions == [question], "nobody acknowledged it yet"
        reached += 1
        return question

    stated = expect_message(target.handle(TICK, HOUR), Submit, HOUR + 0.5)
    assert stated.header.message_id == message_for(id, HOUR)
    watched = expect_message(answer(target, stated, Submitted(task=task), HOUR + 1), WatchTask, HOUR + 1.5)
    second_watch = expect_message(answer(target, watched, view(task), HOUR + 2), WatchTask, HOUR + 2.5)
    searched = expect_message(answer(target, second_watch, Fault(code="Sender", text="no such task"), HOUR + 3), ReadRecords, HOUR + 3.5)
    answer(target, searched, Fault(code="Receiver", text="not now"), HOUR + 4)
    lookup = expect_message(target.handle(TICK, HOUR + 5.5), WatchTask, HOUR + 6)
    answer(target, lookup, view(task, Phase.ENDED, Outcome.ACCOMPLISHED), HOUR + 7)
    (run,) = target.book.runs_of(id)
    assert (run.task, run.outcome, run.open) == (task, Outcome.ACCOMPLISHED, False)
    assert not target.scheduler.state.questions


def test_a_question_that_was_open_too_long_is_asked_again_after_a_restart() -> None:
    for absence, state in ((LATE / 2, RunState.SUBMITTING), (LATE + 1, RunState.MISSED)):
        target = scheduler()
        id = ordered(target)
        (first,) = sent_messages(target.handle(TICK, HOUR), Submit)
        now = HOUR + absence
        effects = target.restart(now)
        if state is RunState.SUBMITTING:
            assert sent_messages(effects, Submit) == [first], "its time is not over"
            continue
        (lookup,) = sent_messages(target.handle(TICK, now + 2), WatchTask)
        (searched,) = sent_messages(answer(target, lookup, Fault(code="Sender", text="no such task"), now + 3), ReadRecords)
        assert not sent_messages(answer(target, searched, Records(records=()), now + 4), Submit)
        assert [run.state for run in target.book.runs_of(id)] == [state]


def test_a_task_that_was_not_taken_is_stated_again_as_the_same_message() -> None:
    target = scheduler()
    id = ordered(target)
    (first,) = sent_messages(target.handle(TICK, HOUR), Submit)
    target.handle(DeliveryFailed(first, "nobody is there"), HOUR + 1)
    (lookup,) = sent_messages(target.handle(TICK, HOUR + 3), WatchTask)
    (searched,) = sent_messages(answer(target, lookup, Fault(code="Sender", text="no such task"), HOUR + 4), ReadRecords)
    (resubmitted,) = sent_messages(answer(target, searched, Records(records=()), HOUR + 5), Submit)
    assert resubmitted.header.message_id == first.header.message_id == message_for(id, HOUR)


def test_what_was_due_while_it_was_away_is_stated_at_the_start_or_told_as_missed() -> None:
    for absence, stated, missed in ((30.0, 1, 0), (LATE + 30, 0, 1), (4 * HOUR + 30, 1, 4)):
        for orderly in (False, True):
            target = scheduler()
            id = ordered(target)
            effects = target.restart(HOUR + absence, orderly=orderly)
            assert len(sent_messages(effects, Submit)) == stated
            assert sum(run.times for run in target.book.runs_of(id) if run.state is RunState.MISSED) == missed


def test_a_time_of_day_that_was_stated_is_not_stated_again_in_another_zone() -> None:
    """What came before a kill is handled again by the local time of then."""
    berlin = ZoneInfo("Europe/Berlin")
    start_time, due = (datetime(2026, 11, 23, hour, tzinfo=berlin).timestamp() for hour in (6, 7))
    for orderly in (False, True):
        target = JournaledScheduler("Europe/Berlin")
        target.handle(Notified(target.located), start_time)
        ask(target, orders.SaveOrder(saved=OrderSaved(name="Daily", when=Daily(at="07:00"), task=TASK)), start_time)
        (id,) = target.book.orders
        assert sent_messages(target.handle(TICK, due), Submit)
        book_before = target.book
        effects = target.restart(due + 1, orderly=orderly, located=Located(REPOSITORY, MANAGER, "Europe/London"))
        assert target.book == book_before
        assert [message.header.message_id for message in sent_messages(effects, Submit)] == [message_for(id, due)], (
            "it was not acknowledged"
        )
        next_due = datetime(2026, 11, 23, 7, tzinfo=ZoneInfo("Europe/London")).timestamp()
        assert target.scheduler.next_due == next_due, "times to come are by the local time of now"


def test_the_other_parts_may_be_elsewhere_and_so_may_it() -> None:
    target = scheduler()
    ordered(target)
    moved = Located("http://new/repository", "http://new/task-manager")
    effects = target.restart(1.0, located=moved, address="http://new/scheduler")
    (followed,) = sent_messages(effects, SubscribeMap)
    assert (followed.header.recipient, followed.header.sender) == ("http://new/repository", "http://new/scheduler")
    assert not sent_messages(target.handle(TICK, HOUR), Submit), "the map there was not read yet"
    target = scheduler()
    ordered(target)
    target.restart(1.0, located=Located(REPOSITORY, "http://new/task-manager"), address="http://new/scheduler")
    (stated,) = sent_messages(target.handle(TICK, HOUR), Submit)
    assert (stated.header.recipient, stated.header.reply_to) == ("http://new/task-manager", "http://new/scheduler")


def test_who_does_not_answer_is_asked_again() -> None:
    target = scheduler()
    id = ordered(target)
    (stated,) = sent_messages(target.handle(TICK, HOUR), Submit)
    target.handle(DeliveryFailed(stated, "nobody is there"), HOUR + LATE)
    (lookup,) = sent_messages(target.handle(TICK, HOUR + LATE + 2), WatchTask)
    (second_lookup,) = sent_messages(target.handle(TICK, HOUR + LATE + 2 + WAIT), WatchTask)
    assert second_lookup.header.message_id != lookup.header.message_id
    answer(target, second_lookup, view(task_for(id, HOUR), Phase.ENDED, Outcome.FAILED), HOUR + 200)
    assert target.book.runs_of(id)[0].outcome is Outcome.FAILED


def test_while_the_task_before_runs_a_time_is_skipped_unless_the_order_says_otherwise() -> None:
    for skip in (True, False):
        target = scheduler()
        id = ordered(target, skip=skip)
        (stated,) = sent_messages(target.handle(TICK, HOUR), Submit)
        answer(target, stated, Submitted(task=task_for(id, HOUR)), HOUR + 1)
        effects = target.handle(TICK, 2 * HOUR)
        if skip:
            *_, lookup = sent_messages(effects, WatchTask)  # the last: also the one that follows it was not answered for long
            answer(target, lookup, view(task_for(id, HOUR)), 2 * HOUR + 1)
        assert target.book.runs_of(id)[-1].state is (RunState.SKIPPED if skip else RunState.SUBMITTING)


def test_what_cannot_be_stated_is_refused_and_what_was_slept_through_is_missed() -> None:
    target = scheduler()
    id = ordered(target)
    (stated,) = sent_messages(target.handle(TICK, HOUR), Submit)
    answer(target, stated, TaskRejected(problem="there is no Platform001"), HOUR + 1)
    assert [(run.state, run.note) for run in target.book.runs_of(id)] == [(RunState.REFUSED, "there is no Platform001")]
    assert not sent_messages(target.handle(TICK, 5 * HOUR + LATE + 1), Submit)
    run = target.book.runs_of(id)[-1]
    assert (run.state, run.due, run.times) == (RunState.MISSED, 5 * HOUR, 4)


def test_subscribers_hear_of_changes_and_refusals_say_their_sort() -> None:
    target = scheduler()
    assert sent_messages(ask(target, orders.SubscribeOrders(lease=30.0), 0.0), orders.OrdersSubscribed)
    effects = ask(target, orders.SaveOrder(saved=OrderSaved(name="Often", when=Every(minutes=60), task=TASK)), 1.0)
    (news,) = sent_messages(effects, orders.OrdersChanged)
    assert news.body == orders.OrdersChanged(orders=True)
    target.handle(DeliveryFailed(news, "it is gone"), 2.0)
    assert not sent_messages(ask(target, orders.RemoveOrder(id=next(iter(target.book.orders))), 3.0), orders.OrdersChanged)
    (wrong,) = sent_messages(ask(target, orders.ReadTemplates(name="Nothing"), 3.0), orders.OrdersRejected)
    assert isinstance(wrong.body, orders.OrdersRejected)
    assert wrong.body.error == "NotFound"
    saved = orders.TemplateSaved(task=Submit(effect="{Thing} isOn Nowhere"), blanks=(orders.Blank(name="Thing"),))
    (wrong,) = sent_messages(ask(target, orders.SaveTemplate(name="Bring", saved=saved), 3.0), orders.OrdersRejected)
    assert isinstance(wrong.body, orders.OrdersRejected)
    assert wrong.body.error == "FormulaError"
    assert wrong.body.position is not None


def test_the_same_message_is_the_same_order() -> None:
    target = scheduler()
    save = orders.SaveOrder(saved=OrderSaved(name="Often", when=Every(minutes=60), task=TASK))
    ask(target, save, 0.0)
    ask(target, save, 1.0)
    ask(target, save, 2.0, id="urn:uuid:2")
    assert len(target.book.orders) == 2


def test_what_only_reads_leaves_it_as_it_is() -> None:
    target = scheduler()
    id = ordered(target)
    state_before = encode(target.scheduler.state)
    for body in (orders.ReadOrders(), orders.ReadRuns(id=id), orders.ReadTemplates()):
        header = Header(sender=CLIENT, recipient=SCHEDULER, message_id="urn:uuid:9", reply_to=ANONYMOUS)
        (effect,) = target.handle(Received(Message(header=header, body=body)), 2 * HOUR)
        assert isinstance(effect, Send)
    assert encode(target.scheduler.state) == state_before


def test_news_go_on_after_a_restart() -> None:
    target = scheduler()
    ask(target, orders.SubscribeOrders(lease=30.0), 0.0)
    (first,) = sent_messages(
        ask(target, orders.SaveOrder(saved=OrderSaved(name="Often", when=Every(minutes=60), task=TASK)), 1.0), orders.OrdersChanged
    )
    target.restart(2.0)
    (second,) = sent_messages(ask(target, orders.RemoveOrder(id=next(iter(target.book.orders))), 3.0), orders.OrdersChanged)
    assert first.header.message_id != second.header.message_id
    (subscribed,) = sent_messages(ask(target, orders.SubscribeOrders(lease=30.0), 4.0), orders.OrdersSubscribed)
    assert subscribed.body == orders.OrdersSubscribed(until=34.0, begun=2.0), "whoever missed news then learns of it"
