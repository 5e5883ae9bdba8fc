"""Who wants something: a client that repeats its requests, under the same ids, until it is answered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from somrs.kernel.component import Effect, Input, Received, Send, SetTimer, TimerFired
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import Cancelling, CancelTask, Preview, Previewed, Submit, Submitted, TaskRejected
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from verification.fault_runs.story import Wish

PATIENCE = 15.0
"""Seconds after which a request without an answer is made again."""


PREVIEW_PATIENCE = 60.0
"""As above, of previews: the Registry, the planner and services are asked on the way."""


def asked_id(number: int) -> str:
    """Of the message that asks what a wish would cost."""
    return message_id("what would it cost", number)


class Client:
    """`tasks` are the wishes that were taken, by their number, `rejected` those that were not, and why."""

    def __init__(self, wishes: Sequence[Wish]) -> None:
        self._wishes = wishes
        self.tasks: dict[int, str] = {}
        self.rejected: dict[int, str] = {}
        self.calling_off: dict[int, str] = {}
        """Tasks that were to be cancelled, and what was answered."""
        self.previews: dict[int, Previewed | Fault] = {}
        self._attempts: Counter[int] = Counter()

    @property
    def open(self) -> list[int]:
        """The wishes that were neither taken nor rejected."""
        return [number for number in range(len(self._wishes)) if number not in self.tasks and number not in self.rejected]

    @property
    def wants_previews(self) -> list[int]:
        return [n for n, wish in enumerate(self._wishes) if wish.previewed and n not in self.previews]

    @property
    def wants_to_cancel(self) -> list[int]:
        return [n for n in self.tasks if self._wishes[n].cancelled is not None and n not in self.calling_off]

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
            case Received(message) if (asked := message.header.relates_to) is not None:
                return self._answered(asked, message.body, now)
        return []

    def _submit(self, number: int, now: float) -> list[Effect]:
        if number not in self.open:
            return []
        wish = self._wishes[number]
        body = Submit(effect=wish.effect, policy=wish.policy, deadline=wish.deadline, handlers=wish.handlers, priority=wish.priority)
        return [self._send(self._id(number), wish.to, body, now), SetTimer(f"submit {number}", now + PATIENCE)]

    def _preview(self, number: int, now: float) -> list[Effect]:
        if number not in self.wants_previews:
            return []
        wish = self._wishes[number]
        body = Preview(effect=wish.effect, policy=wish.policy, deadline=wish.deadline, priority=wish.priority, quotes=True)
        return [self._send(asked_id(number), wish.to, body, now), SetTimer(f"preview {number}", now + PREVIEW_PATIENCE)]

    def _cancel(self, number: int, now: float) -> list[Effect]:
        if number in self.calling_off:
            return []
        body = CancelTask(task=self.tasks[number])
        return [self._send(message_id("cancel", number), self._wishes[number].to, body, now), SetTimer(f"cancel {number}", now + PATIENCE)]

    def _answered(self, asked: str, answer: Body, now: float) -> list[Effect]:
        for number, wish in enumerate(self._wishes):
            if asked == message_id("cancel", number) and isinstance(answer, Cancelling | Fault):
                self.calling_off.setdefault(number, answer.text if isinstance(answer, Fault) else "")
            elif asked == asked_id(number) and isinstance(answer, Previewed | Fault):
                self.previews.setdefault(number, answer)
            elif asked == self._id(number) and number in self.open:
                match answer:
                    case Submitted(task=task):
                        self.tasks[number] = task
                        return [SetTimer(f"cancel {number}", now + wish.cancelled)] if wish.cancelled is not None else []
                    case TaskRejected(problem=problem):
                        self.rejected[number] = problem
                    case Fault():  # the Task Manager does not know the map yet
                        self._attempts[number] += 1
                        return [SetTimer(f"submit {number}", now + PATIENCE)]
        return []

    def _id(self, number: int) -> str:
        return message_id("wish", number, self._attempts[number])

    @staticmethod
    def _send(id: str, to: str, body: Body, now: float) -> Send:
        return Send(Message(header=Header(sender="client", recipient=to, message_id=id, reply_to="client"), body=body), now + PATIENCE)
