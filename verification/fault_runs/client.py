"""A client that submits tasks and repeats each request, with the same id, until it gets an answer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from somrs.kernel.component import Effect, Input, Received, Send, SetTimer, TimerFired
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.submission import Cancelling, CancelTask, Submit, Submitted, TaskRejected
from verification.fault_runs.scenario import TaskRequest

PATIENCE = 15.0
"""Seconds after which a request without an answer is repeated."""


PREVIEW_PATIENCE = 60.0
"""The same for previews, which take longer: the Task Manager consults the Registry, the planner and services first."""


def preview_id(number: int) -> str:
    """Return the id of the message that requests a preview."""
    return message_id("what would it cost", number)


class Client:
    """The client. `tasks` maps the number of each accepted request to its task, `rejected` that of each rejected one to the reason."""

    def __init__(self, requests: Sequence[TaskRequest]) -> None:
        self._requests = requests
        self.tasks: dict[int, str] = {}
        self.rejected: dict[int, str] = {}
        self.cancellations: dict[int, str] = {}
        """The answers to cancellations, by the number of the request."""
        self.previews: dict[int, Previewed | Fault] = {}
        self._attempts: Counter[int] = Counter()

    @property
    def open_requests(self) -> list[int]:
        """The requests that were neither accepted nor rejected yet."""
        return [number for number in range(len(self._requests)) if number not in self.tasks and number not in self.rejected]

    @property
    def pending_previews(self) -> list[int]:
        return [n for n, request in enumerate(self._requests) if request.previewed and n not in self.previews]

    @property
    def pending_cancellations(self) -> list[int]:
        return [n for n in self.tasks if self._requests[n].cancelled is not None and n not in self.cancellations]

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case TimerFired(timer):
                kind, _, number = str(timer).partition(" ")
                match kind:
                    case "submit":
                        return [*self._preview(int(number), now), *self._submit(int(number), now)]
                    case "preview":
                        return self._preview(int(number), now)
                return self._cancel(int(number), now)
            case Received(message) if (request_id := message.header.relates_to) is not None:
                return self._answered(request_id, message.body, now)
        return []

    def _submit(self, number: int, now: float) -> list[Effect]:
        if number not in self.open_requests:
            return []
        request = self._requests[number]
        body = Submit(
            effect=request.effect,
            policy=request.policy,
            deadline=request.deadline,
            handlers=request.handlers,
            priority=request.priority,
            waits=request.waits,
            recognise=request.recognise,
        )
        return [self._send(self._id(number), request.task_manager, body, now), SetTimer(f"submit {number}", now + PATIENCE)]

    def _preview(self, number: int, now: float) -> list[Effect]:
        if number not in self.pending_previews:
            return []
        request = self._requests[number]
        body = Preview(
            effect=request.effect,
            policy=request.policy,
            deadline=request.deadline,
            priority=request.priority,
            quotes=True,
            recognise=request.recognise,
        )
        return [self._send(preview_id(number), request.task_manager, body, now), SetTimer(f"preview {number}", now + PREVIEW_PATIENCE)]

    def _cancel(self, number: int, now: float) -> list[Effect]:
        if number in self.cancellations:
            return []
        body = CancelTask(task=self.tasks[number])
        return [
            self._send(message_id("cancel", number), self._requests[number].task_manager, body, now),
            SetTimer(f"cancel {number}", now + PATIENCE),
        ]

    def _answered(self, request_id: str, answer: Body, now: float) -> list[Effect]:
        for number, request in enumerate(self._requests):
            if request_id == message_id("cancel", number) and isinstance(answer, Cancelling | Fault):
                self.cancellations.setdefault(number, answer.text if isinstance(answer, Fault) else "")
            elif request_id == preview_id(number) and isinstance(answer, Previewed | Fault):
                self.previews.setdefault(number, answer)
            elif request_id == self._id(number) and number in self.open_requests:
                match answer:
                    case Submitted(task=task):
                        self.tasks[number] = task
                        return [SetTimer(f"cancel {number}", now + request.cancelled)] if request.cancelled is not None else []
                    case TaskRejected(problem=problem):
                        self.rejected[number] = problem
                    case Fault():  # the Task Manager does not know the map yet
                        self._attempts[number] += 1
                        return [SetTimer(f"submit {number}", now + PATIENCE)]
        return []

    def _id(self, number: int) -> str:
        return message_id("wish", number, self._attempts[number])

    @staticmethod
    def _send(id: str, recipient: str, body: Body, now: float) -> Send:
        return Send(
            Message(header=Header(sender="client", recipient=recipient, message_id=id, reply_to="client"), body=body), now + PATIENCE
        )
