"""Standing orders: tasks that the Scheduler submits. The list of existing orders, and the one edited on the page."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from datetime import datetime
from functools import partial
from typing import Any

from nicegui import ui

from somrs.errors import SomrsError, UsageError
from somrs.gui.icons import OUTCOMES, Badge, Sign, format_time
from somrs.gui.news import follow
from somrs.gui.pages.define.confirm_dialog import confirm
from somrs.gui.pages.define.draft import DAILY, INTERVAL, ONE_TIME, Repeat, number
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.task_text import task_path
from somrs.gui.panel import panel
from somrs.gui.shell import author, guarded, notify
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
            self._list = ui.element("div").classes("somrs-define-list")
        follow(form.api.context.hub, "orders", self._read, lambda _: self._read())

    async def _read(self) -> None:
        try:
            orders = (await self._form.api.orders.orders()).orders
        except SomrsError as error:
            self._list.clear()
            with self._list:
                ui.label(str(error)).classes("somrs-soft")
            return
        self._panel.note.set_text(f"{len(orders)}" if orders else "none")
        self._list.clear()
        with self._list:
            if not orders:
                ui.label("There are none. To create one, set a time under Execution options, When.").classes("somrs-soft")
            for order in orders:
                self._row(order)

    def _row(self, order: StandingOrder) -> None:
        with ui.element("section").classes("somrs-define-order-row").props(f'aria-label="{order.name}"'):
            with ui.element("div").classes("somrs-define-order-what"):
                ui.label(order.name).classes("somrs-define-template-name")
                ui.label(in_words(order.when) + ("" if order.enabled else ", paused")).classes("somrs-soft")
                if order.next is not None:
                    ui.label(f"next: {format_time(order.next)}").classes("somrs-soft")
                if order.last is not None:
                    _run(order.last)
            with ui.element("div").classes("somrs-define-line-ways"):
                if order.enabled:
                    _action_button("pause", f"Pause {order.name}", partial(self._form.api.orders.pause_order, order.id, author()))
                else:
                    _action_button("play_arrow", f"Resume {order.name}", partial(self._form.api.orders.resume_order, order.id, author()))
                _action_button("edit", f"Edit {order.name}", partial(self._change, order))
                _action_button("delete", f"Remove {order.name}", partial(self._remove, order))

    async def _change(self, order: StandingOrder) -> None:
        """Load the order into the form."""
        task = order.task
        if task is None and order.template is not None:
            task = await self._form.api.orders.fill_template(order.template, Filled(values=order.values))
        if task is not None:
            self._form.draft.load_task(task)
        self._form.draft.repeat = repeat_of(order)
        self._form.changed()

    async def _remove(self, order: StandingOrder) -> None:
        if await confirm(f"The standing order {order.name} will be removed. A running task of it continues.", "Remove"):
            await self._form.api.orders.remove_order(order.id, order.version)


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
