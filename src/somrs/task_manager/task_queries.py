"""What clients read of tasks, once: tasks, messages and records. Clients that wait for news are in `subscriptions.py`.

Records of tasks that are over are read from the archive, which is outside the component.
"""

from __future__ import annotations

from itertools import islice

from somrs.kernel.component import Ask, Effect, Effects, Input, Received, Send
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Message, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.paging import fit_page
from somrs.protocol.messages.records import PARTS, ReadRecords, Records
from somrs.protocol.messages.task_news import Messages, ReadMessages, ReadTasks, Tasks, WatchTask, WatchTasks
from somrs.task_manager.state import TaskManagerState
from somrs.task_manager.timers import Answer, RecordsWanted
from somrs.task_manager.transaction.views import message_view, view_in_parts


def only_reads(event: Input) -> bool:
    """Whether an input is a query that changes nothing, is answered at once and on its connection: it may be lost with the process."""
    match event:
        case Received(Message(header=header, body=ReadTasks())):
            return header.reply_to == ANONYMOUS
        case Received(Message(header=header, body=WatchTask(wait=wait) | WatchTasks(wait=wait))):
            return header.reply_to == ANONYMOUS and wait <= 0
        case _:
            return False


class TaskQueries:
    """Answers the queries of clients. It has no state of its own."""

    def __init__(self, state: TaskManagerState) -> None:
        self._state = state

    def read_tasks(self, request: Message, query: ReadTasks) -> Effect:
        """Answer with the tasks in memory, newest first."""
        tasks = self._state.tasks
        matching_tasks = [task for task in tasks.values() if task.outcome is None or not query.running]
        newest = sorted(matching_tasks, key=lambda task: (task.submitted_at, task.id), reverse=True)
        if query.behind is not None:
            last_task = tasks.get(query.behind)
            newest = [
                task for task in newest if last_task is not None and (task.submitted_at, task.id) < (last_task.submitted_at, last_task.id)
            ]
        page = tuple(fit_page((view_in_parts(task, 0)[0] for task in newest), max(query.limit, 0)))
        return self._reply(request, Tasks(tasks=page, more=len(page) < len(newest), total=len(matching_tasks)))

    def read_messages(self, request: Message, query: ReadMessages) -> Effect:
        """Answer with messages of a task. Those of a running task are in its state; those of an ended task are in its record."""
        offset = max(query.after, 0)
        if query.task in self._state.running:
            passed = self._state.tasks[query.task].messages
            page = tuple(fit_page(message_view(entry.at, entry.message) for entry in islice(passed, offset, None)))
            return self._reply(request, Messages(messages=page, more=offset + len(page) < len(passed)))
        parts = tuple(name for name in PARTS if name != "messages")
        return self.read_records(request, ReadRecords(task=query.task, limit=1, after=offset, without=parts))

    def read_records(self, request: Message, query: ReadRecords) -> Effect:
        """Read records from the archive; `records_read` answers the request."""
        id = request.header.message_id
        self._state.awaiting_records[id] = request
        return Ask(RecordsWanted(id), query)

    def records_read(self, id: str, answer: Answer) -> Effects:
        """Answer the request of this id with the records from the archive."""
        if (request := self._state.awaiting_records.pop(id, None)) is not None:
            yield self._reply(request, _records_reply(request, answer))

    def _reply(self, request: Message, body: Body) -> Send:
        return Send(reply(request, body, self._state.requests.address))


def _records_reply(request: Message, answer: Answer) -> Body:
    """The reply to a client that requested records or messages."""
    match answer, request.body:
        case Records(), ReadRecords():
            return answer
        case Records(records=(record,)), ReadMessages():
            return Messages(messages=record.messages, more=answer.rest is not None)
        case Records(), ReadMessages(task=task):
            return Fault(code="env:Sender", text=f"there is no task {task} here")
        case _:
            return Fault(code="env:Receiver", text=f"the records cannot be read: {answer}")
