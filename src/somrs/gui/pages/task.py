"""The page of one task, as it goes on or as it was: its plan, the scene, its story, who bid what, the times, and the messages."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.api.tasks import TaskChanged, TaskDetails
from somrs.client.hub import News
from somrs.client.refusals import NotFound
from somrs.errors import SomrsError
from somrs.gui.components.task.chart import MessageChart
from somrs.gui.components.task.graph import PlanGraph
from somrs.gui.components.task.timeline import DeviceTimeline
from somrs.gui.news import follow
from somrs.gui.pages.task_head import Head
from somrs.gui.pages.task_scene import Scene
from somrs.gui.pages.task_telling import Telling
from somrs.gui.pages.task_terms import Terms
from somrs.gui.pages.task_words import key
from somrs.gui.panel import panel
from somrs.gui.question_panel import Asked
from somrs.gui.shell import page
from somrs.gui.throttle import Soon
from somrs.gui.unavailable_banner import Silence
from somrs.protocol.messages.clients import ContractView, TaskEvent, TaskView
from somrs.protocol.messages.frp import State

AT_ONCE = 2.0
"""Seconds for which the page waits for the task before it is sent without it."""

AGAIN = 2.0
"""Seconds after which a Task Manager that does not answer is asked again."""


def register(desk: LiveApi) -> None:
    @ui.page("/tasks/{id}")
    async def show(id: str) -> None:
        with page("Task", "/tasks", desk):
            await _Opening(desk, id).begin()


class _Opening:
    """Until the task was read."""

    def __init__(self, desk: LiveApi, id: str) -> None:
        self._desk, self._id = desk, id
        self._place = ui.element("div").classes("somrs-task-page")

    async def begin(self) -> None:
        try:
            async with asyncio.timeout(AT_ONCE):
                await self._read()
        except TimeoutError:
            self._wait("Reading the task …")

    async def _read(self) -> None:
        try:
            seen = await self._desk.tasks.read(self._id)
        except NotFound as error:
            self._say("search_off", str(error))
        except SomrsError as error:
            self._wait(f"{error}; asking again")
        else:
            self._place.clear()
            with self._place:
                _Seen(self._desk, seen)

    def _wait(self, text: str) -> None:
        self._say("hourglass_empty", text)
        with self._place:
            ui.timer(AGAIN, self._read, once=True)

    def _say(self, icon: str, text: str) -> None:
        self._place.clear()
        with self._place, ui.element("div").classes("somrs-sheet somrs-task-none").props('role="status"'):
            ui.icon(icon).props('aria-hidden="true"')
            ui.label(text)
            ui.link("All tasks", "/tasks")


class _Seen:
    """The page of a task that was read: kept up to date until it is closed."""

    def __init__(self, desk: LiveApi, seen: TaskDetails) -> None:
        self._desk, self._id = desk, seen.view.task
        self._view = seen.view
        self._events: list[TaskEvent] = []
        self._contracts: dict[str, ContractView] = {}
        self._change = Soon(self._show)
        ui.page_title(f"{seen.view.effect} · SO-MRS")
        Silence(desk, "Task Manager")
        self._head = Head(desk, seen.view)
        self._asked = Asked(desk, about=frozenset())
        with ui.element("div").classes("somrs-task-panels"):
            with ui.element("div").classes("somrs-task-column somrs-task-first"):
                with panel("Plan", "schema", "task plan", "somrs-task-plan"):
                    PlanGraph(task=self._id, label=f"The plan of task {key(self._id)[:8]}", empty="There is no plan.")
                with panel("Terms", "handshake", "task terms", "somrs-task-terms") as terms:
                    self._terms = Terms(terms)
                with panel("Times", "view_timeline", "task times", "somrs-task-times"):
                    DeviceTimeline(self._id)
            with ui.element("div").classes("somrs-task-column"):
                with panel("Scene", "map", "task scene", "somrs-task-scene"):
                    self._scene = Scene()
                with panel("Story", "auto_stories", "task story", "somrs-task-story") as told:
                    self._telling = Telling(told, self._id)
            wide = ui.element("div").classes("somrs-task-column somrs-task-wide")
            with wide, panel("Messages", "swap_horiz", "task messages", "somrs-task-messages"):
                MessageChart(self._id)
        self._take(seen.events, seen.contracts)
        self._show()
        follow(desk.context.hub, f"task {self._id}", self._read, self._hear)

    async def _read(self) -> None:
        """Everything, anew."""
        try:
            seen = await self._desk.tasks.read(self._id)
        except SomrsError:
            ui.timer(AGAIN, self._read, once=True)
            return
        self._view = seen.view
        self._events.clear()
        self._contracts.clear()
        self._take(seen.events, seen.contracts)
        self._show()

    async def _hear(self, news: News) -> None:
        if not isinstance(news.value, TaskChanged):
            await self._read()
            return
        fresh = [event for event in news.value.events if event.number > len(self._events)]
        if fresh and fresh[0].number != len(self._events) + 1:
            await self._read()
            return
        self._view = news.value.view
        self._take(fresh, news.value.contracts)
        self._change()

    def _take(self, events: Sequence[TaskEvent], contracts: Sequence[ContractView]) -> None:
        self._events += events
        self._contracts |= {one.participant: one for one in contracts}

    def _show(self) -> None:
        self._head.show(self._view)
        self._asked.ask_about(asked_about(self._view))
        self._scene.show(self._view)
        self._telling.show(self._view, self._events)
        self._terms.show([*self._contracts.values()], self._view.submitted_at)


def asked_about(view: TaskView) -> frozenset[str]:
    """Of what somebody is to find out now how it is: questions about it are the task's."""
    looks = (work for work in view.work if work.state is State.EXECUTING and work.step.startswith("look"))
    return frozenset(thing for work in looks for thing in work.inputs.values())
