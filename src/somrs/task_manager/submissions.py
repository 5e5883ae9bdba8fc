"""The submissions of tasks: which of them are new tasks of this Task Manager.

A submission may have been sent to other Task Managers, too (`SubmitOnce`). The Repository then says whose task it is: the first Task
Manager that asks has it. A Task Manager that asks keeps asking, also after a restart, so that a task that was given to it is done.
"""

from __future__ import annotations

from somrs.kernel.component import EffectsReturning, Send
from somrs.ontology.homes import full_text
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Message, message_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.reservations import TaskAssigned
from somrs.protocol.messages.submission import Submit, SubmitOnce, Submitted, with_formulas
from somrs.task_manager.context import find_task_error, rejection
from somrs.task_manager.state import TaskManagerState
from somrs.task_manager.transaction.state import TaskState


class Submissions:
    """Answers submissions. It has no state of its own."""

    def __init__(self, state: TaskManagerState) -> None:
        self._state = state

    def receive(self, message: Message, now: float) -> EffectsReturning[Message | None]:
        """Handle a submission. Returns it if its task is new and begins here now."""
        state, id = self._state, submitted_id(message)
        if id in state.tasks:
            yield self.acceptance(message)
        elif (task_error := find_task_error(_submitted_task(message), state.replica)) is not None:
            yield self._reply(message, rejection(task_error))
        elif isinstance(message.body, Submit):
            return self._add_task(message, now)
        else:
            is_repeated = id in state.awaiting_assignment
            state.awaiting_assignment[id] = message
            if not is_repeated:
                yield from state.requests.assign(id, now)
        return None

    def assigned(self, id: str, answer: TaskAssigned | Fault, now: float) -> EffectsReturning[Message | None]:
        """Handle the answer of the Repository. Returns the submission if its task begins here now."""
        message = self._state.awaiting_assignment.pop(id, None)
        if message is None:
            return None
        match answer:
            case TaskAssigned(task_manager=address) if address == self._state.requests.address:
                return self._add_task(message, now)
            case TaskAssigned() | Fault():
                yield self._reply(message, answer)
        return None

    def acceptance(self, message: Message) -> Send:
        """The reply to the submission of a task that this Task Manager has."""
        id = submitted_id(message)
        if isinstance(message.body, Submit):
            return self._reply(message, Submitted(task=id))
        return self._reply(message, TaskAssigned(task=id, task_manager=self._state.requests.address))

    def _add_task(self, message: Message, now: float) -> Message:
        id = submitted_id(message)
        task = self._with_full_names(_submitted_task(message))
        self._state.tasks[id] = TaskState.new(id, task, now, client=message.header.sender)
        self._state.running.append(id)
        return message

    def _with_full_names(self, task: Submit) -> Submit:
        """The task with the full names of objects: others may get the short ones later. A handler may have variables of its own."""
        map, ontology = self._state.replica.map, self._state.replica.ontology
        return with_formulas(task, lambda text: full_text(text, map, ontology))

    def _reply(self, request: Message, body: Body) -> Send:
        return Send(reply(request, body, self._state.requests.address))


def submitted_id(message: Message) -> str:
    """The id of the task that the message submits."""
    return message_id("task", message.header.message_id)


def _submitted_task(message: Message) -> Submit:
    body = message.body
    assert isinstance(body, Submit | SubmitOnce)
    return body if isinstance(body, Submit) else body.submission
