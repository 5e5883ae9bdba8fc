"""The first page: a board of what needs attention, what runs and who is ready, and a task to try."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlencode

from nicegui import ui

from somrs.api.fleet import Devices
from somrs.api.questions import OpenQuestions
from somrs.api.remote import LiveApi
from somrs.api.system import SystemView
from somrs.api.task_feed import TasksChanged
from somrs.client.hub import News
from somrs.gui.news import follow
from somrs.gui.pages.start import rows
from somrs.gui.pages.start.example_goal import example_goal, is_achieved
from somrs.gui.pages.start.row_list import RowList
from somrs.gui.question_panel import QuestionPanel
from somrs.gui.shell import page, page_at
from somrs.gui.throttle import Throttle
from somrs.protocol.messages.task_views import TaskRow

MOST_TASKS = 1000
"""Maximum number of tasks read and kept. The Task Manager keeps 200 ended ones."""

MOST_ROWS = 8
"""Rows in each list; links lead to the others."""


def register(api: LiveApi) -> None:
    @page_at("/")
    async def show_page() -> None:
        with page("Start", "/", api):
            _Board(api)


class _Board:
    """The page's content, updated in place."""

    def __init__(self, api: LiveApi) -> None:
        self._api = api
        self._tasks: dict[str, TaskRow] = {}
        self._has_questions = False
        self._unread = {"system", "tasks", "fleet", "questions"}
        """The topics that have not been read yet."""
        self._example: str | None = None
        self._example_key: tuple[frozenset[str], int] | None = None
        self._schedule_tasks = Throttle(self._show_tasks)
        with ui.element("div").classes("somrs-start"):
            with ui.element("div").classes("somrs-start-head"):
                self._site = ui.label("SO-MRS").classes("somrs-title").props("role=heading aria-level=1")
                self._size = ui.label().classes("somrs-soft")
            with _sheet("Needs attention", "somrs-start-attention"):
                self._outages = RowList("Parts that do not respond", MOST_ROWS, "/")
                QuestionPanel(api)
                self._unready = RowList("Devices that are not ready", MOST_ROWS, "/fleet")
                self._failed = RowList("Failed tasks", MOST_ROWS, "/history?outcome=failed&since=1d")
                self._orders = RowList("Standing orders that fail", MOST_ROWS, "/define")
                self._quiet = ui.label("Reading …").classes("somrs-soft").props('role="status"')
            with ui.element("div").classes("somrs-start-now"):
                with _sheet("Running tasks"):
                    self._running = RowList("Running tasks", MOST_ROWS, "/tasks")
                    self._no_task = ui.label("Reading …").classes("somrs-soft")
                with _sheet("Devices"):
                    self._devices = RowList("Devices", MOST_ROWS, "/fleet")
                    self._no_device = ui.label("Reading …").classes("somrs-soft")
                with _sheet("Parts of the system"):
                    self._parts = RowList("Parts of the system", MOST_ROWS, "/")
            with _sheet("Try a task") as self._try:
                ui.label("Open a new task with this goal, preview its plan, and start it:").classes("somrs-soft")
                self._try_link = ui.element("div")
            self._try.visible = False
        hub = api.context.hub
        follow(hub, "system", self._read_system, self._on_system_news)
        follow(hub, "questions", self._read_questions, self._on_question_news)
        follow(hub, "fleet", self._read_fleet, self._on_fleet_news)
        follow(hub, "tasks", self._read_tasks, self._on_task_news)
        follow(hub, "orders", self._read_orders, self._on_order_news)

    def _show_quiet(self, topic: str) -> None:
        """Say whether anything needs attention, after the topic was read."""
        self._unread.discard(topic)
        lists = (self._outages, self._unready, self._failed, self._orders)
        self._quiet.set_text("Reading …" if self._unread else "Nothing needs attention.")
        self._quiet.visible = not self._has_questions and all(row_list.is_empty for row_list in lists)

    # The system

    async def _read_system(self) -> None:
        self._show_system(await self._api.system.read())

    async def _on_system_news(self, news: News) -> None:
        if isinstance(news.value, SystemView):
            self._show_system(news.value)
        else:
            await self._read_system()

    def _show_system(self, system: SystemView) -> None:
        self._site.set_text(system.site or "SO-MRS")
        self._size.set_text(f"{system.objects} objects of {system.types} types, map version {system.map_version}")
        now = time.time()
        self._parts.show(rows.part_rows(system.parts, system.neighbours, system.neighbouring_maps, now))
        self._outages.show(rows.outage_rows(system.parts, system.neighbours, system.neighbouring_maps, now))
        self._show_quiet("system")

    # Questions

    async def _read_questions(self) -> None:
        self._show_questions(await self._api.questions.open())

    async def _on_question_news(self, news: News) -> None:
        if isinstance(news.value, OpenQuestions):
            self._show_questions(news.value)
        else:
            await self._read_questions()

    def _show_questions(self, open_questions: OpenQuestions) -> None:
        self._has_questions = bool(open_questions.questions)
        self._show_quiet("questions")

    # The fleet

    async def _read_fleet(self) -> None:
        self._show_fleet(await self._api.fleet.devices())

    async def _on_fleet_news(self, news: News) -> None:
        if isinstance(news.value, Devices):
            self._show_fleet(news.value)
        elif news.missed:
            await self._read_fleet()

    def _show_fleet(self, fleet: Devices) -> None:
        self._devices.show(rows.device_rows(fleet.devices))
        self._no_device.set_text("There are no devices on the map, and no services on offer.")
        self._no_device.visible = self._devices.is_empty
        self._unready.show(rows.unready_rows(fleet.devices))
        self._show_quiet("fleet")
        self._show_example(frozenset(service.type for device in fleet.devices for service in device.services if service.on_offer))

    def _show_example(self, service_types: frozenset[str]) -> None:
        """Show a goal to try. It stays while it is of use, as somebody may be about to follow the link."""
        context = self._api.context
        key = service_types, context.version
        if key == self._example_key:
            return
        is_of_use = self._example is not None and not is_achieved(self._example, context.map)
        same_services = self._example_key is not None and self._example_key[0] == service_types
        self._example_key = key
        if is_of_use and same_services:
            return
        example = example_goal(service_types, context.ontology, context.map)
        if example != self._example:
            self._example = example
            self._try_link.clear()
            if example is not None:
                with self._try_link:
                    ui.link(example, f"/define?{urlencode({'effect': example})}").classes("somrs-formula")
        self._try.visible = example is not None

    # Tasks

    async def _read_tasks(self) -> None:
        self._tasks = {task.task: task for task in (await self._api.tasks.list(limit=MOST_TASKS)).rows}
        self._show_tasks()

    async def _on_task_news(self, news: News) -> None:
        if not isinstance(news.value, TasksChanged):
            await self._read_tasks()
            return
        if news.value.anew:
            self._tasks.clear()
        tasks = (self._tasks | {task.task: task for task in news.value.rows}).values()
        self._tasks = {task.task: task for task in sorted(tasks, key=lambda task: -task.submitted_at)[:MOST_TASKS]}
        self._schedule_tasks()

    def _show_tasks(self) -> None:
        self._running.show(rows.running_rows(self._tasks.values()))
        self._no_task.set_text("No task is running.")
        self._no_task.visible = self._running.is_empty
        self._failed.show(rows.failed_rows(self._tasks.values(), time.time()))
        self._show_quiet("tasks")

    # Standing orders

    async def _read_orders(self) -> None:
        self._orders.show(rows.order_rows((await self._api.orders.orders()).orders))
        self._show_quiet("orders")

    async def _on_order_news(self, news: News) -> None:
        await self._read_orders()


@contextmanager
def _sheet(title: str, classes: str = "") -> Iterator[ui.element]:
    with ui.element("section").classes(f"somrs-sheet {classes}").props(f'aria-label="{title}"') as element:
        ui.label(title).classes("somrs-start-label").props("role=heading aria-level=2")
        yield element
