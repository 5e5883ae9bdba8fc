"""History: search and export of tasks that have ended."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import urlencode

from nicegui import ui

from somrs.api.reliability_stats import device_of
from somrs.api.remote import LiveApi
from somrs.api.task_feed import TasksChanged
from somrs.client.durations import format_duration
from somrs.client.export import moment
from somrs.client.hub import News
from somrs.client.task_report import reasons
from somrs.errors import SomrsError
from somrs.gui.icons import OUTCOMES, format_time
from somrs.gui.news import follow
from somrs.gui.shell import guarded, page, page_at
from somrs.gui.unavailable_banner import UnavailableBanner
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.records import Records, TaskRecord
from somrs.protocol.messages.task_views import Phase

PAGE = 50
"""Tasks per page."""

ARCHIVE_DELAY = 0.5
"""Seconds after which an ended task is in the records."""

_ANY_VALUE = ""
_TIMES = {_ANY_VALUE: "Any time", "1h": "The last hour", "1d": "The last day", "7d": "The last 7 days", "30d": "The last 30 days"}
_ENDS = {_ANY_VALUE: "Any outcome", **{outcome.value: sign.text for outcome, sign in OUTCOMES.items()}}
_EXPORTS = (
    ("Tasks", "CSV, a row for each task", {"format": "csv", "table": "tasks"}),
    ("Work", "CSV, a row for each piece of work of a service", {"format": "csv", "table": "work"}),
    ("Terms", "CSV, a row for each service asked", {"format": "csv", "table": "contracts"}),
    ("Events", "CSV, a row for each event", {"format": "csv", "table": "events"}),
    ("Messages", "CSV, a row for each message", {"format": "csv", "table": "messages"}),
    ("Everything", "JSON lines, a line for each task", {"format": "jsonl"}),
)

_COLUMNS = [
    {"name": "outcome", "label": "Outcome", "field": "outcome", "align": "left"},
    {"name": "effect", "label": "Goal", "field": "effect", "align": "left"},
    {"name": "devices", "label": "Devices", "field": "devices", "align": "left"},
    {"name": "ended", "label": "Ended", "field": "ended", "align": "left"},
    {"name": "took", "label": "Took", "field": "took", "align": "right"},
]

_END_CELL = """\
<q-td :props="props"><span :class="'somrs-badge somrs-' + props.row.tone"><q-icon :name="props.row.icon" aria-hidden="true" />
<span>{{ props.row.outcome }}</span></span></q-td>"""
_GOAL_CELL = """<q-td :props="props">
<a :href="'/tasks/' + props.row.task" class="somrs-history-link somrs-formula">{{ props.row.effect }}</a>
<span v-if="props.row.manager" class="somrs-soft"> · {{ props.row.manager }}</span>
<div v-if="props.row.why" class="somrs-soft somrs-history-why">{{ props.row.why }}</div></q-td>"""


def register(api: LiveApi) -> None:
    @page_at("/history")
    async def show_page(text: str = "", outcome: str = "", since: str = "", service: str = "", rows: str = str(PAGE)) -> None:
        with page("History", "/history", api, ("text", "outcome", "since", "service", "rows")) as address:
            if outcome not in _ENDS:
                address.report(f"There is no outcome {outcome}; the outcomes are {', '.join(filter(None, _ENDS))}.")
                outcome = _ANY_VALUE
            try:
                moment(since or "1h", time.time())
            except SomrsError as error:
                address.report(f"since={since}: {error}.")
                since = _ANY_VALUE
            if not (rows.isdecimal() and int(rows)):
                address.report(f"rows={rows}: give a number of tasks from 1 to {PAGE}.")
                rows = str(PAGE)
            history = _History(api, min(int(rows), PAGE))
            history.set_filters(text, outcome, since, service)
            await guarded(history.begin)()
            await guarded(history.choices)()
            follow(api.context.hub, "tasks", _read_nothing, history.hear)


class _History:
    """The page's content."""

    def __init__(self, api: LiveApi, rows: int) -> None:
        self._api, self._rows = api, rows
        self._cursors: list[str | None] = [None]
        """For each page up to this one, the task after which it begins."""
        self._next_cursor: str | None = None
        self._counts: list[int] = []
        """Number of tasks on each of the previous pages."""
        self._request_number = 0
        self._shown_filters: dict[str, str] = {}
        """The filters of the request whose result is shown."""
        self._total: int | None = None
        with ui.element("div").classes("somrs-history"):
            with ui.element("div").classes("somrs-history-head"):
                ui.label("History").classes("somrs-title").props('role="heading" aria-level="1"')
                ui.label("Tasks that have ended").classes("somrs-soft")
                ui.space()
                with ui.button("Export", icon="download").props("flat no-caps dense"), ui.menu().props("auto-close"):
                    for name, description, parameters in _EXPORTS:
                        self._export_item(name, description, parameters)
            with ui.element("search").classes("somrs-history-filters").props('aria-label="Filters"'):
                on_change = guarded(self._changed)
                self._text = ui.input("Goal contains", on_change=on_change).props("outlined dense clearable debounce=300")
                self._outcome = ui.select(_ENDS, value=_ANY_VALUE, label="Outcome", on_change=on_change).props("outlined dense")
                self._period = ui.select(_TIMES, value=_ANY_VALUE, label="Ended in", on_change=on_change).props("outlined dense")
                self._device = ui.select([], label="Device", with_input=True, new_value_mode="add-unique", on_change=on_change)
                self._device.props("outlined dense clearable")
            UnavailableBanner(self._api, "Task Manager")
            self._table = ui.table(rows=[], columns=_COLUMNS, row_key="task").classes("somrs-history-table")
            self._table.props("flat wrap-cells hide-pagination :rows-per-page-options=[0]")
            self._table.add_slot("body-cell-outcome", _END_CELL)
            self._table.add_slot("body-cell-effect", _GOAL_CELL)
            self._table.on("rowClick", _open, [[], ["task"], None])
            self._empty_state = ui.element("div").classes("somrs-history-nothing")
            with ui.element("nav").classes("somrs-history-pages").props('aria-label="Pages of tasks"') as self._pages:
                self._position_label = ui.label().classes("somrs-soft").props('role="status"')
                ui.space()
                self._newer = ui.button("Newer", icon="chevron_left", on_click=guarded(self._show_newer)).props("flat dense no-caps")
                self._older = ui.button("Older", on_click=guarded(self._show_older)).props("flat dense no-caps icon-right=chevron_right")

    async def choices(self) -> None:
        """Load the names of the current devices as choices; other names can be typed."""
        devices = [device.name for device in (await self._api.fleet.devices()).devices]
        self._device.set_options([*dict.fromkeys([*devices, *([self._device.value] if self._device.value else [])])])

    def set_filters(self, text: str, outcome: str, period: str, service: str) -> None:
        """Set the filters from the page's address."""
        self._text.value = text
        self._outcome.value = outcome
        if period not in _TIMES:
            self._period.set_options({**_TIMES, period: period})
        self._period.value = period
        if service:
            self._device.set_options([service])
        self._device.value = service or None

    async def _changed(self) -> None:
        if self._filters() != self._shown_filters:
            self._update_address()
            await self.begin()

    def _update_address(self) -> None:
        """Put the filters into the page's address, so that it can be bookmarked and shared."""
        rows = {"rows": str(self._rows)} if self._rows != PAGE else {}
        query = urlencode({**self._filters(), **rows})
        ui.navigate.history.replace(f"/history?{query}" if query else "/history")

    async def hear(self, news: News) -> None:
        """Show a task that ended, if the first page is shown."""
        shown_tasks = {row["task"] for row in self._table.rows}
        rows = news.value.rows if isinstance(news.value, TasksChanged) else ()
        if len(self._cursors) == 1 and any(row.phase is Phase.ENDED and row.task not in shown_tasks for row in rows):
            await asyncio.sleep(ARCHIVE_DELAY)
            await guarded(self.begin)()

    async def begin(self) -> None:
        """Show the first page for the current filters."""
        self._request_number = request_number = self._request_number + 1
        self._shown_filters = self._filters()
        result = await self._read(None)
        if request_number == self._request_number:  # otherwise the filters have changed, and another request is under way
            self._cursors, self._counts, self._total = [None], [], result.total
            self._show_result(result)

    async def _show_older(self) -> None:
        if self._next_cursor is not None:
            result = await self._read(self._next_cursor)
            self._cursors.append(self._next_cursor)
            self._counts.append(len(self._table.rows))
            self._show_result(result)

    async def _show_newer(self) -> None:
        if len(self._cursors) > 1:
            result = await self._read(self._cursors[-2])
            self._cursors.pop()
            self._counts.pop()
            self._show_result(result)

    async def _read(self, cursor: str | None) -> Records:
        outcome = Outcome(self._outcome.value) if self._outcome.value else None
        return await self._api.records.find(
            since=self._period.value or None,
            outcome=outcome,
            text=self._text.value or None,
            service=self._device.value or None,
            limit=self._rows,
            behind=cursor,
        )

    def _show_result(self, result: Records) -> None:
        records = result.records
        self._next_cursor = records[-1].task if result.more and records else None
        self._table.rows = [_row(record) for record in records]
        self._table.visible = bool(records)
        earlier_count = sum(self._counts)
        total = f" of {self._total:,}" if self._total is not None else ""
        self._position_label.set_text(f"{earlier_count + 1:,} to {earlier_count + len(records):,}{total}" if records else "")
        self._newer.set_enabled(len(self._cursors) > 1)
        self._older.set_enabled(self._next_cursor is not None)
        self._pages.visible = bool(records)
        self._empty_state.clear()
        self._empty_state.visible = not records
        if not records:
            with self._empty_state:
                self._show_empty_state()

    def _show_empty_state(self) -> None:
        ui.icon("history_toggle_off").classes("somrs-history-icon").props('aria-hidden="true"')
        if self._filters():
            ui.label("No ended task matches these filters.")
            ui.button("Show all", on_click=guarded(self._clear)).props("flat no-caps")
        else:
            ui.label("No task has ended yet.")
            ui.link("New task", "/define")

    def _filters(self) -> dict[str, str]:
        """The filters that are set, by the names of the API's parameters."""
        filter_values = {
            "text": self._text.value,
            "outcome": self._outcome.value,
            "since": self._period.value,
            "service": self._device.value,
        }
        return {name: str(value) for name, value in filter_values.items() if value}

    async def _clear(self) -> None:
        self.set_filters(_ANY_VALUE, _ANY_VALUE, _ANY_VALUE, _ANY_VALUE)
        await self._changed()

    def _export_item(self, name: str, description: str, parameters: dict[str, str]) -> None:
        with ui.menu_item(on_click=self._exports(parameters)), ui.item_section():
            ui.item_label(name)
            ui.item_label(description).props("caption")

    def _exports(self, parameters: dict[str, str]) -> Callable[[], None]:
        return lambda: ui.download.from_url(f"/api/records/export?{urlencode({**parameters, **self._filters()})}")


async def _read_nothing() -> None:
    """Do nothing: the page's content was read when it was made."""


def _open(event: Any) -> None:
    """Open the task of a clicked row. The goal in the row is also a link, for keyboard users."""
    ui.navigate.to(f"/tasks/{event.args[1]['task']}")


def _row(record: TaskRecord) -> dict[str, object]:
    sign = OUTCOMES[record.outcome]
    devices = list(dict.fromkeys(device_of(work.service) for work in record.work))
    failed = sum(work.result in (State.FAILED, State.UNREACHABLE) for work in record.work)
    reason = next(iter(reasons(record)), "") if record.outcome is not Outcome.ACCOMPLISHED else ""
    recovered = f"{failed} step{'s' if failed != 1 else ''} failed" if failed and not reason else ""
    return {
        "task": record.task,
        "outcome": sign.text,
        "icon": sign.icon,
        "tone": sign.tone,
        "effect": record.effect,
        "manager": record.task_manager,
        "why": reason or recovered,
        "devices": ", ".join(devices) or "none",
        "ended": format_time(record.ended_at),
        "took": format_duration(record.ended_at - record.submitted_at),
    }
