"""Standing orders: tasks that the Scheduler submits. The list of existing orders, and the one edited on the page."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from datetime import datetime
from typing import Any

from nicegui import ui

from somrs.errors import SomrsError, UsageError
from somrs.gui.author import author
from somrs.gui.components.confirm_dialog import confirm
from somrs.gui.components.rebuilt import RebuiltElement
from somrs.gui.icons import OUTCOMES, Badge, Sign, format_time
from somrs.gui.news import follow
from somrs.gui.pages.define.draft import DAILY, INTERVAL, ONE_TIME, Repeat, number
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.task_text import task_path
from somrs.gui.panel import panel
from somrs.gui.shell import guarded, notify
from somrs.protocol.messages.orders import Daily, Every, Filled, Once, OrderSaved, Run, RunState, Schedule, StandingOrder
from somrs.scheduling.recurrence import in_words

_RUNS = {
    RunState.SUBMITTING: Sign("hourglass_empty", "Being submitted", "busy"),
    RunState.SUBMITTED: Sign("play_circle", "Running", "busy"),
    RunState.SKIPPED: Sign("skip_next", "Skipped", "plain"),
    RunState.MISSED: Sign("event_busy", "Missed", "bad"),
    RunState.REFUSED: Sign("block", "Refused", "bad"),
}


class Orders:
    """The list of all standing orders, kept up to date."""

    def __init__(self, form: Form) -> None:
        self._form = form
        with panel("Standing orders", "event_repeat", "define orders", "somrs-define-orders") as self._panel:
            self._list = RebuiltElement().classes("somrs-define-list")
        self._rows: dict[str, _OrderRow] = {}
        follow(form.api.context.hub, "orders", self._read, lambda _: self._read())

    async def _read(self) -> None:
        try:
            orders = (await self._form.api.orders.orders()).orders
        except SomrsError as error:
            message = str(error)
            self._list.show(message, lambda: _note(message))
            return
        self._panel.note.set_text(f"{len(orders)}" if orders else "none")
        self._list.show([order.id for order in orders], lambda: self._build(orders))
        for order in orders:
            self._rows[order.id].show(order)

    def _build(self, orders: Sequence[StandingOrder]) -> None:
        if not orders:
            _note("There are none. To create one, set a time under Execution options, When.")
        self._rows = {order.id: _OrderRow(self._form, order) for order in orders}


class _OrderRow:
    """A standing order and what can be done with it."""

    def __init__(self, form: Form, order: StandingOrder) -> None:
        self._form, self._order = form, order
        with ui.element("section").classes("somrs-define-order-row") as self._element:
            self._text = RebuiltElement().classes("somrs-define-order-what")
            self._buttons = RebuiltElement().classes("somrs-define-line-ways")

    def show(self, order: StandingOrder) -> None:
        """Show the order as it is now."""
        self._order = order
        self._element.props["aria-label"] = order.name
        self._text.show((order.name, order.when, order.enabled, order.next, order.last), self._build_text)
        self._buttons.show((order.name, order.enabled), self._build_buttons)

    def _build_text(self) -> None:
        order = self._order
        ui.label(order.name).classes("somrs-define-template-name")
        ui.label(in_words(order.when) + ("" if order.enabled else ", paused")).classes("somrs-soft")
        if order.next is not None:
            ui.label(f"next: {format_time(order.next)}").classes("somrs-soft")
        if order.last is not None:
            _run(order.last)

    def _build_buttons(self) -> None:
        id, name, orders = self._order.id, self._order.name, self._form.api.orders
        if self._order.enabled:
            _action_button("pause", f"Pause {name}", lambda: orders.pause_order(id, author()))
        else:
            _action_button("play_arrow", f"Resume {name}", lambda: orders.resume_order(id, author()))
        _action_button("edit", f"Edit {name}", self._change)
        _action_button("delete", f"Remove {name}", self._remove)

    async def _change(self) -> None:
        """Load the order into the form."""
        order = self._order
        task = order.task
        if task is None and order.template is not None:
            task = await self._form.api.orders.fill_template(order.template, Filled(values=order.values))
        if task is not None:
            self._form.draft.load_task(task)
        self._form.draft.repeat = repeat_of(order)
        self._form.changed()

    async def _remove(self) -> None:
        order = self._order
        if await confirm(f"The standing order {order.name} will be removed. A running task of it continues.", "Remove"):
            await self._form.api.orders.remove_order(order.id, order.version)


def _note(text: str) -> None:
    ui.label(text).classes("somrs-soft")


async def save_order(form: Form) -> None:
    """Create the standing order that the draft describes, or update the one that is edited."""
    draft, orders = form.draft, form.api.orders
    saved = OrderSaved(
        name=draft.repeat.name.strip() or " ".join(draft.effect.replace("/", " ").split())[:60],
        when=schedule_of(draft.repeat),
        task=draft.task(),
        skip=draft.repeat.skip,
        by=author(),
        expected_version=draft.repeat.version if draft.repeat.order else None,
    )
    order = await (orders.save_order(draft.repeat.order, saved) if draft.repeat.order else orders.add_order(saved))
    notify(f"Standing order {order.name} saved: {in_words(order.when)}.")


def schedule_of(repeat: Repeat) -> Schedule:
    """The schedule of the inputs. Raises UsageError if an input is invalid."""
    match repeat.recurrence:
        case "every":
            minutes = number(repeat.minutes)
            if minutes is None or minutes <= 0:
                raise UsageError(f"the interval must be a number of minutes above 0, not {repeat.minutes.strip() or 'empty'}")
            return Every(minutes=minutes)
        case "daily":
            return Daily(at=repeat.time, days=tuple(repeat.days))
        case _:
            try:
                return Once(at=datetime.fromisoformat(f"{repeat.date}T{repeat.time}").timestamp())
            except ValueError:
                raise UsageError("enter the date and the time") from None


def repeat_of(order: StandingOrder) -> Repeat:
    repeat = Repeat(name=order.name, skip=order.skip, order=order.id, version=order.version)
    match order.when:
        case Every(minutes=minutes):
            repeat.recurrence, repeat.minutes = INTERVAL, f"{minutes:g}"
        case Daily(at=start_time, days=days):
            repeat.recurrence, repeat.time, repeat.days = DAILY, start_time, [*days]
        case Once(at=start_time):
            start_datetime = datetime.fromtimestamp(start_time)
            repeat.recurrence, repeat.date, repeat.time = ONE_TIME, f"{start_datetime:%Y-%m-%d}", f"{start_datetime:%H:%M}"
    return repeat


def _run(run: Run) -> None:
    sign = OUTCOMES[run.outcome] if run.outcome is not None else _RUNS[run.state]
    with ui.element("div").classes("somrs-define-run"):
        Badge(sign)
        if run.task is not None:
            ui.link(format_time(run.at), task_path(run.task))
        else:
            ui.label(format_time(run.at)).classes("somrs-soft")
        if run.note:
            ui.label(run.note).classes("somrs-soft")


def _action_button(icon: str, label: str, action: Callable[[], Awaitable[Any]]) -> None:
    ui.button(icon=icon, on_click=guarded(action)).props(f'flat dense round size=sm aria-label="{label}"').tooltip(label)
