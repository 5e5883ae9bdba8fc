"""Tasks: submission, previews, reading and cancellation."""

from __future__ import annotations

import msgspec

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.api.task_feed import TaskChanged, TaskFeed, TasksChanged, final_contracts
from somrs.client.client import PATIENCE
from somrs.client.message_chart import chart
from somrs.client.operations import Document, operation
from somrs.client.refusals import NotFound
from somrs.client.task_history import TaskHistory
from somrs.client.task_managers import silent_text
from somrs.client.task_report import is_named, repetition
from somrs.client.task_report import view as view_of
from somrs.client.trace import lines_from, without_heartbeats
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages.envelope import message_id
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.findings import Findings
from somrs.protocol.messages.people import person_name
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.records import ReadRecords
from somrs.protocol.messages.submission import Submit, Submitted
from somrs.protocol.messages.task_news import Messages
from somrs.protocol.messages.task_views import ContractView, Phase, TaskEvent, TaskRow, TaskView
from somrs.runtime.wire import Unanswered

__all__ = ["PauseState", "TaskChanged", "TaskDetails", "TaskList", "TaskService", "TasksChanged"]

_WHOLE_ID = len("urn:uuid:00000000-0000-0000-0000-000000000000")

MOST_NAMED = 5
"""Maximum number of records read to find the tasks whose ids begin with a text."""


class TaskList(msgspec.Struct, frozen=True, kw_only=True):
    """A page of tasks, newest first. `more`: another page follows, behind the last task of this one. `total`: the number of tasks on all
    pages. `silent`: the Task Managers that do not answer; their tasks are missing."""

    rows: tuple[TaskRow, ...]
    more: bool = False
    total: int = 0
    silent: tuple[str, ...] = ()


class TaskDetails(msgspec.Struct, frozen=True, kw_only=True):
    """A task, its events, and the contracts and terms of its participants. `messages`: the number of its messages; None if the task is read
    from its record."""

    view: TaskView
    events: tuple[TaskEvent, ...]
    contracts: tuple[ContractView, ...] = ()
    messages: int | None = None


class PauseState(msgspec.Struct, frozen=True, kw_only=True):
    """Whether a task is paused. One that has ended is not."""

    task: str
    paused: bool


class TaskService:
    """Tasks. The topic `tasks` has the news of all tasks (`TasksChanged`), `task ID` those of one (`TaskChanged`): subscribe, then read."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._client = context.client
        self._task_feed = TaskFeed(context.client, context.hub)

    @operation("POST", "/tasks", Right.OPERATE)
    async def submit(self, body: Submit, once: str | None = None, by: str | None = None, task_manager: str | None = None) -> Submitted:
        """Submit a task: a goal to achieve, as a formula.

        `once`: an idempotency key of your choice. Submissions with the same key are one task, so that a request can be repeated if no
        response arrived. `by`: the author of the task. `task_manager`: the name of the Task Manager that is to have it; by default, the one
        with the fewest open tasks takes it.
        """
        id = message_id("task", "once", once) if once is not None else None
        return Submitted(task=await self._client.submit(body, PATIENCE, id, by, task_manager))

    @operation("POST", "/tasks/preview", Right.OPERATE)
    async def preview(self, body: Preview) -> Previewed:
        """Plan without executing: return the steps, or why there are none; with `quotes`, also the terms that services would offer now."""
        return await self._client.preview(body)

    @operation("GET", "/tasks", Right.SEE)
    async def list(self, running: bool = False, limit: int = 50, behind: str | None = None) -> TaskList:
        """List the tasks that the Task Managers hold, newest first: all, or with `running` those that have not ended.

        If `more` is true in the result, there is a next page: pass the last task of this page as `behind`. `total` counts the tasks on all
        pages.
        """
        if limit < 1:
            raise UsageError(f"limit is the number of tasks on a page, at least 1, and not {limit}")
        listing = await self._client.rows()
        held = listing.items
        start = 0
        if behind is not None:
            ids = [row.task for row in held]
            if behind not in ids:
                raise UsageError(f"the Task Managers hold no task {behind}; read the list again, without behind")
            start = ids.index(behind) + 1
        listed = [row for row in held if not running or row.phase is not Phase.ENDED]
        following = [row for row in held[start:] if not running or row.phase is not Phase.ENDED]
        return TaskList(rows=tuple(following[:limit]), more=len(following) > limit, total=len(listed), silent=listing.silent)

    @operation("GET", "/tasks/{id}", Right.SEE)
    async def read(self, id: str) -> TaskDetails:
        """Read a running or ended task. `id` may be the beginning of the task's id."""
        task = await self._complete_id(id)
        return await self._read_current(task) or await self._read_recorded(task)

    @operation("GET", "/tasks/{id}/findings", Right.SEE)
    async def findings(self, id: str) -> Findings:
        """Read the answer to a task that asks what is so (`recognise`): for which objects and values the formula holds, who saw them, and
        when. An error while the task runs, and for a task that makes something so."""
        view = (await self.read(id)).view
        if view.findings is not None:
            return view.findings
        raise UsageError(
            f"task {short_id(view.task)} has not ended yet"
            if view.recognise
            else f"task {short_id(view.task)} makes {view.effect} so; only a task with `recognise` has findings"
        )

    @operation("GET", "/tasks/{id}/messages", Right.SEE)
    async def messages(self, id: str, after: int = 0) -> Messages:
        """Read a page of the protocol messages of a task. `after`: the number of messages to skip."""
        return await self._client.messages(await self._complete_id(id), after)

    @operation("GET", "/tasks/{id}/chart", Right.SEE)
    async def chart(self, id: str) -> Document:
        """Draw the messages of a task as a sequence chart (SVG). Of consecutive heartbeats, only the last is shown."""
        task = await self._complete_id(id)
        messages = await self._client.all_messages(task)
        details = await self.read(task)
        svg = chart(without_heartbeats(lines_from(messages, task)), details.view.effect)
        return Document(content=svg.encode(), media_type="image/svg+xml", name=f"messages-{short_id(task)}.svg")

    @operation("POST", "/tasks/{id}/cancel", Right.OPERATE)
    async def cancel(self, id: str, reason: str = "", by: str = "") -> None:
        """Cancel a task: stop its running steps, and compensate the completed ones. `reason` and `by` are recorded with it."""
        author = person_name(by) if by else "the client"
        text = f"{reason} ({author})" if reason and by else reason or f"cancelled by {author}"
        await self._client.cancel(await self._complete_id(id), text)

    @operation("POST", "/tasks/{id}/pause", Right.OPERATE)
    async def pause(self, id: str, by: str = "") -> PauseState:
        """Pause a task: the devices that work for it stand still, and nothing of it begins. Other tasks go on. Its deadline stays."""
        task = await self._complete_id(id)
        return PauseState(task=task, paused=await self._client.pause(task, by))

    @operation("POST", "/tasks/{id}/resume", Right.OPERATE)
    async def resume(self, id: str, by: str = "") -> PauseState:
        """Let a paused task go on, where it was."""
        task = await self._complete_id(id)
        return PauseState(task=task, paused=await self._client.pause(task, by, paused=False))

    @operation("POST", "/tasks/{id}/retry", Right.OPERATE)
    async def retry(self, id: str, once: str | None = None, by: str | None = None) -> Submitted:
        """Submit an ended task once more, with the same goal and options. The new task names the old one (`retry_of`).

        `once`, `by`: as for a new task.
        """
        return await self.submit(repetition((await self.read(id)).view), once, by)

    async def _read_current(self, task: str) -> TaskDetails | None:
        """The task as the Task Manager holds it; None if it does not."""
        try:
            news = await self._client.read_task(task)
        except Unanswered:
            raise
        except RemoteError:
            return None
        has_ended = news.view.phase is Phase.ENDED
        contracts = await final_contracts(self._client, task) if has_ended else news.contracts
        return TaskDetails(view=news.view, events=news.events, contracts=contracts, messages=news.messages)

    async def _read_recorded(self, task: str) -> TaskDetails:
        """The ended task according to its record. Raises NotFound if there is none."""
        records = await TaskHistory(self._client.records).first(ReadRecords(task=task, without=("messages",)), 1)
        if not records:
            raise _task_not_found(task)
        return TaskDetails(view=view_of(records[0]), events=records[0].events, contracts=records[0].contracts)

    async def _complete_id(self, name: str) -> str:
        """The complete id of the task whose id begins with `name`. Raises NotFound for no task, UsageError for several."""
        if len(name) == _WHOLE_ID and name.startswith("urn:uuid:"):
            return name
        listing = await self._client.rows()
        known_ids = [row.task for row in listing]
        records = await TaskHistory(self._client.records).first(ReadRecords(task=name, brief=True), MOST_NAMED) if name else []
        matches = [*dict.fromkeys(id for id in (*known_ids, *(record.task for record in records)) if is_named(id, name))]
        if not matches:
            raise _task_not_found(name, silent_text(listing.silent))
        if len(matches) > 1:
            raise UsageError(f"{len(matches)} tasks or more begin with {name}; give more of the id")
        return matches[0]


def _task_not_found(task: str, reason: str = "") -> NotFound:
    return NotFound(f"there is no task {task}; {reason or '`/tasks` lists current tasks, and `/records` lists ended ones'}")
