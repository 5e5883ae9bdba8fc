"""Templates of tasks, and standing orders: tasks that are stated again and again by themselves."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from somrs.app.desk.context import Context
from somrs.app.desk.operations import operation
from somrs.app.desk.recurrence import When
from somrs.app.desk.templates import Filled, Template, Templates, TemplateSaved
from somrs.errors import RemoteError
from somrs.protocol.clients import Submit, Submitted
from somrs.protocol.frp import Outcome


class RunState(StrEnum):
    """What became of one time at which an order was due."""

    SUBMITTING = "submitting"
    SUBMITTED = "submitted"
    """Its task runs, or is over: then there is an outcome."""
    SKIPPED = "skipped"
    """The task before still ran."""
    MISSED = "missed"
    """The system was down; it is not made up for."""
    REFUSED = "refused"
    """It could not be stated; `note` says why."""


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """One time at which an order was due. `missed`: so many times were missed since the one before."""

    due: float
    state: RunState
    at: float
    task: str | None = None
    outcome: Outcome | None = None
    ended_at: float | None = None
    note: str = ""
    missed: int = 0


class StandingOrder(msgspec.Struct, frozen=True, kw_only=True):
    """A task that is stated whenever it is due: its own, or a template's, with the blanks filled in. `next`: when it is due next (None:
    never again, or it is paused). `version` counts its changes, not its runs."""

    id: str
    name: str
    when: When
    task: Submit | None = None
    template: str | None = None
    values: dict[str, str] = {}
    enabled: bool = True
    skip: bool = True
    """If the task before still runs, this time is skipped; otherwise both run."""
    next: float | None = None
    last: Run | None = None
    version: int = 0
    changed_at: float = 0.0
    changed_by: str = ""


class StandingOrders(msgspec.Struct, frozen=True, kw_only=True):
    orders: tuple[StandingOrder, ...]


class OrderSaved(msgspec.Struct, frozen=True, kw_only=True):
    """A standing order as it is to be: with a `task`, or a `template` and its `values`. `expected_version`: see templates."""

    name: str
    when: When
    task: Submit | None = None
    template: str | None = None
    values: dict[str, str] = {}
    enabled: bool = True
    skip: bool = True
    by: str = ""
    expected_version: int | None = None


class Runs(msgspec.Struct, frozen=True, kw_only=True):
    """The times at which an order was due, the latest first."""

    runs: tuple[Run, ...]


class OrdersDesk:
    """News of the topics `templates` and `orders` say that something changed there: read it again."""

    def __init__(self, context: Context) -> None:
        self._context = context

    # Templates

    @operation("GET", "/templates")
    async def templates(self) -> Templates:
        """All templates, by name."""
        raise _not_yet()

    @operation("GET", "/templates/{name}")
    async def template(self, name: str) -> Template:
        """One template."""
        raise _not_yet()

    @operation("PUT", "/templates/{name}")
    async def save_template(self, name: str, body: TemplateSaved) -> Template:
        """Keep a task under a name. Refused when somebody else changed it meanwhile."""
        raise _not_yet()

    @operation("POST", "/templates/{name}/rename")
    async def rename_template(self, name: str, to: str, expected_version: int | None = None, by: str = "") -> Template:
        """Give a template another name; the orders that use it know it by the new one."""
        raise _not_yet()

    @operation("DELETE", "/templates/{name}")
    async def remove_template(self, name: str, expected_version: int | None = None) -> None:
        """Remove a template that no order uses."""
        raise _not_yet()

    @operation("POST", "/templates/{name}/filled")
    async def fill_template(self, name: str, body: Filled) -> Submit:
        """The task that a template is, with its blanks filled in; nothing is stated."""
        raise _not_yet()

    @operation("POST", "/templates/{name}/use")
    async def use_template(self, name: str, body: Filled, once: str | None = None) -> Submitted:
        """State the task that a template is, with its blanks filled in. `once`: as for tasks."""
        raise _not_yet()

    # Standing orders

    @operation("GET", "/orders")
    async def orders(self) -> StandingOrders:
        """All standing orders, by name."""
        raise _not_yet()

    @operation("GET", "/orders/{id}")
    async def order(self, id: str) -> StandingOrder:
        """One standing order."""
        raise _not_yet()

    @operation("GET", "/orders/{id}/runs")
    async def runs(self, id: str, limit: int = 50) -> Runs:
        """When an order was due, and what came of it, the latest first."""
        raise _not_yet()

    @operation("POST", "/orders")
    async def add_order(self, body: OrderSaved) -> StandingOrder:
        """Give a standing order."""
        raise _not_yet()

    @operation("PUT", "/orders/{id}")
    async def save_order(self, id: str, body: OrderSaved) -> StandingOrder:
        """Change a standing order; its past runs stay known."""
        raise _not_yet()

    @operation("POST", "/orders/{id}/pause")
    async def pause_order(self, id: str, by: str = "") -> StandingOrder:
        """Let an order rest. Its task, if one runs, goes on."""
        raise _not_yet()

    @operation("POST", "/orders/{id}/resume")
    async def resume_order(self, id: str, by: str = "") -> StandingOrder:
        """Let an order go on: the next time is the first one from now on."""
        raise _not_yet()

    @operation("DELETE", "/orders/{id}")
    async def remove_order(self, id: str, expected_version: int | None = None) -> None:
        """Take an order back. Its task, if one runs, goes on."""
        raise _not_yet()


def _not_yet() -> RemoteError:
    return RemoteError("templates and orders are not kept here")
