"""All tasks in the Task Managers' memory, newest first."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from nicegui import ui

from somrs.api.questions import OpenQuestions
from somrs.api.remote import LiveApi
from somrs.api.tasks import TasksChanged
from somrs.client.durations import format_duration
from somrs.client.hub import News
from somrs.client.state_labels import OUTCOMES, priority_text
from somrs.client.task_report import reasons
from somrs.errors import SomrsError
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.components.task.list import TaskList
from somrs.gui.icons import format_time, join_names
from somrs.gui.news import follow
from somrs.gui.pages import task
from somrs.gui.pages.task_text import count_text, device_name, due_text, gist, hindrance_texts, task_key, task_path, task_sign, wait_texts
from somrs.gui.shell import guarded, page, page_at
from somrs.gui.throttle import Throttle
from somrs.gui.unavailable_banner import UnavailableBanner
from somrs.protocol.messages.people import person_name
from somrs.protocol.messages.task_views import Phase, TaskRow

PAGE_SIZE = 200
"""Tasks read at once."""

RETRY_DELAY = 2.0
"""Seconds after which a request to a Task Manager that does not answer is repeated."""

_ALL_TASKS, _RUNNING = "all", "running"

_COLUMNS: list[dict[str, Any]] = [
    {"name": "far", "label": "Status", "field": "far", "align": "left"},
    {"name": "effect", "label": "Goal", "field": "effect", "align": "left"},
    {"name": "stated", "label": "Submitted", "field": "at", "align": "left"},
    {"name": "took", "label": "Time", "field": "seconds", "align": "left"},
    {"name": "due", "label": "Deadline", "field": "due", "align": "left"},
    {"name": "priority", "label": "Priority", "field": "priority", "align": "left"},
    {"name": "retry", "label": "Retry", "field": "retry", "align": "right"},
]


def register(api: LiveApi) -> None:
    task.register(api)

    @page_at("/tasks")
    async def show_page() -> None:
        with page("Tasks", "/tasks", api):
            _Tasks(api)


class _Tasks:
    def __init__(self, api: LiveApi) -> None:
        self._api = api
        self._rows: dict[str, TaskRow] = {}
        self._asked_people: frozenset[str] = frozenset()
        self._schedule_render = Throttle(self._render)
        with ui.element("div").classes("somrs-tasks-head"):
            ui.label("Tasks").classes("somrs-title").props('role="heading" aria-level="1"')
            self._filter = shown_at_once(ui.toggle(_choices([]), value=_ALL_TASKS, on_change=self._render)).props(
                "no-caps dense unelevated"
            )
            self._search_field = ui.input(placeholder="Find in goals, people, services", on_change=self._render).props(
                'dense outlined clearable type=search aria-label="Find"'
            )
            self._search_field.classes("somrs-tasks-find")
            new = ui.button("New task", icon="add_task", on_click=lambda: ui.navigate.to("/define"))
            new.props("unelevated no-caps color=primary").classes("somrs-tasks-new")
        UnavailableBanner(api, "Task Manager")
        self._table = TaskList(_COLUMNS, "Reading the tasks …", on_retry=guarded(self._retry)).classes("somrs-tasks somrs-sheet")
        with ui.element("p").classes("somrs-soft somrs-tasks-foot"):
            ui.label("Older tasks are in the")
            ui.link("History", "/history")
        follow(api.context.hub, "tasks", self._read, self._handle_news)
        follow(api.context.hub, "questions", self._read_questions, self._handle_question_news)
        ui.timer(1.0, self._tick)

    async def _read(self) -> None:
        while True:
            try:
                self._rows, is_complete = await self._read_pages()
                self._render()
                if is_complete:
                    break
            except SomrsError as error:
                self._table.set_empty_text(f"{error}; retrying")
            await asyncio.sleep(RETRY_DELAY)

    async def _read_pages(self) -> tuple[dict[str, TaskRow], bool]:
        """The tasks, and whether they are those of all Task Managers."""
        page = await self._api.tasks.list(limit=PAGE_SIZE)
        rows, is_complete = [*page.rows], not page.silent
        while page.more:
            page = await self._api.tasks.list(limit=PAGE_SIZE, behind=rows[-1].task)
            rows, is_complete = [*rows, *page.rows], is_complete and not page.silent
        return {row.task: row for row in rows}, is_complete

    async def _handle_news(self, news: News) -> None:
        if not isinstance(news.value, TasksChanged):
            await self._read()
            return
        if news.value.anew:
            self._rows.clear()
        self._rows |= {row.task: row for row in news.value.rows}
        self._schedule_render()

    async def _read_questions(self) -> None:
        await self._handle_question_news(News(topic="questions", value=await self._api.questions.open()))

    async def _handle_question_news(self, news: News) -> None:
        if isinstance(news.value, OpenQuestions):
            self._asked_people = frozenset(question.person for question in news.value.questions)
            self._render()

    async def _retry(self, task: str, once: str) -> None:
        submitted = await self._api.tasks.retry(task, once=once)
        ui.navigate.to(task_path(submitted.task))

    def _tick(self) -> None:
        if any(row.phase is not Phase.ENDED for row in self._rows.values()):
            self._render()

    def _render(self) -> None:
        rows = sorted(self._rows.values(), key=lambda row: -row.submitted_at)
        self._filter.set_options(_choices(rows), value=self._filter.value)
        now = time.time()
        self._table.show_rows([_table_row(row, self._asked_people, now) for row in rows if self._matches_filter(row)])
        self._table.set_empty_text("No matching tasks." if rows else "There are no tasks yet. Create one with “New task”.")

    def _matches_filter(self, row: TaskRow) -> bool:
        words = str(self._search_field.value or "").lower().split()
        text = f"{row.effect} {person_name(row.client)} {' '.join(row.services)} {row.task_manager} {row.explanation} {row.task}".lower()
        return self._filter.value in (_ALL_TASKS, _kind(row)) and all(word in text for word in words)


def _choices(rows: Sequence[TaskRow]) -> dict[str, str]:
    """The filter's options with the number of tasks for each."""
    count = Counter(_kind(row) for row in rows)
    outcomes = {outcome.value: f"{label} {count[outcome.value]}" for outcome, label in OUTCOMES.items()}
    return {_ALL_TASKS: f"All {len(rows)}", _RUNNING: f"Running {count[_RUNNING]}", **outcomes}


def _kind(row: TaskRow) -> str:
    return row.outcome.value if row.outcome is not None else _RUNNING


def _table_row(row: TaskRow, asked_people: frozenset[str], now: float) -> dict[str, Any]:
    """A row of the table."""
    row_sign = task_sign(row)
    seconds = (row.ended_at if row.ended_at is not None else now) - row.submitted_at
    return {
        "task": row.task,
        "href": f"/tasks/{task_key(row.task)}",
        "far": row_sign.text,
        "icon": row_sign.icon,
        "tone": row_sign.tone,
        "percent": round(100 * row.fraction),
        "steps": f"{row.done} of {count_text(row.steps, 'step')}" if row.steps else "",
        "effect": row.effect,
        "note": " · ".join(_notes(row, asked_people)),
        "waits": wait_texts(row.waiting_for),
        "retry": f"Retry {row.effect}" if row.outcome is not None else "",
        "asks": join_names(sorted({device_name(service) for service in row.services} & asked_people)),
        "setbacks": f"{count_text(row.setbacks, 'setback')}" if row.setbacks else "",
        "at": row.submitted_at,
        "stated": format_time(row.submitted_at),
        "who": person_name(row.client),
        "manager": row.task_manager,
        "took": format_duration(max(0.0, seconds)) + ("" if row.outcome is not None else " so far"),
        "due": due_text(row.deadline, row.due_at, row.outcome is not None, now) if row.deadline is not None else "–",
        "priority": priority_text(row.priority),
    }


def _notes(row: TaskRow, asked_people: frozenset[str]) -> Iterator[str]:
    working = [name for name in dict.fromkeys(device_name(service) for service in row.services) if name not in asked_people]
    if row.outcome is None and working:
        yield f"{join_names(working)} working"
    if row.waiting_to_retry is not None:
        yield from hindrance_texts(row.waiting_to_retry)
    for reason in reasons(row)[:1] if row.waiting_for is None and row.waiting_to_retry is None else ():
        yield gist(reason[:1].upper() + reason[1:])
