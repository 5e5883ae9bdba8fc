"""All tasks that the Task Manager has in mind, newest first, as they go on."""

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
from somrs.client.hub import News
from somrs.client.state_labels import OUTCOMES
from somrs.client.task_report import reasons
from somrs.errors import SomrsError
from somrs.gui.components.task.list import TaskList
from somrs.gui.icons import clock, lasted, listed
from somrs.gui.news import follow
from somrs.gui.pages import task
from somrs.gui.pages.task_words import counted, device, due, gist, key, sign
from somrs.gui.shell import page
from somrs.gui.throttle import Soon
from somrs.gui.unavailable_banner import Silence
from somrs.protocol.messages.clients import Phase, TaskRow
from somrs.protocol.messages.people import person_name

MOST = 200
"""Tasks that are shown: as many as the Task Manager has in mind when they are over."""

AGAIN = 2.0
"""Seconds after which a Task Manager that does not answer is asked again."""

ALL, RUNNING = "all", "running"

COLUMNS: list[dict[str, Any]] = [
    {"name": "far", "label": "How far", "field": "far", "align": "left"},
    {"name": "effect", "label": "Wish", "field": "effect", "align": "left"},
    {"name": "stated", "label": "Stated", "field": "at", "align": "left"},
    {"name": "took", "label": "Time", "field": "seconds", "align": "left"},
    {"name": "due", "label": "Deadline", "field": "due", "align": "left"},
    {"name": "priority", "label": "Priority", "field": "priority", "align": "left"},
]


def register(desk: LiveApi) -> None:
    task.register(desk)

    @ui.page("/tasks")
    async def show() -> None:
        with page("Tasks", "/tasks", desk):
            _Tasks(desk)


class _Tasks:
    def __init__(self, desk: LiveApi) -> None:
        self._desk = desk
        self._rows: dict[str, TaskRow] = {}
        self._asked: frozenset[str] = frozenset()
        self._change = Soon(self._show)
        with ui.element("div").classes("somrs-tasks-head"):
            ui.label("Tasks").classes("somrs-title").props('role="heading" aria-level="1"')
            self._which = ui.toggle(_choices([]), value=ALL, on_change=self._show).props("no-caps dense unelevated")
            self._wanted = ui.input(placeholder="Find in wishes, people, services", on_change=self._show).props(
                'dense outlined clearable type=search aria-label="Find"'
            )
            self._wanted.classes("somrs-tasks-find")
            new = ui.button("New task", icon="add_task", on_click=lambda: ui.navigate.to("/define"))
            new.props("unelevated no-caps color=primary").classes("somrs-tasks-new")
        Silence(desk, "Task Manager")
        self._table = TaskList(COLUMNS, "Reading the tasks …").classes("somrs-tasks somrs-sheet")
        with ui.element("p").classes("somrs-soft somrs-tasks-foot"):
            ui.label("Older tasks are in the")
            ui.link("History", "/history")
        follow(desk.context.hub, "tasks", self._read, self._hear)
        follow(desk.context.hub, "questions", self._read_questions, self._hear_questions)
        ui.timer(1.0, self._tick)

    async def _read(self) -> None:
        while True:
            try:
                found = await self._desk.tasks.list(limit=MOST)
                break
            except SomrsError as error:
                self._table.say(f"{error}; asking again")
                await asyncio.sleep(AGAIN)
        self._rows = {row.task: row for row in found.rows}
        self._show()

    async def _hear(self, news: News) -> None:
        if not isinstance(news.value, TasksChanged):
            await self._read()
            return
        if news.value.anew:
            self._rows.clear()
        self._rows |= {row.task: row for row in news.value.rows}
        self._change()

    async def _read_questions(self) -> None:
        await self._hear_questions(News(topic="questions", value=await self._desk.questions.open()))

    async def _hear_questions(self, news: News) -> None:
        if isinstance(news.value, OpenQuestions):
            self._asked = frozenset(question.person for question in news.value.questions)
            self._show()

    def _tick(self) -> None:
        if any(row.phase is not Phase.ENDED for row in self._rows.values()):
            self._show()

    def _show(self) -> None:
        rows = sorted(self._rows.values(), key=lambda row: -row.submitted_at)[:MOST]
        self._which.set_options(_choices(rows), value=self._which.value)
        now = time.time()
        self._table.show([_told(row, self._asked, now) for row in rows if self._is_wanted(row)])
        self._table.say("No task is like that." if rows else "There are no tasks yet. State one with “New task”.")

    def _is_wanted(self, row: TaskRow) -> bool:
        words = str(self._wanted.value or "").lower().split()
        text = f"{row.effect} {person_name(row.client)} {' '.join(row.services)} {row.explanation} {row.task}".lower()
        return self._which.value in (ALL, _kind(row)) and all(word in text for word in words)


def _choices(rows: Sequence[TaskRow]) -> dict[str, str]:
    """Which tasks can be shown, and how many each are; before any were read, there are none."""
    count = Counter(_kind(row) for row in rows)
    outcomes = {outcome.value: f"{label} {count[outcome.value]}" for outcome, label in OUTCOMES.items()}
    return {ALL: f"All {len(rows)}", RUNNING: f"Under way {count[RUNNING]}", **outcomes}


def _kind(row: TaskRow) -> str:
    return row.outcome.value if row.outcome is not None else RUNNING


def _told(row: TaskRow, asked: frozenset[str], now: float) -> dict[str, Any]:
    """A row as the table shows it."""
    found = sign(row.phase, row.outcome)
    seconds = (row.ended_at if row.ended_at is not None else now) - row.submitted_at
    return {
        "task": row.task,
        "href": f"/tasks/{key(row.task)}",
        "far": found.text,
        "icon": found.icon,
        "tone": found.tone,
        "percent": round(100 * row.fraction),
        "steps": f"{row.done} of {counted(row.steps, 'step')}" if row.steps else "",
        "effect": row.effect,
        "note": " · ".join(_notes(row, asked)),
        "asks": listed(sorted({device(service) for service in row.services} & asked)),
        "setbacks": f"{counted(row.setbacks, 'setback')}" if row.setbacks else "",
        "at": row.submitted_at,
        "stated": clock(row.submitted_at),
        "who": person_name(row.client),
        "took": lasted(max(0.0, seconds)) + ("" if row.outcome is not None else " so far"),
        "due": due(row.submitted_at, row.deadline, row.outcome is not None, now) if row.deadline is not None else "–",
        "priority": row.priority,
    }


def _notes(row: TaskRow, asked: frozenset[str]) -> Iterator[str]:
    working = [name for name in dict.fromkeys(device(service) for service in row.services) if name not in asked]
    if row.outcome is None and working:
        yield f"{listed(working)} at work"
    for reason in reasons(row)[:1]:
        yield gist(reason[:1].upper() + reason[1:])
