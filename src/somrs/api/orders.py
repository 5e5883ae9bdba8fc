"""Templates of tasks, and standing orders, as operations. What is kept is in a file of the windows; they have to run for orders to be
stated."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import AsyncIterator, Collection, Mapping
from contextlib import asynccontextmanager
from datetime import tzinfo

from msgspec import structs

from somrs.api.context import Context
from somrs.client.client import PATIENCE
from somrs.client.operations import operation
from somrs.client.refusals import Changed
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages.clients import Submit, Submitted
from somrs.protocol.messages.envelope import message_id
from somrs.scheduling.recurrence import Daily, Every, Once, When, checked
from somrs.scheduling.scheduler import Clock, Scheduler, WallClock
from somrs.scheduling.standing_orders import OrderSaved, Run, Runs, RunState, StandingOrder, StandingOrders
from somrs.scheduling.store import FILE, Book, expect
from somrs.scheduling.templates import Blank, Filled, Template, Templates, TemplateSaved, check, filled, name_of

__all__ = [
    "Blank", "Daily", "Every", "Filled", "Once", "OrderSaved", "OrdersDesk", "Run", "RunState", "Runs", "StandingOrder", "StandingOrders",
    "Template", "TemplateSaved", "Templates", "When",
]  # fmt: skip


class OrdersDesk:
    """News of the topics `templates` and `orders` say that something changed there: read it again."""

    def __init__(self, context: Context, clock: Clock | None = None, zone: tzinfo | None = None) -> None:
        self._context = context
        self._clock, self._zone = clock or WallClock(), zone
        self._open: tuple[Book, Scheduler] | None = None

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """With the file open, and orders stated when they are due. One process at a time can."""
        book = Book(self._context.data / FILE)
        try:
            scheduler = Scheduler(book, self._context.client, self._task_of, self._tell_orders, self._clock, self._zone)
            self._open = book, scheduler
            keeping = asyncio.create_task(scheduler.run())
            try:
                yield
            finally:
                self._open = None
                keeping.cancel()
                await asyncio.gather(keeping, return_exceptions=True)
        finally:
            book.close()

    # Templates

    @operation("GET", "/templates")
    async def templates(self) -> Templates:
        """All templates, by name."""
        return Templates(templates=tuple(sorted(self._book.templates.values(), key=lambda one: one.name.casefold())))

    @operation("GET", "/templates/{name}")
    async def template(self, name: str) -> Template:
        """One template."""
        return self._book.template(name)

    @operation("PUT", "/templates/{name}")
    async def save_template(self, name: str, body: TemplateSaved) -> Template:
        """Keep a task under a name. Refused when somebody else changed it meanwhile."""
        name = name_of(name)
        check(body.task, body.blanks, self._context.listener.replica)
        async with self._book.changing:
            before = self._book.templates.get(name)
            expect(body.expected_version, before.version if before else 0, f"the template {name}", before.changed_by if before else "")
            made = Template(
                name=name,
                task=body.task,
                blanks=body.blanks,
                note=body.note,
                version=before.version + 1 if before else 1,
                changed_at=self._clock.now(),
                changed_by=body.by,
            )
            await self._book.change(templates={name: made})
        self._context.hub.publish("templates")
        return made

    @operation("POST", "/templates/{name}/rename")
    async def rename_template(self, name: str, to: str, expected_version: int | None = None, by: str = "") -> Template:
        """Give a template another name; the orders that use it know it by the new one."""
        to = name_of(to)
        async with self._book.changing:
            before = self._book.template(name)
            expect(expected_version, before.version, f"the template {name}", before.changed_by)
            if to != name and to in self._book.templates:
                raise Changed(f"there is a template {to} already; take another name, or remove that one first")
            now = self._clock.now()
            made = structs.replace(before, name=to, version=before.version + 1, changed_at=now, changed_by=by)
            users = [order for order in self._book.orders.values() if order.template == name]
            await self._book.change(
                templates={name: None, to: made},
                orders={order.id: structs.replace(order, template=to, version=order.version + 1) for order in users},
            )
        self._context.hub.publish("templates")
        self._orders_changed()
        return made

    @operation("DELETE", "/templates/{name}")
    async def remove_template(self, name: str, expected_version: int | None = None) -> None:
        """Remove a template that no order uses."""
        async with self._book.changing:
            before = self._book.template(name)
            expect(expected_version, before.version, f"the template {name}", before.changed_by)
            if users := [order.name for order in self._book.orders.values() if order.template == name]:
                raise Changed(f"the template {name} is used by the order {', '.join(users)}; remove that first, or give it another task")
            await self._book.change(templates={name: None})
        self._context.hub.publish("templates")

    @operation("POST", "/templates/{name}/filled")
    async def fill_template(self, name: str, body: Filled) -> Submit:
        """The task that a template is, with its blanks filled in; nothing is stated."""
        return filled(self._book.template(name), body.values, self._context.listener.replica)

    @operation("POST", "/templates/{name}/use")
    async def use_template(self, name: str, body: Filled, once: str | None = None) -> Submitted:
        """State the task that a template is, with its blanks filled in. `once`: as for tasks."""
        task = filled(self._book.template(name), body.values, self._context.listener.replica)
        id = message_id("task", "once", once) if once is not None else None
        return Submitted(task=await self._context.client.submit(task, patience=PATIENCE, id=id, by=body.by))

    # Standing orders

    @operation("GET", "/orders")
    async def orders(self) -> StandingOrders:
        """All standing orders, by name."""
        found = sorted(self._book.orders.values(), key=lambda order: (order.name.casefold(), order.id))
        return StandingOrders(orders=tuple(map(self._scheduler.seen, found)))

    @operation("GET", "/orders/{id}")
    async def order(self, id: str) -> StandingOrder:
        """One standing order."""
        return self._scheduler.seen(self._book.order(id))

    @operation("GET", "/orders/{id}/runs")
    async def runs(self, id: str, limit: int = 50) -> Runs:
        """When an order was due, and what came of it, the latest first."""
        self._book.order(id)
        return Runs(runs=tuple(self._book.runs_of(id)[::-1][: max(limit, 0)]))

    @operation("POST", "/orders")
    async def add_order(self, body: OrderSaved) -> StandingOrder:
        """Give a standing order."""
        return await self._save(uuid.uuid4().hex[:12], body)

    @operation("PUT", "/orders/{id}")
    async def save_order(self, id: str, body: OrderSaved) -> StandingOrder:
        """Change a standing order; its past runs stay known."""
        self._book.order(id)
        return await self._save(id, body)

    @operation("POST", "/orders/{id}/pause")
    async def pause_order(self, id: str, by: str = "") -> StandingOrder:
        """Let an order rest. Its task, if one runs, goes on."""
        return await self._turned(id, by, enabled=False)

    @operation("POST", "/orders/{id}/resume")
    async def resume_order(self, id: str, by: str = "") -> StandingOrder:
        """Let an order go on: the next time is the first one from now on."""
        return await self._turned(id, by, enabled=True)

    @operation("DELETE", "/orders/{id}")
    async def remove_order(self, id: str, expected_version: int | None = None) -> None:
        """Take an order back. Its task, if one runs, goes on."""
        async with self._book.changing:
            before = self._book.order(id)
            expect(expected_version, before.version, f"the order {before.name}", before.changed_by)
            await self._book.change(orders={id: None})
        self._orders_changed()

    # What they are made of

    @property
    def kept(self) -> tuple[Collection[StandingOrder], Mapping[str, Template]]:
        """All orders, and the templates by name; none where the windows do not run."""
        return (self._book.orders.values(), self._book.templates) if self._open is not None else ((), {})

    @property
    def _book(self) -> Book:
        return self._opened[0]

    @property
    def _scheduler(self) -> Scheduler:
        return self._opened[1]

    @property
    def _opened(self) -> tuple[Book, Scheduler]:
        if self._open is None:
            raise RemoteError("templates and orders are kept by the windows, and they do not run here; ask them, at their /api")
        return self._open

    async def _save(self, id: str, body: OrderSaved) -> StandingOrder:
        name, now = name_of(body.name), self._clock.now()
        async with self._book.changing:
            before = self._book.orders.get(id)
            expect(body.expected_version, before.version if before else 0, f"the order {name}", before.changed_by if before else "")
            when = body.when if before is not None and body.when == before.when else checked(body.when, now)
            made = StandingOrder(
                id=id,
                name=name,
                when=when,
                task=body.task,
                template=body.template,
                values=body.values,
                enabled=body.enabled,
                skip=body.skip,
                version=before.version + 1 if before else 1,
                changed_at=now,
                changed_by=body.by,
            )
            self._check(made)
            await self._book.change(orders={id: made})
        self._orders_changed()
        return self._scheduler.seen(made)

    async def _turned(self, id: str, by: str, *, enabled: bool) -> StandingOrder:
        async with self._book.changing:
            before, now = self._book.order(id), self._clock.now()
            made = structs.replace(before, enabled=enabled, version=before.version + 1, changed_at=now, changed_by=by)
            await self._book.change(orders={id: made})
        self._orders_changed()
        return self._scheduler.seen(made)

    def _check(self, order: StandingOrder) -> None:
        """Raises InputError where it could not be stated even now."""
        if (order.task is None) is (order.template is None):
            raise UsageError("an order has either a task of its own, or a template; give one of the two")
        if order.task is not None:
            if order.values:
                raise UsageError("values are for the blanks of a template, and this order has a task of its own")
            check(order.task, (), self._context.listener.replica)
        else:
            self._task_of(order)

    def _task_of(self, order: StandingOrder) -> Submit:
        if order.task is not None:
            return order.task
        return filled(self._book.template(order.template or ""), order.values, self._context.listener.replica)

    def _orders_changed(self) -> None:
        self._scheduler.changed()
        self._tell_orders()

    def _tell_orders(self) -> None:
        self._context.hub.publish("orders")
