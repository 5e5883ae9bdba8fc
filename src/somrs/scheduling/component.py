"""The Scheduler: keeps templates and standing orders, and submits the task of an order once for each time at which the order is due.

Runs that were due while the Scheduler did not run are recorded as missed, and not made up for. `now` is the time of day in seconds since
1970, since schedules refer to it.
"""

from __future__ import annotations

from typing import Self, TypeVar

from msgspec import structs

from somrs.client.refusals import error_report
from somrs.errors import SomrsError, UsageError
from somrs.kernel.admission import check_room
from somrs.kernel.codec import Schema
from somrs.kernel.component import (
    DeliveryFailed,
    Effect,
    Effects,
    EffectsReturning,
    Input,
    Notified,
    Received,
    Send,
    SetTimer,
    Started,
    TimerFired,
)
from somrs.kernel.replica import Replica
from somrs.limits import Limits
from somrs.protocol.messages import orders
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Message, message_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.orders import OrderSaved, Run, RunState, StandingOrder, Template
from somrs.protocol.messages.paging import fit_page
from somrs.protocol.messages.submission import Submit
from somrs.scheduling.book import Book, expect
from somrs.scheduling.execution import LATE, Execution, task_for
from somrs.scheduling.recurrence import check_recurrence, due_after, due_between, zone_of
from somrs.scheduling.renamed_objects import BookRenamer
from somrs.scheduling.state import Located, MapDue, OrdersDue, SchedulerState, Timer
from somrs.scheduling.subscriptions import OrderSubscriptions
from somrs.scheduling.templates import check, fill_template, name_of

LOOK = 30.0
"""Maximum seconds between two checks for due orders, since the machine's clock may be set forward."""

READS = orders.ReadTemplates | orders.ReadOrders | orders.ReadRuns
"""Requests that change nothing."""

NEED_MAP = orders.SaveTemplate | orders.SaveOrder | orders.FillTemplate
"""Requests that wait until the map has been read."""

READY_TIME = 25.0
"""Seconds for which a request waits for the map; less than clients wait for the reply."""

T = TypeVar("T")


class Scheduler:
    """The Scheduler. `located`: the addresses of the other components; its program sends them again at each start, as they may change."""

    def __init__(self, address: str, located: Located) -> None:
        self._adopt(SchedulerState.new(address, located))

    @classmethod
    def restored(cls, state: SchedulerState) -> Self:
        """The Scheduler with this state."""
        scheduler = cls.__new__(cls)
        scheduler._adopt(state)
        return scheduler

    def _adopt(self, state: SchedulerState) -> None:
        self.state = state
        self._execution = Execution(state, self._task_of, self._note)
        self._subscriptions = OrderSubscriptions(state)

    @property
    def book(self) -> Book:
        return self.state.book

    @property
    def replica(self) -> Replica:
        return self.state.replica

    @property
    def open(self) -> list[str]:
        """Nothing: the Task Manager holds the running tasks, and orders have no end."""
        return []

    def check_admitted(self, message: Message, bounds: Limits) -> None:
        if isinstance(message.body, orders.SubscribeOrders):
            check_room("subscribers", bounds, self.state.subscribers, message.header.sender)

    def handle(self, event: Input, now: float) -> list[Effect]:
        """Process an input, and return the effects."""
        match event:
            case Notified(Located() as located):
                self._locate(located)
                return []
            case Received(message) if only_reads(event):
                return [*self._received(message, now)]
            case _:
                return [*self._effects(event, now)]

    def _effects(self, event: Input, now: float) -> Effects:
        news = self.replica.handle(event, now)
        yield from news.effects if news is not None else self._handle(event, now)
        if news is not None and news.new_names:
            templates, orders = BookRenamer(news.new_names, self.replica.ontology).rename(self.book)
            if templates or orders:
                yield from self._subscriptions.publish(templates=templates, orders=orders)
        if self.replica.ready:
            yield from self._serve_waiting(now)
        if news is None or news.reloaded:  # most inputs are map changes, which make nothing due
            yield from self._run_due_orders(now)

    def _handle(self, event: Input, now: float) -> Effects:
        state = self.state
        match event:
            case Started(address):
                state.address = state.replica.owner = address
                state.started_at = now
                yield from state.replica.start(now)
            case Received(Message(header=header, body=body)) if header.relates_to in state.questions:
                yield from self._execution.answered(header.relates_to or "", body, now)
            case Received(message):
                yield from self._received(message, now)
            case DeliveryFailed(Message(header=header, body=orders.OrdersChanged())):
                self._subscriptions.undelivered(header.recipient)
            case DeliveryFailed(message):
                self._execution.undelivered(message.header.message_id, now)
            case TimerFired(OrdersDue()):
                yield from self._execution.ask_again(now)
            case TimerFired(MapDue(request)) if (waiting := state.until_ready.pop(request, None)) is not None:
                text = f"the map of the environment is not known yet, because {state.located.repository} does not answer; try again later"
                yield self._answer(waiting, Fault(code="env:Receiver", text=text))

    def _locate(self, located: Located) -> None:
        if located.repository != self.state.replica.repository:
            self.state.replica = Replica(self.state.address, located.repository)
        self.state.located = located

    # Due times

    @property
    def next_due(self) -> float | None:
        """When the next order is due; None if none is."""
        dues = (self._due_after(order, self._considered(order)) for order in self.book.orders.values() if order.enabled)
        return min((due for due in dues if due is not None), default=None)

    def _due_after(self, order: StandingOrder, start: float) -> float | None:
        return due_after(order.when, start, zone_of(self.state.located.zone))

    def _considered(self, order: StandingOrder) -> float:
        """The time up to which all due times of the order have been processed."""
        runs = self.book.runs_of(order.id)
        return max(order.changed_at, runs[-1].due if runs else 0.0)

    def _run_due_orders(self, now: float) -> Effects:
        """Start the runs of all due orders. This waits for the map, since filling in templates needs it."""
        ready = self.replica.ready
        if ready:
            for order in [*self.book.orders.values()]:
                if order.enabled:
                    yield from self._state_due(order, now)
        times = (self.next_due if ready else None, self._execution.next_retry, now + LOOK)
        yield SetTimer(OrdersDue(), max(now, min(time for time in times if time is not None)))

    def _state_due(self, order: StandingOrder, now: float) -> Effects:
        """Start a run for the order's latest due time unless that is more than `LATE` ago, and record earlier due times as missed."""
        considered, zone = self._considered(order), zone_of(self.state.located.zone)
        times, last_due = due_between(order.when, considered, now, zone)
        if last_due is None:
            return
        late = now - last_due > LATE
        if missed := times if late else times - 1:
            missed_due = last_due if late else due_between(order.when, considered, last_due - 0.001, zone)[1] or last_due - 0.001
            run = Run(due=missed_due, state=RunState.MISSED, at=now, times=missed, note="the Scheduler was not running")
            yield from self._note(order.id, run)
        if not late:
            run = Run(due=last_due, state=RunState.SUBMITTING, at=now, task=task_for(order.id, last_due))
            yield from self._note(order.id, run)
            yield from self._execution.start_run(order, run, now)

    def _task_of(self, order: StandingOrder) -> Submit:
        if order.task is not None:
            return order.task
        return fill_template(self.book.template(order.template or ""), order.values, self.replica)

    def _note(self, id: str, run: Run) -> Effects:
        if id in self.book.orders:  # the order may have been removed meanwhile
            self.book.note(id, run)
            yield from self._subscriptions.publish(orders=True)

    # Requests

    def _received(self, message: Message, now: float) -> Effects:
        try:
            match message.body:
                case orders.SubscribeOrders() as request:
                    yield self._answer(message, self._subscriptions.subscribe(request, message.header.sender, now))
                case Fault():
                    pass  # a Fault is never answered, least of all by a Fault
                case body if isinstance(body, NEED_MAP) and not self.replica.ready:
                    self.state.until_ready[message.header.message_id] = message
                    yield SetTimer(MapDue(message.header.message_id), now + READY_TIME)
                case body:
                    answer = yield from self._handle_request(message, body, now)
                    yield self._answer(message, answer)
        except SomrsError as error:
            report = error_report(error)
            yield self._answer(message, orders.OrdersRejected(**{name: getattr(report, name) for name in _REJECTED}))

    def _serve_waiting(self, now: float) -> Effects:
        waiting, self.state.until_ready = self.state.until_ready, {}
        for id, message in waiting.items():
            yield SetTimer(MapDue(id), None)
            yield from self._received(message, now)

    def _answer(self, request: Message, body: Body) -> Send:
        return Send(reply(request, body, self.state.address))

    def _handle_request(self, message: Message, body: Body, now: float) -> EffectsReturning[Body]:
        match body:
            case orders.ReadTemplates(after=cursor, name=None):
                templates, has_next_page = _page(self.book.templates, cursor)
                return orders.TemplatesPage(templates=tuple(templates), more=has_next_page)
            case orders.ReadTemplates(name=str() as name):
                return orders.TemplatesPage(templates=(self.book.template(name),))
            case orders.SaveTemplate():
                return (yield from self._save_template(body, now))
            case orders.RenameTemplate(name=name, to=new_name, expected_version=version, by=author):
                renamed = self.book.rename_template(self._expected(name, version), name_of(new_name), author, now)
                yield from self._subscriptions.publish(templates=True, orders=True)
                return orders.TemplateKept(template=renamed)
            case orders.RemoveTemplate(name=name, expected_version=version):
                self.book.remove_template(self._expected(name, version))
                yield from self._subscriptions.publish(templates=True)
                return orders.NoLongerKept()
            case orders.FillTemplate(name=name, values=values):
                return orders.TemplateFilled(task=fill_template(self.book.template(name), values, self.replica))
            case orders.ReadOrders(after=cursor, id=None):
                listed, has_next_page = _page(self.book.orders, cursor)
                return orders.OrdersPage(orders=tuple(self._order_view(order, now) for order in listed), more=has_next_page)
            case orders.ReadOrders(id=str() as id):
                return orders.OrdersPage(orders=(self._order_view(self.book.order(id), now),))
            case orders.SaveOrder(id=None, saved=saved):
                # The id derives from the message, so that a message that is sent again adds no second order.
                order_id = message_id("order", message.header.message_id)[9:].replace("-", "")[:12]
                return (yield from self._save_order(order_id, saved, now))
            case orders.SaveOrder(id=str() as id, saved=saved):
                return (yield from self._save_order(self.book.order(id).id, saved, now))
            case orders.TurnOrder(id=id, enabled=enabled, by=author):
                old_order = self.book.order(id)
                turned = structs.replace(old_order, enabled=enabled, version=old_order.version + 1, changed_at=now, changed_by=author)
                return (yield from self._order_kept(turned, now))
            case orders.RemoveOrder(id=id, expected_version=version):
                old_order = self.book.order(id)
                expect(version, old_order.version, f"the order {old_order.name}", old_order.changed_by)
                self.book.remove_order(id)
                yield from self._subscriptions.publish(orders=True)
                return orders.NoLongerKept()
            case orders.ReadRuns():
                return self._runs(body)
        raise UsageError(f"a Scheduler does not understand {type(body).__name__}; it keeps templates and standing orders")

    def _expected(self, name: str, version: int | None) -> Template:
        template = self.book.template(name)
        expect(version, template.version, f"the template {name}", template.changed_by)
        return template

    def _save_template(self, request: orders.SaveTemplate, now: float) -> EffectsReturning[Body]:
        name, saved = name_of(request.name), request.saved
        check(saved.task, saved.blanks, self.replica)
        old_template = self.book.templates.get(name)
        expect(
            saved.expected_version,
            old_template.version if old_template else 0,
            f"the template {name}",
            old_template.changed_by if old_template else "",
        )
        self.book.templates[name] = template = Template(
            name=name,
            task=saved.task,
            blanks=saved.blanks,
            note=saved.note,
            version=old_template.version + 1 if old_template else 1,
            changed_at=now,
            changed_by=saved.by,
        )
        yield from self._subscriptions.publish(templates=True)
        return orders.TemplateKept(template=template)

    def _save_order(self, id: str, saved: OrderSaved, now: float) -> EffectsReturning[Body]:
        name, old_order = name_of(saved.name), self.book.orders.get(id)
        expect(
            saved.expected_version, old_order.version if old_order else 0, f"the order {name}", old_order.changed_by if old_order else ""
        )
        recurrence = saved.when if old_order is not None and saved.when == old_order.when else check_recurrence(saved.when, now)
        order = StandingOrder(
            id=id,
            name=name,
            when=recurrence,
            task=saved.task,
            template=saved.template,
            values=saved.values,
            enabled=saved.enabled,
            skip=saved.skip,
            version=old_order.version + 1 if old_order else 1,
            changed_at=now,
            changed_by=saved.by,
        )
        self._check(order)
        return (yield from self._order_kept(order, now))

    def _check(self, order: StandingOrder) -> None:
        """Raise InputError if the order's task could not be submitted now."""
        if (order.task is None) is (order.template is None):
            raise UsageError("an order has either a task of its own, or a template; give one of the two")
        if order.task is not None:
            if order.values:
                raise UsageError("values are for the blanks of a template, and this order has a task of its own")
            check(order.task, (), self.replica)
        else:
            self._task_of(order)

    def _order_kept(self, order: StandingOrder, now: float) -> EffectsReturning[Body]:
        self.book.orders[order.id] = order
        yield from self._subscriptions.publish(orders=True)
        return orders.OrderKept(order=self._order_view(order, now))

    def _order_view(self, order: StandingOrder, now: float) -> StandingOrder:
        """The order with its next due time and its last run."""
        runs = self.book.runs_of(order.id)
        next_due = self._due_after(order, max(self._considered(order), now)) if order.enabled else None
        return structs.replace(order, next=next_due, last=runs[-1] if runs else None)

    def _runs(self, request: orders.ReadRuns) -> Body:
        self.book.order(request.id)
        runs = [run for run in reversed(self.book.runs_of(request.id)) if request.before is None or run.due < request.before]
        runs = runs[: max(request.limit, 0)]
        page = tuple(fit_page(runs))
        return orders.RunsPage(runs=page, more=len(page) < len(runs))


_REJECTED = orders.OrdersRejected.__struct_fields__


def _page(entries: dict[str, T], cursor: str) -> tuple[list[T], bool]:
    """As many of the entries after `cursor` as one message holds, and whether there are more."""
    names = sorted(name for name in entries if name > cursor)
    page = [*fit_page(entries[name] for name in names)]
    return page, len(page) < len(names)


def only_reads(event: Input) -> bool:
    """Whether the input is a request that changes nothing and is answered on its connection; such inputs need no journal entry."""
    match event:
        case Received(message):
            return message.header.reply_to == ANONYMOUS and isinstance(message.body, READS)
        case _:
            return False


SCHEMA = Schema(
    component="scheduler",
    version=1,
    state=SchedulerState,
    timers=Timer,
    questions=None,
    tasks=None,
    answers=None,
    notices=Located,
    restore=Scheduler.restored,
    relocatable=True,
    irreplaceable=True,
    is_read_only=only_reads,
    snapshot_after=1000,
)
"""The schema of its journal. A check of fifty orders takes 5 ms; without requests, every fourth input is one."""
