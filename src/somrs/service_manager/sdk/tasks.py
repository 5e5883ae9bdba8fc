"""How a device gives tasks to the Task Manager, as any other client does."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from somrs.errors import RemoteError
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.submission import Submit, Submitted, TaskRejected
from somrs.protocol.messages.task_news import TaskNews, WatchTask

Ask = Callable[[Body], Awaitable[Body]]
"""Sends a request to the Task Manager and returns the answer."""


class TaskSubmitter:
    """Submits tasks for a device."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    async def submit(self, task: Submit) -> str:
        """Submit a task, and return its id. Raises RemoteError when the Task Manager rejects it, or does not answer."""
        match await self._ask(task):
            case Submitted(task=id):
                return id
            case TaskRejected(problem=problem):
                raise RemoteError(problem)
            case answer:
                raise RemoteError(f"the Task Manager answered Submit with {_text(answer)}")

    async def is_running(self, task: str) -> bool:
        """Whether a task has not ended. A task that the Task Manager does not hold any more has ended."""
        match await self._ask(WatchTask(task=task, wait=0.0)):
            case TaskNews(view=view):
                return view.outcome is None
            case Fault():
                return False
            case answer:
                raise RemoteError(f"the Task Manager answered WatchTask with {_text(answer)}")


def _text(answer: Body) -> str:
    return answer.text if isinstance(answer, Fault) else type(answer).__name__
