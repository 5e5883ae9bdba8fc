"""The Scheduler without sockets and disks: what it is told, and what it says, in order."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from somrs.kernel.component import Effect, Rang, Received, Record, Send, Started, Undelivered
from somrs.ontology.files.loading import load_text
from somrs.protocol.messages import orders
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import Phase, Submit, Submitted, TaskNews, TaskRejected, TaskView, WatchTask
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Fault, Outcome
from somrs.protocol.messages.orders import Every, OrderSaved, Run, RunState
from somrs.protocol.messages.records import ReadRecords, Records
from somrs.scheduling.book import Book, BookChange, RunNoted
from somrs.scheduling.component import TICK, Scheduler
from somrs.scheduling.execution import LATE, WAIT, message_for, task_for
from tests.support.virtual_system import SITE

HERE, MANAGER, CLIENT = "http://here/scheduler", "http://there/task-manager", "http://there/api"
WISH = Submit(effect="Jar002 isOn Platform001")
HOUR = 3600.0


def scheduler(book: Book | None = None) -> Scheduler:
    """One that has read the map."""
    made = Scheduler(HERE, "http://there/repository", MANAGER, book or Book())
    loaded = load_text(SITE, "site.yaml")
    assert loaded.map is not None
    made.handle(Started(HERE), 0.0)
    made.replica.ontology, made.replica.map, made.replica.version = loaded.ontology, loaded.map, 0
    return made


def ask(to: Scheduler, body: Body, now: float, id: str = "urn:uuid:1") -> Sequence[Effect]:
    header = Header(sender=CLIENT, recipient=HERE, message_id=id, reply_to=CLIENT)
    return to.handle(Received(Message(header=header, body=body)), now)


def answer(to: Scheduler, question: Message, body: Body, now: float) -> Sequence[Effect]:
    header = Header(sender=MANAGER, recipient=HERE, message_id=f"{question.header.message_id}a", relates_to=question.header.message_id)
    return to.handle(Received(Message(header=header, body=body)), now)


def sent(effects: Sequence[Effect], kind: type[Body]) -> list[Message]:
    return [effect.message for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, kind)]


def kept(effects: Sequence[Effect]) -> list[object]:
    return [effect.entry for effect in effects if isinstance(effect, Record)]


def ordered(to: Scheduler, now: float = 0.0, *, skip: bool = True) -> str:
    effects = ask(to, orders.SaveOrder(saved=OrderSaved(name="Often", when=Every(minutes=60), task=WISH, skip=skip)), now)
    (entry,) = kept(effects)
    assert isinstance(entry, BookChange)
    (said,) = sent(effects, orders.OrderKept)
    assert effects.index(Record(entry)) < effects.index(Send(said)), "it is on disk before it is said"
    assert isinstance(said.body, orders.OrderKept)
    assert said.body.order.next == now + HOUR
    return said.body.order.id


def view(task: str, phase: Phase = Phase.EXECUTING, outcome: Outcome | None = None) -> TaskNews:
    return TaskNews(view=TaskView(task=task, effect=WISH.effect, phase=phase, submitted_at=HOUR, outcome=outcome), events=())


def test_a_time_is_noted_before_its_task_is_stated_and_followed_to_its_end() -> None:
    one = scheduler()
    id = ordered(one)
    assert not sent(one.handle(Rang(TICK), HOUR - 1), Submit)
    effects: Sequence[Effect] = one.handle(Rang(TICK), HOUR)
    task = task_for(id, HOUR)
    assert kept(effects) == [RunNoted(order=id, run=Run(due=HOUR, state=RunState.SUBMITTING, at=HOUR, task=task))]
    (stated,) = sent(effects, Submit)
    assert isinstance(effects[0], Record), "before it leaves"
    assert stated.header.message_id == message_for(id, HOUR)
    assert (stated.header.sender, stated.header.reply_to) == ("urn:so-mrs:client:order%20Often", HERE)
    (watched,) = sent(answer(one, stated, Submitted(task=task), HOUR + 1), WatchTask)
    (again,) = sent(answer(one, watched, view(task), HOUR + 2), WatchTask)
    effects = answer(one, again, view(task, Phase.ENDED, Outcome.ACCOMPLISHED), HOUR + 3)
    (run,) = one.book.runs_of(id)
    assert (run.state, run.outcome, run.open) == (RunState.SUBMITTED, Outcome.ACCOMPLISHED, False)
    assert kept(effects) == [RunNoted(order=id, run=run)]


def test_what_was_open_in_an_earlier_life_is_asked_for_and_stated_again_as_the_same_message() -> None:
    before = scheduler()
    id = ordered(before)
    (first,) = sent(before.handle(Rang(TICK), HOUR), Submit)
    after = scheduler(before.book)
    (looked,) = sent(after.handle(Rang(TICK), HOUR + 5), WatchTask)
    (searched,) = sent(answer(after, looked, Fault(code="Sender", text="no such task"), HOUR + 6), ReadRecords)
    (again,) = sent(answer(after, searched, Records(records=()), HOUR + 7), Submit)
    assert again.header.message_id == first.header.message_id
    late = scheduler(before.book)
    (looked,) = sent(late.handle(Rang(TICK), HOUR + LATE + 1), WatchTask)
    (searched,) = sent(answer(late, looked, Fault(code="Sender", text="no such task"), HOUR + LATE + 2), ReadRecords)
    assert not sent(answer(late, searched, Records(records=()), HOUR + LATE + 3), Submit)
    assert [run.state for run in late.book.runs_of(id)] == [RunState.MISSED]


def test_who_does_not_answer_is_asked_again() -> None:
    one = scheduler()
    id = ordered(one)
    (stated,) = sent(one.handle(Rang(TICK), HOUR), Submit)
    one.handle(Undelivered(stated, "nobody is there"), HOUR + LATE)
    (looked,) = sent(one.handle(Rang(TICK), HOUR + LATE + 2), WatchTask)
    (again,) = sent(one.handle(Rang(TICK), HOUR + LATE + 2 + WAIT), WatchTask)
    assert again.header.message_id != looked.header.message_id
    answer(one, again, view(task_for(id, HOUR), Phase.ENDED, Outcome.FAILED), HOUR + 200)
    assert one.book.runs_of(id)[0].outcome is Outcome.FAILED


def test_while_the_task_before_runs_a_time_is_skipped_unless_the_order_says_otherwise() -> None:
    for skip in (True, False):
        one = scheduler()
        id = ordered(one, skip=skip)
        (stated,) = sent(one.handle(Rang(TICK), HOUR), Submit)
        answer(one, stated, Submitted(task=task_for(id, HOUR)), HOUR + 1)
        effects = one.handle(Rang(TICK), 2 * HOUR)
        if skip:
            *_, looked = sent(effects, WatchTask)  # the last: also the one that follows it was not answered for long
            answer(one, looked, view(task_for(id, HOUR)), 2 * HOUR + 1)
        assert one.book.runs_of(id)[-1].state is (RunState.SKIPPED if skip else RunState.SUBMITTING)


def test_what_cannot_be_stated_is_refused_and_what_was_slept_through_is_missed() -> None:
    one = scheduler()
    id = ordered(one)
    (stated,) = sent(one.handle(Rang(TICK), HOUR), Submit)
    answer(one, stated, TaskRejected(problem="there is no Platform001"), HOUR + 1)
    assert [(run.state, run.note) for run in one.book.runs_of(id)] == [(RunState.REFUSED, "there is no Platform001")]
    assert not sent(one.handle(Rang(TICK), 5 * HOUR + LATE + 1), Submit)
    run = one.book.runs_of(id)[-1]
    assert (run.state, run.due, run.times) == (RunState.MISSED, 5 * HOUR, 4)


def test_subscribers_hear_of_changes_and_refusals_say_their_sort() -> None:
    one = scheduler()
    assert sent(ask(one, orders.SubscribeOrders(lease=30.0), 0.0), orders.OrdersSubscribed)
    effects = ask(one, orders.SaveOrder(saved=OrderSaved(name="Often", when=Every(minutes=60), task=WISH)), 1.0)
    (news,) = sent(effects, orders.OrdersChanged)
    assert news.body == orders.OrdersChanged(orders=True)
    one.handle(Undelivered(news, "it is gone"), 2.0)
    assert not sent(ask(one, orders.RemoveOrder(id=next(iter(one.book.orders))), 3.0), orders.OrdersChanged)
    (wrong,) = sent(ask(one, orders.ReadTemplates(name="Nothing"), 3.0), orders.OrdersRejected)
    assert isinstance(wrong.body, orders.OrdersRejected)
    assert wrong.body.error == "NotFound"
    saved = orders.TemplateSaved(task=Submit(effect="{Thing} isOn Nowhere"), blanks=(orders.Blank(name="Thing"),))
    (wrong,) = sent(ask(one, orders.SaveTemplate(name="Bring", saved=saved), 3.0), orders.OrdersRejected)
    assert isinstance(wrong.body, orders.OrdersRejected)
    assert wrong.body.error == "FormulaError"
    assert wrong.body.position is not None


def test_the_same_message_is_the_same_order() -> None:
    one = scheduler()
    save = orders.SaveOrder(saved=OrderSaved(name="Often", when=Every(minutes=60), task=WISH))
    ask(one, save, 0.0)
    ask(one, save, 1.0)
    ask(one, save, 2.0, id="urn:uuid:2")
    assert len(one.book.orders) == 2


def test_the_book_is_plain_data() -> None:
    one = scheduler()
    ordered(one)
    one.handle(Rang(TICK), HOUR)
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(one.book), type=Book) == one.book
