"""Templates of tasks, and standing orders, as operations. The Scheduler keeps them, and states the tasks of orders."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TypeVar

import msgspec

from somrs.api.context import Context
from somrs.client.client import PATIENCE
from somrs.client.operations import operation
from somrs.client.refusals import ErrorReport, refusal_of
from somrs.errors import RemoteError
from somrs.protocol.messages import frp, orders
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import Submit, Submitted
from somrs.protocol.messages.envelope import message_id
from somrs.protocol.messages.orders import Filled, OrderSaved, Run, StandingOrder, Template, TemplateSaved

RESTART_PATIENCE = 10.0
"""Seconds for which a Scheduler that is started again is waited for by those who read."""

T = TypeVar("T")


class Templates(msgspec.Struct, frozen=True, kw_only=True):
    templates: tuple[Template, ...]


class StandingOrders(msgspec.Struct, frozen=True, kw_only=True):
    orders: tuple[StandingOrder, ...]


class Runs(msgspec.Struct, frozen=True, kw_only=True):
    """The times at which an order was due, the latest first."""

    runs: tuple[Run, ...]


class OrderService:
    """News of the topics `templates` and `orders` say that something changed there: read it again."""

    def __init__(self, context: Context) -> None:
        self._context = context

    # Templates

    @operation("GET", "/templates")
    async def templates(self) -> Templates:
        """All templates, by name."""
        return Templates(templates=tuple(sorted(await self._templates(), key=lambda template: template.name.casefold())))

    @operation("GET", "/templates/{name}")
    async def template(self, name: str) -> Template:
        """One template."""
        return (await self._ask(orders.ReadTemplates(name=name), orders.TemplatesPage, RESTART_PATIENCE)).templates[0]

    @operation("PUT", "/templates/{name}")
    async def save_template(self, name: str, body: TemplateSaved) -> Template:
        """Keep a task under a name. Refused when somebody else changed it meanwhile."""
        return (await self._ask(orders.SaveTemplate(name=name, saved=body), orders.TemplateKept)).template

    @operation("POST", "/templates/{name}/rename")
    async def rename_template(self, name: str, to: str, expected_version: int | None = None, by: str = "") -> Template:
        """Give a template another name; the orders that use it know it by the new one."""
        request = orders.RenameTemplate(name=name, to=to, expected_version=expected_version, by=by)
        return (await self._ask(request, orders.TemplateKept)).template

    @operation("DELETE", "/templates/{name}")
    async def remove_template(self, name: str, expected_version: int | None = None) -> None:
        """Remove a template that no order uses."""
        await self._ask(orders.RemoveTemplate(name=name, expected_version=expected_version), orders.NoLongerKept)

    @operation("POST", "/templates/{name}/filled")
    async def fill_template(self, name: str, body: Filled) -> Submit:
        """The task that a template is, with its blanks filled in; nothing is stated."""
        return (await self._ask(orders.FillTemplate(name=name, values=body.values), orders.TemplateFilled, RESTART_PATIENCE)).task

    @operation("POST", "/templates/{name}/use")
    async def use_template(self, name: str, body: Filled, once: str | None = None) -> Submitted:
        """State the task that a template is, with its blanks filled in. `once`: as for tasks."""
        task = await self.fill_template(name, body)
        id = message_id("task", "once", once) if once is not None else None
        return Submitted(task=await self._context.client.submit(task, patience=PATIENCE, id=id, author=body.by))

    # Standing orders

    @operation("GET", "/orders")
    async def orders(self) -> StandingOrders:
        """All standing orders, by name."""
        return StandingOrders(orders=tuple(sorted(await self._orders(), key=lambda order: (order.name.casefold(), order.id))))

    @operation("GET", "/orders/{id}")
    async def order(self, id: str) -> StandingOrder:
        """One standing order."""
        return (await self._ask(orders.ReadOrders(id=id), orders.OrdersPage, RESTART_PATIENCE)).orders[0]

    @operation("GET", "/orders/{id}/runs")
    async def runs(self, id: str, limit: int = 50) -> Runs:
        """When an order was due, and what came of it, the latest first."""
        runs: list[Run] = []
        has_next_page = True
        while has_next_page:
            request = orders.ReadRuns(id=id, limit=max(limit, 0) - len(runs), before=runs[-1].due if runs else None)
            page = await self._ask(request, orders.RunsPage, RESTART_PATIENCE)
            runs += page.runs
            has_next_page = page.more
        return Runs(runs=tuple(runs))

    @operation("POST", "/orders")
    async def add_order(self, body: OrderSaved) -> StandingOrder:
        """Give a standing order."""
        return (await self._ask(orders.SaveOrder(saved=body), orders.OrderKept)).order

    @operation("PUT", "/orders/{id}")
    async def save_order(self, id: str, body: OrderSaved) -> StandingOrder:
        """Change a standing order; its past runs stay known."""
        return (await self._ask(orders.SaveOrder(id=id, saved=body), orders.OrderKept)).order

    @operation("POST", "/orders/{id}/pause")
    async def pause_order(self, id: str, by: str = "") -> StandingOrder:
        """Let an order rest. Its task, if one runs, goes on."""
        return (await self._ask(orders.TurnOrder(id=id, enabled=False, by=by), orders.OrderKept)).order

    @operation("POST", "/orders/{id}/resume")
    async def resume_order(self, id: str, by: str = "") -> StandingOrder:
        """Let an order go on: the next time is the first one from now on."""
        return (await self._ask(orders.TurnOrder(id=id, enabled=True, by=by), orders.OrderKept)).order

    @operation("DELETE", "/orders/{id}")
    async def remove_order(self, id: str, expected_version: int | None = None) -> None:
        """Take an order back. Its task, if one runs, goes on."""
        await self._ask(orders.RemoveOrder(id=id, expected_version=expected_version), orders.NoLongerKept)

    # What they are made of

    async def read_all(self) -> tuple[Collection[StandingOrder], Mapping[str, Template]]:
        """All orders, and the templates by name; none where there is no Scheduler."""
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
            raise RemoteError("templates and orders are kept by the Scheduler, and this system has none; `somrs up` starts one")
        answer: object = await self._context.client.ask(scheduler, body, object, patience=patience)
        match answer:
            case orders.OrdersRejected():
                raise refusal_of(ErrorReport(**msgspec.structs.asdict(answer)))
            case frp.Fault(text=text):
                raise RemoteError(text)
        assert isinstance(answer, expected), f"a Scheduler does not answer {type(body).__name__} with {type(answer).__name__}"
        return answer
