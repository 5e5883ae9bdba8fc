"""The wait of a task for a Repository that does not answer: the one of the Task Manager, or a neighbour of it."""

from __future__ import annotations

from somrs.protocol.messages.waits import RepositoryAnswered, WaitsForRepository
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import AwaitedAnswer


class RepositoryWait:
    """Notes the wait of one task, and its end. It has no state of its own."""

    def __init__(self, scope: TaskScope) -> None:
        self._scope, self._state = scope, scope.state

    def begin(self, request: str, wait: WaitsForRepository, now: float) -> None:
        """A request of the task is not answered. Of several, the first counts; and a neighbour that is known by its name counts more."""
        awaited = self._state.awaited_answer
        if awaited is None or (wait.map and wait.map != awaited.wait.map):
            self._state.awaited_answer = AwaitedAnswer(request, wait)
            self._scope.log_event(wait, now)

    def end(self, now: float) -> None:
        """End the wait if its request is answered."""
        awaited = self._state.awaited_answer
        if awaited is not None and awaited.request not in self._scope.context.requests.pending:
            self._state.awaited_answer = None
            self._scope.log_event(RepositoryAnswered(map=awaited.wait.map, seconds=now - awaited.wait.since), now)
