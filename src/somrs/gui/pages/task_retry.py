"""The retry of an ended task: a new task with the same goal and options."""

from __future__ import annotations

from uuid import uuid4

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.pages.task_text import task_path
from somrs.gui.shell import guarded
from somrs.protocol.messages.task_views import TaskView


class RetryButton(ui.button):
    """Submits the task once more, and shows the new task. A second click on the same page submits nothing."""

    def __init__(self, api: LiveApi, view: TaskView) -> None:
        super().__init__("Retry", icon="replay", on_click=guarded(self._retry))
        self._api, self._task, self._once = api, view.task, uuid4().hex
        self.props('outline dense no-caps aria-label="Retry this task"')

    async def _retry(self) -> None:
        submitted = await self._api.tasks.retry(self._task, once=self._once)
        ui.navigate.to(task_path(submitted.task))
