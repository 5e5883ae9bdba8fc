"""Operations on task templates and standing orders. The Scheduler stores them, and submits the tasks of orders."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TypeVar

import msgspec

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.client.client import PATIENCE
from somrs.client.operations import operation
from somrs.client.refusals import ErrorReport, refusal_of
from somrs.client.task_managers import READ_TIME
from somrs.errors import RemoteError
from somrs.protocol.messages import frp, orders
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import message_id
from somrs.protocol.messages.orders import Filled, OrderSaved, Run, StandingOrder, Template, TemplateSaved
from somrs.protocol.messages.submission import Submit, Submitted

CHANGE_TIME = 30.0
"""Seconds that the Scheduler has to make a change."""

RESTART_PATIENCE = 10.0
"""Seconds for which a read request waits for a Scheduler that is being restarted."""

T = TypeVar("T")


class Templates(msgspec.Struct, frozen=True, kw_only=True):
    templates: tuple[Template, ...]


class StandingOrders(msgspec.Struct, frozen=True, kw_only=True):
    orders: tuple[StandingOrder, ...]


class Runs(msgspec.Struct, frozen=True, kw_only=True):
    """The runs of an order: the times at which it was due, newest first."""

    runs: tuple[Run, ...]


class OrderService:
    """Templates and standing orders. News of the topics `templates` and `orders` carry no value: read again what changed."""

    def __init__(self, context: Context) -> None:
        self._context = context

    # Templates

    @operation("GET", "/templates", Right.SEE)
    async def templates(self) -> Templates:
        """List all templates by name."""
        return Templates(templates=tuple(sorted(await self._templates(), key=lambda template: template.name.casefold())))

    @operation("GET", "/templates/{name}", Right.SEE)
    async def template(self, name: str) -> Template:
        """Read a template."""
        return (await self._ask(orders.ReadTemplates(name=name), orders.TemplatesPage, RESTART_PATIENCE)).templates[0]

    @operation("PUT", "/templates/{name}", Right.MODEL)
    async def save_template(self, name: str, body: TemplateSaved) -> Template:
        """Save a task as a template. With `expected_version`, the request is refused if the template has changed since that version."""
        return (await self._ask(orders.SaveTemplate(name=name, saved=body), orders.TemplateKept)).template

    @operation("POST", "/templates/{name}/rename", Right.MODEL)
    async def rename_template(self, name: str, to: str, expected_version: int | None = None, by: str = "") -> Template:
        """Rename a template. Orders that use it keep using it under the new name."""
        request = orders.RenameTemplate(name=name, to=to, expected_version=expected_version, by=by)
        return (await self._ask(request, orders.TemplateKept)).template

    @operation("DELETE", "/templates/{name}", Right.MODEL)
    async def remove_template(self, name: str, expected_version: int | None = None) -> None:
        """Remove a template that no order uses."""
        await self._ask(orders.RemoveTemplate(name=name, expected_version=expected_version), orders.NoLongerKept)

    @operation("POST", "/templates/{name}/filled", Right.SEE)
    async def fill_template(self, name: str, body: Filled) -> Submit:
        """Fill in the blanks of a template and return the task, without submitting it."""
        return (await self._ask(orders.FillTemplate(name=name, values=body.values), orders.TemplateFilled, RESTART_PATIENCE)).task

    @operation("POST", "/templates/{name}/use", Right.OPERATE)
    async def use_template(self, name: str, body: Filled, once: str | None = None) -> Submitted:
        """Fill in the blanks of a template and submit the task. `once`: the idempotency key, as in `POST /tasks`."""
        task = await self.fill_template(name, body)
        id = message_id("task", "once", once) if once is not None else None
        return Submitted(task=await self._context.client.submit(task, patience=PATIENCE, id=id, author=body.by))

    # Standing orders

    @operation("GET", "/orders", Right.SEE)
    async def orders(self) -> StandingOrders:
        """List all standing orders by name."""
        return StandingOrders(orders=tuple(sorted(await self._orders(), key=lambda order: (order.name.casefold(), order.id))))

    @operation("GET", "/orders/{id}", Right.SEE)
    async def order(self, id: str) -> StandingOrder:
        """Read a standing order."""
        return (await self._ask(orders.ReadOrders(id=id), orders.OrdersPage, RESTART_PATIENCE)).orders[0]

    @operation("GET", "/orders/{id}/runs", Right.SEE)
    async def runs(self, id: str, limit: int = 50) -> Runs:
        """List the runs of an order, newest first: when it was due, and the result."""
        runs: list[Run] = []
        has_next_page = True
        while has_next_page:
            request = orders.ReadRuns(id=id, limit=max(limit, 0) - len(runs), before=runs[-1].due if runs else None)
            page = await self._ask(request, orders.RunsPage, RESTART_PATIENCE)
            runs += page.runs
            has_next_page = page.more
        return Runs(runs=tuple(runs))

    @operation("POST", "/orders", Right.OPERATE)
    async def add_order(self, body: OrderSaved) -> StandingOrder:
        """Add a standing order."""
        return (await self._ask(orders.SaveOrder(saved=body), orders.OrderKept)).order

    @operation("PUT", "/orders/{id}", Right.OPERATE)
    async def save_order(self, id: str, body: OrderSaved) -> StandingOrder:
        """Change a standing order. The list of its past runs is kept."""
        return (await self._ask(orders.SaveOrder(id=id, saved=body), orders.OrderKept)).order

    @operation("POST", "/orders/{id}/pause", Right.OPERATE)
    async def pause_order(self, id: str, by: str = "") -> StandingOrder:
        """Pause an order. A task of the order that is running continues."""
        return (await self._ask(orders.TurnOrder(id=id, enabled=False, by=by), orders.OrderKept)).order

    @operation("POST", "/orders/{id}/resume", Right.OPERATE)
    async def resume_order(self, id: str, by: str = "") -> StandingOrder:
        """Resume an order. It is next due at the first of its times from now on."""
        return (await self._ask(orders.TurnOrder(id=id, enabled=True, by=by), orders.OrderKept)).order

    @operation("DELETE", "/orders/{id}", Right.OPERATE)
    async def remove_order(self, id: str, expected_version: int | None = None) -> None:
        """Remove an order. A task of the order that is running continues."""
        await self._ask(orders.RemoveOrder(id=id, expected_version=expected_version), orders.NoLongerKept)

    # Requests to the Scheduler

    async def read_all(self) -> tuple[Collection[StandingOrder], Mapping[str, Template]]:
        """All orders, and the templates by name; empty in a system without a Scheduler."""
        if self._context.addresses.scheduler is None:
            return (), {}
        return await self._orders(), {template.name: template for template in await self._templates()}

    async def _templates(self) -> list[Template]:
        templates: list[Template] = []
        has_next_page = True
        while has_next_page:
            request = orders.ReadTemplates(after=templates[-1].name if templates else "")
            page = await self._ask(request, orders.TemplatesPage, RESTART_PATIENCE)
            templates += page.templates
            has_next_page = page.more
        return templates

    async def _orders(self) -> list[StandingOrder]:
        standing_orders: list[StandingOrder] = []
        has_next_page = True
        while has_next_page:
            page = await self._ask(
                orders.ReadOrders(after=standing_orders[-1].id if standing_orders else ""), orders.OrdersPage, RESTART_PATIENCE
            )
            standing_orders += page.orders
            has_next_page = page.more
        return standing_orders

    async def _ask(self, body: Body, expected: type[T], patience: float = 0.0) -> T:
        scheduler = self._context.addresses.scheduler
        if scheduler is None:
            raise RemoteError("the Scheduler keeps templates and orders, and this system has none; `somrs up` starts one")
        answer: object = await self._context.client.ask(
            scheduler, body, object, timeout=READ_TIME if patience else CHANGE_TIME, patience=patience
        )
        match answer:
            case orders.OrdersRejected():
                raise refusal_of(ErrorReport(**msgspec.structs.asdict(answer)))
            case frp.Fault(text=text):
                raise RemoteError(text)
        assert isinstance(answer, expected), f"a Scheduler does not answer {type(body).__name__} with {type(answer).__name__}"
        return answer
