"""Tasks: stated, previewed, watched, cancelled."""

from __future__ import annotations

import msgspec

from somrs.app.desk.context import Context
from somrs.app.desk.operations import operation
from somrs.protocol.clients import (
    ContractView,
    Messages,
    MessageView,
    Preview,
    Previewed,
    Submit,
    Submitted,
    TaskEvent,
    TaskRow,
    TaskView,
)


class TaskList(msgspec.Struct, frozen=True, kw_only=True):
    """Tasks, newest first."""

    rows: tuple[TaskRow, ...]


class TaskSeen(msgspec.Struct, frozen=True, kw_only=True):
    """A task, all that happened to it, and who was asked for its steps, on which terms. `messages`: how many there are."""

    view: TaskView
    events: tuple[TaskEvent, ...]
    contracts: tuple[ContractView, ...] = ()
    messages: int = 0


class TasksChanged(msgspec.Struct, frozen=True, kw_only=True):
    """News of the topic `tasks`: those that changed, or came, as they are now. `anew`: these are all; forget the others."""

    rows: tuple[TaskRow, ...]
    anew: bool = False


class TaskChanged(msgspec.Struct, frozen=True, kw_only=True):
    """News of the topic `task ID`: the task as it is now, what happened since the news before, the contracts that changed, and how many
    messages there are. The first news after one begins to listen has all events and contracts."""

    view: TaskView
    events: tuple[TaskEvent, ...] = ()
    contracts: tuple[ContractView, ...] = ()
    messages: int = 0


class TasksDesk:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("POST", "/tasks")
    async def submit(self, body: Submit, once: str | None = None) -> Submitted:
        """State a task: have a formula made true.

        With `once`, a word of your own, the same task sent again with the same word is one task: for when no answer came.
        """
        return Submitted(task=await self._context.client.submit(body))

    @operation("POST", "/tasks/preview")
    async def preview(self, body: Preview) -> Previewed:
        """Plan, but do nothing: the steps, or why there are none; with `quotes`, what services would ask for them now."""
        return await self._context.client.preview(body.effect, body.precondition)

    @operation("GET", "/tasks")
    async def list(self, running: bool = False, limit: int = 50) -> TaskList:
        """The tasks that the Task Manager has in mind, newest first: all, or those that are not over."""
        return TaskList(rows=())

    @operation("GET", "/tasks/{id}")
    async def read(self, id: str) -> TaskSeen:
        """One task, whether it runs or is over. `id` may be the beginning of one."""
        view, events = await self._context.client.events(id)
        return TaskSeen(view=view, events=events)

    @operation("GET", "/tasks/{id}/messages")
    async def messages(self, id: str, after: int = 0) -> Messages:
        """The messages of a task's protocol behind the first so many, a page of them."""
        found: tuple[MessageView, ...] = ()
        return Messages(messages=found)

    @operation("POST", "/tasks/{id}/cancel")
    async def cancel(self, id: str, reason: str = "cancelled by the client") -> None:
        """Stop what runs, and undo what was done."""
        await self._context.client.cancel(id, reason)
