"""The page of one task, running or ended: plan, scene, story, terms, timeline and messages."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.api.tasks import TaskChanged, TaskDetails
from somrs.client.hub import News
from somrs.client.refusals import NotFound
from somrs.errors import SomrsError, UsageError
from somrs.gui.components.task.chart import MessageChart
from somrs.gui.components.task.graph import PlanGraph
from somrs.gui.components.task.timeline import DeviceTimeline
from somrs.gui.news import follow
from somrs.gui.pages.task_bids import BidPanel
from somrs.gui.pages.task_findings import FindingsPanel
from somrs.gui.pages.task_header import TaskHeader
from somrs.gui.pages.task_scene import TaskScene
from somrs.gui.pages.task_story_panel import StoryPanel
from somrs.gui.panel import panel
from somrs.gui.question_panel import QuestionPanel
from somrs.gui.shell import page, page_at
from somrs.gui.throttle import Throttle
from somrs.gui.unavailable_banner import UnavailableBanner
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.task_views import ContractView, TaskEvent, TaskView

FIRST_READ_TIME = 2.0
"""Seconds for which the page waits for the task before it is shown without it."""

RETRY_DELAY = 2.0
"""Seconds after which a request to a Task Manager that does not answer is repeated."""


def register(api: LiveApi) -> None:
    @page_at("/tasks/{id}")
    async def show_page(id: str) -> None:
        with page("Task", "/tasks", api):
            await _TaskLoader(api, id).begin()


class _TaskLoader:
    """Shows a message until the task has been read."""

    def __init__(self, api: LiveApi, id: str) -> None:
        self._api, self._id = api, id
        self._place = ui.element("div").classes("somrs-task-page")

    async def begin(self) -> None:
        try:
            async with asyncio.timeout(FIRST_READ_TIME):
                await self._read()
        except TimeoutError:
            self._wait("Reading the task …")

    async def _read(self) -> None:
        try:
            snapshot = await self._api.tasks.read(self._id)
        except NotFound:
            self._show_message("search_off", f"There is no task {self._id}. “All tasks” has the current ones, “History” the ended ones.")
        except UsageError as error:  # several ids begin with this one
            self._show_message("search_off", f"{error}.")
        except SomrsError as error:
            self._wait(f"{error}; retrying")
        else:
            self._place.clear()
            with self._place:
                _TaskPage(self._api, snapshot)

    def _wait(self, text: str) -> None:
        self._show_message("hourglass_empty", text)
        with self._place:
            ui.timer(RETRY_DELAY, self._read, once=True)

    def _show_message(self, icon: str, text: str) -> None:
        self._place.clear()
        with self._place, ui.element("div").classes("somrs-sheet somrs-task-none").props('role="status"'):
            ui.icon(icon).props('aria-hidden="true"')
            ui.label(text).props('role="heading" aria-level="1"')
            ui.link("All tasks", "/tasks")
            ui.link("History", "/history")


class _TaskPage:
    """The page of a task that has been read; it is kept up to date."""

    def __init__(self, api: LiveApi, snapshot: TaskDetails) -> None:
        self._api, self._id = api, snapshot.view.task
        self._view = snapshot.view
        self._events: list[TaskEvent] = []
        self._contracts: dict[str, ContractView] = {}
        self._schedule_render = Throttle(self._render)
        ui.page_title(f"{snapshot.view.effect} · SO-MRS")
        UnavailableBanner(api, "Task Manager")
        self._header = TaskHeader(api, snapshot.view)
        self._questions = QuestionPanel(api, object_names=frozenset())
        with ui.element("div").classes("somrs-task-panels"):
            with ui.element("div").classes("somrs-task-column somrs-task-first"):
                self._findings: FindingsPanel | None = None
                if snapshot.view.recognise:
                    with panel("Findings", "visibility", "task findings", "somrs-task-findings") as findings_panel:
                        self._findings = FindingsPanel(findings_panel)
                with panel("Plan", "schema", "task plan", "somrs-task-plan"):
                    PlanGraph(task=self._id, label=f"The plan of task {short_id(self._id)}", empty="There is no plan.")
                with panel("Terms", "handshake", "task terms", "somrs-task-terms") as terms:
                    self._bids = BidPanel(terms)
                with panel("Timeline", "view_timeline", "task times", "somrs-task-times"):
                    DeviceTimeline(self._id)
            with ui.element("div").classes("somrs-task-column"):
                with panel("Scene", "map", "task scene", "somrs-task-scene"):
                    self._scene = TaskScene()
                with panel("Story", "auto_stories", "task story", "somrs-task-story") as story_panel:
                    self._story = StoryPanel(story_panel, self._id)
            wide = ui.element("div").classes("somrs-task-column somrs-task-wide")
            with wide, panel("Messages", "swap_horiz", "task messages", "somrs-task-messages"):
                MessageChart(self._id)
        self._add_news(snapshot.events, snapshot.contracts)
        self._render()
        follow(api.context.hub, f"task {self._id}", self._read, self._handle_news)

    async def _read(self) -> None:
        """Read the whole task again."""
        try:
            snapshot = await self._api.tasks.read(self._id)
        except SomrsError:
            ui.timer(RETRY_DELAY, self._read, once=True)
            return
        self._view = snapshot.view
        self._events.clear()
        self._contracts.clear()
        self._add_news(snapshot.events, snapshot.contracts)
        self._render()

    async def _handle_news(self, news: News) -> None:
        if not isinstance(news.value, TaskChanged):
            await self._read()
            return
        fresh = [event for event in news.value.events if event.number > len(self._events)]
        if fresh and fresh[0].number != len(self._events) + 1:
            await self._read()
            return
        self._view = news.value.view
        self._add_news(fresh, news.value.contracts)
        self._schedule_render()

    def _add_news(self, events: Sequence[TaskEvent], contracts: Sequence[ContractView]) -> None:
        self._events += events
        self._contracts |= {contract.participant: contract for contract in contracts}

    def _render(self) -> None:
        self._header.render(self._view)
        self._questions.set_objects(observed_objects(self._view))
        if self._findings is not None:
            self._findings.render(self._view)
        self._scene.render(self._view)
        self._story.render(self._view, self._events)
        self._bids.render([*self._contracts.values()], self._view.submitted_at)


def observed_objects(view: TaskView) -> frozenset[str]:
    """The objects that the task currently has observed; questions about them belong to the task."""
    observations = (work for work in view.work if work.state is State.EXECUTING and work.step.startswith("look"))
    return frozenset(thing for work in observations for thing in work.inputs.values())
