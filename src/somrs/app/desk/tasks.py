"""Tasks: stated, previewed, watched, cancelled."""

from __future__ import annotations

import msgspec

from somrs.app.desk.context import Context
from somrs.app.desk.operations import operation
from somrs.protocol.clients import Preview, Previewed, Submit, Submitted, TaskEvent, Tasks, TaskView


class TaskSeen(msgspec.Struct, frozen=True, kw_only=True):
    """A task, and all that happened to it."""

    view: TaskView
    events: tuple[TaskEvent, ...]


class TasksDesk:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("POST", "/tasks")
    async def submit(self, body: Submit) -> Submitted:
        """State a task: have a formula made true."""
        return Submitted(task=await self._context.client.submit(body))

    @operation("POST", "/tasks/preview")
    async def preview(self, body: Preview) -> Previewed:
        """Plan, but do nothing: the steps, or why there are none."""
        return await self._context.client.preview(body.effect, body.precondition)

    @operation("GET", "/tasks")
    async def list(self, running: bool = False, limit: int = 50) -> Tasks:
        """The tasks that the Task Manager has in mind, newest first: all, or those that are not over."""
        return Tasks(tasks=await self._context.client.tasks(running=running, limit=limit))

    @operation("GET", "/tasks/{id}")
    async def read(self, id: str) -> TaskSeen:
        """One task."""
        view, events = await self._context.client.events(id)
        return TaskSeen(view=view, events=events)

    @operation("POST", "/tasks/{id}/cancel")
    async def cancel(self, id: str, reason: str = "cancelled by the client") -> None:
        """Stop what runs, and undo what was done."""
        await self._context.client.cancel(id, reason)
