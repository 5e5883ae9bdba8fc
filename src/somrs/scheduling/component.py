"""The Scheduler: keeps templates and standing orders, and has the tasks of orders stated when they are due, each time once.

Its state is plain data (`book.py`); what changes is on disk before anybody hears of it. What was due while it did not run is not made up
for; it is told. `now` is the time of day: orders go by it.
"""

from __future__ import annotations

from datetime import tzinfo
from typing import TypeVar

from msgspec import structs

from somrs.client.refusals import trouble
from somrs.errors import SomrsError, UsageError
from somrs.kernel.component import Effect, Input, Rang, Received, Record, Send, Started, Undelivered, Wake
from somrs.kernel.replica import Replica
from somrs.protocol.messages import orders
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.leases import granted
from somrs.protocol.messages.orders import OrderSaved, OrdersChanged, Run, RunState, StandingOrder, Template
from somrs.protocol.messages.paging import fitting
from somrs.scheduling.book import Book, BookChange, Entry, RunNoted, expect
from somrs.scheduling.execution import LATE, Execution, task_for
from somrs.scheduling.recurrence import checked, due_after, due_between
from somrs.scheduling.templates import check, filled, name_of

TICK = "tick"
"""The timer of whatever is to be done next."""

LOOK = 30.0
"""Seconds after which the time is looked at in any case: the machine's clock may be put forward."""

T = TypeVar("T")


class Scheduler:
    """`book`: what was kept in an earlier life. `zone`: whose local time counts; None: this machine's."""

    def __init__(self, address: str, repository: str, task_manager: str, book: Book, zone: tzinfo | None = None) -> None:
        self.book = book
        self.replica = Replica(address, repository)
        self._address, self._zone = address, zone
        self._execution = Execution(address, task_manager, book, self._task_of, self._note)
        self._subscribers: dict[str, float] = {}
        self._begun = self._resumed = 0.0
        self._told = 0

    def handle(self, event: Input, now: float) -> list[Effect]:
        """What to do about the input."""
        if isinstance(event, Started):
            self._begun = now
            return [*self.replica.start(now), Wake(TICK, now)]
        news = self.replica.handle(event, now)
        effects = news.effects if news is not None else self._handle(event, now)
        return [*effects, *self._go_on(now), Wake(TICK, self._next(now))]

    def _handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case Received(message):
                about = message.header.relates_to
                found = self._execution.answered(about, message.body, now) if about is not None else None
                return found if found is not None else self._received(message, now)
            case Undelivered(Message(header=header, body=orders.OrdersChanged())):
                self._subscribers.pop(header.recipient, None)
            case Undelivered(message):
                return self._execution.undelivered(message.header.message_id, now) or []
            case Rang(timer) if timer == TICK:
                return self._execution.ring(now)
        return []

    # When

    @property
    def next_due(self) -> float | None:
        """When the next order is due."""
        dues = (due_after(order.when, self._considered(order), self._zone) for order in self.book.orders.values() if order.enabled)
        return min((due for due in dues if due is not None), default=None)

    def _next(self, now: float) -> float:
        times = (self.next_due if self.replica.ready else None, self._execution.next, now + LOOK)
        return max(now, min(time for time in times if time is not None))

    def _considered(self, order: StandingOrder) -> float:
        """Until when all times were dealt with."""
        runs = self.book.runs_of(order.id)
        return max(order.changed_at, runs[-1].due if runs else 0.0)

    def _go_on(self, now: float) -> list[Effect]:
        """Have everything stated that is due, once the map was read, by which templates are filled in."""
        if not self.replica.ready:
            return []
        effects: list[Effect] = []
        if not self._resumed:
            self._resumed = now
            effects += self._execution.resume(now)
        for order in [*self.book.orders.values()]:
            if order.enabled:
                effects += self._state_due(order, now)
        return effects

    def _state_due(self, order: StandingOrder, now: float) -> list[Effect]:
        """The last time at which it was due, unless that is long ago; those before were missed."""
        times, last = due_between(order.when, self._considered(order), now, self._zone)
        if last is None:
            return []
        effects: list[Effect] = []
        late = now - last > LATE
        if missed := times if late else times - 1:
            of = last if late else due_between(order.when, self._considered(order), last - 0.001, self._zone)[1] or last - 0.001
            run = Run(due=of, state=RunState.MISSED, at=now, times=missed, note="the Scheduler was not running")
            effects += self._note(order.id, run)
        if not late:
            run = Run(due=last, state=RunState.SUBMITTING, at=now, task=task_for(order.id, last))
            effects += [*self._note(order.id, run), *self._execution.state(order, run, now)]
        return effects

    def _task_of(self, order: StandingOrder) -> Submit:
        if order.task is not None:
            return order.task
        return filled(self.book.template(order.template or ""), order.values, self.replica)

    # Keeping

    def _keep(self, entry: Entry) -> list[Effect]:
        self.book.enter(entry)
        return [Record(entry)]

    def _note(self, id: str, run: Run) -> list[Effect]:
        if id not in self.book.orders:
            return []  # it was taken back meanwhile
        return [*self._keep(RunNoted(order=id, run=run)), *self._tell(orders=True)]

    # What is asked

    def _received(self, message: Message, now: float) -> list[Effect]:
        try:
            match message.body:
                case orders.SubscribeOrders(lease=lease):
                    return self._subscribe(message, granted(lease), now)
                case Fault():
                    return []
                case orders.SaveTemplate() | orders.SaveOrder() | orders.FillTemplate() if not self.replica.ready:
                    return [self._answer(message, Fault(code="Receiver", text="the Scheduler has not read the map yet; try again"))]
                case body:
                    answer, effects = self._asked(message, body, now)
                    return [*effects, self._answer(message, answer)]
        except SomrsError as error:
            said = trouble(error)
            return [self._answer(message, orders.OrdersRejected(**{name: getattr(said, name) for name in REJECTED}))]

    def _answer(self, to: Message, body: Body) -> Send:
        return Send(reply(to, body, self._address))

    def _asked(self, message: Message, body: Body, now: float) -> tuple[Body, list[Effect]]:
        match body:
            case orders.ReadTemplates(after=after, name=None):
                found, more = _page(self.book.templates, after)
                return orders.TemplatesPage(templates=tuple(found), more=more), []
            case orders.ReadTemplates(name=str() as name):
                return orders.TemplatesPage(templates=(self.book.template(name),)), []
            case orders.SaveTemplate():
                return self._save_template(body, now)
            case orders.RenameTemplate(name=name, to=to, expected_version=version, by=by):
                template = self._expected(name, version)
                change = self.book.renamed(template, name_of(to), by, now)
                effects = [*self._keep(change), *self._tell(templates=True, orders=True)]
                return orders.TemplateKept(template=self.book.template(name_of(to))), effects
            case orders.RemoveTemplate(name=name, expected_version=version):
                change = self.book.without(self._expected(name, version))
                return orders.NoLongerKept(), [*self._keep(change), *self._tell(templates=True)]
            case orders.FillTemplate(name=name, values=values):
                return orders.TemplateFilled(task=filled(self.book.template(name), values, self.replica)), []
            case orders.ReadOrders(after=after, id=None):
                listed, more = _page(self.book.orders, after)
                return orders.OrdersPage(orders=tuple(self._seen(one, now) for one in listed), more=more), []
            case orders.ReadOrders(id=str() as id):
                return orders.OrdersPage(orders=(self._seen(self.book.order(id), now),)), []
            case orders.SaveOrder(id=None, saved=saved):
                # The same message, sent again, is the same order.
                return self._save_order(message_id("order", message.header.message_id)[9:].replace("-", "")[:12], saved, now)
            case orders.SaveOrder(id=str() as id, saved=saved):
                return self._save_order(self.book.order(id).id, saved, now)
            case orders.TurnOrder(id=id, enabled=enabled, by=by):
                before = self.book.order(id)
                turned = structs.replace(before, enabled=enabled, version=before.version + 1, changed_at=now, changed_by=by)
                return self._order_kept(turned, now)
            case orders.RemoveOrder(id=id, expected_version=version):
                before = self.book.order(id)
                expect(version, before.version, f"the order {before.name}", before.changed_by)
                return orders.NoLongerKept(), [*self._keep(BookChange(orders={id: None})), *self._tell(orders=True)]
            case orders.ReadRuns():
                return self._runs(body), []
        raise UsageError(f"a Scheduler does not understand {type(body).__name__}; it keeps templates and standing orders")

    def _expected(self, name: str, version: int | None) -> Template:
        template = self.book.template(name)
        expect(version, template.version, f"the template {name}", template.changed_by)
        return template

    def _save_template(self, wanted: orders.SaveTemplate, now: float) -> tuple[Body, list[Effect]]:
        name, saved = name_of(wanted.name), wanted.saved
        check(saved.task, saved.blanks, self.replica)
        before = self.book.templates.get(name)
        expect(saved.expected_version, before.version if before else 0, f"the template {name}", before.changed_by if before else "")
        made = Template(
            name=name,
            task=saved.task,
            blanks=saved.blanks,
            note=saved.note,
            version=before.version + 1 if before else 1,
            changed_at=now,
            changed_by=saved.by,
        )
        return orders.TemplateKept(template=made), [*self._keep(BookChange(templates={name: made})), *self._tell(templates=True)]

    def _save_order(self, id: str, saved: OrderSaved, now: float) -> tuple[Body, list[Effect]]:
        name, before = name_of(saved.name), self.book.orders.get(id)
        expect(saved.expected_version, before.version if before else 0, f"the order {name}", before.changed_by if before else "")
        when = saved.when if before is not None and saved.when == before.when else checked(saved.when, now)
        made = StandingOrder(
            id=id,
            name=name,
            when=when,
            task=saved.task,
            template=saved.template,
            values=saved.values,
            enabled=saved.enabled,
            skip=saved.skip,
            version=before.version + 1 if before else 1,
            changed_at=now,
            changed_by=saved.by,
        )
        self._check(made)
        return self._order_kept(made, now)

    def _check(self, order: StandingOrder) -> None:
        """Raises InputError where it could not be stated even now."""
        if (order.task is None) is (order.template is None):
            raise UsageError("an order has either a task of its own, or a template; give one of the two")
        if order.task is not None:
            if order.values:
                raise UsageError("values are for the blanks of a template, and this order has a task of its own")
            check(order.task, (), self.replica)
        else:
            self._task_of(order)

    def _order_kept(self, order: StandingOrder, now: float) -> tuple[Body, list[Effect]]:
        effects = [*self._keep(BookChange(orders={order.id: order})), *self._tell(orders=True)]
        return orders.OrderKept(order=self._seen(order, now)), effects

    def _seen(self, order: StandingOrder, now: float) -> StandingOrder:
        """The order, with when it is due next, and what came of the last time."""
        runs = self.book.runs_of(order.id)
        next = due_after(order.when, max(self._considered(order), now), self._zone) if order.enabled else None
        return structs.replace(order, next=next, last=runs[-1] if runs else None)

    def _runs(self, wanted: orders.ReadRuns) -> Body:
        self.book.order(wanted.id)
        runs = [run for run in reversed(self.book.runs_of(wanted.id)) if wanted.before is None or run.due < wanted.before]
        runs = runs[: max(wanted.limit, 0)]
        page = tuple(fitting(runs))
        return orders.RunsPage(runs=page, more=len(page) < len(runs))

    # News

    def _subscribe(self, message: Message, lease: float, now: float) -> list[Effect]:
        if message.header.sender == ANONYMOUS:
            raise UsageError("news can only be sent to somebody who has an address: set the sender to one that can be reached")
        self._subscribers[message.header.sender] = until = now + lease
        self._subscribers = {address: end for address, end in self._subscribers.items() if end > now}
        return [self._answer(message, orders.OrdersSubscribed(until=until, begun=self._begun))]

    def _tell(self, *, templates: bool = False, orders: bool = False) -> list[Effect]:
        self._told += 1
        news = OrdersChanged(templates=templates, orders=orders)
        return [Send(Message(header=self._header(subscriber), body=news)) for subscriber in self._subscribers]

    def _header(self, subscriber: str) -> Header:
        # When it was begun is part of the id: after a restart, news are counted from 1 again.
        id = message_id(self._address, subscriber, "news", self._told, self._begun)
        return Header(sender=self._address, recipient=subscriber, message_id=id)


REJECTED = orders.OrdersRejected.__struct_fields__


def _page(kept: dict[str, T], after: str) -> tuple[list[T], bool]:
    """As many as one message holds of those behind that name, and whether there are others."""
    names = sorted(name for name in kept if name > after)
    page = [*fitting(kept[name] for name in names)]
    return page, len(page) < len(names)
