"""The wait of a task's goal that cannot be reached now, for reasons that pass (docs/decisions/0031): its begin, its attempts, its end."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from somrs.kernel.component import Effects, SetTimer
from somrs.protocol.messages import waits
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.task_views import Phase
from somrs.protocol.messages.waits import WaitsToRetry
from somrs.task_manager.timers import RetryDue
from somrs.task_manager.transaction.retry import FIRST_PAUSE, hastened, is_repeated, next_wait
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import GoalExecution


class RetryWait:
    """Continues the wait of one goal. It has no state of its own."""

    def __init__(self, execution: GoalExecution, scope: TaskScope) -> None:
        self._execution, self._scope, self._context = execution, scope, scope.context

    @property
    def is_allowed(self) -> bool:
        """Whether the goal may wait at all."""
        return self._execution.kind is GoalKind.TASK and self._scope.state.task.waits

    def passing_hindrances(self, now: float) -> dict[str, str]:
        """The hindrances for which the goal may wait, by subject: services that may be available later, and work of which nobody has said
        how it ended. Its service was given up, and may be back: what it left, and what it can undo, may lead on."""
        if not self.is_allowed:
            return {}
        state, services = self._scope.state, self._scope.services.passing_hindrances(now)
        awaited = (work.service for work in state.log.interrupted() if state.members.is_awaited(work.participant))
        return {**dict.fromkeys(awaited, "has not said yet how its work ended"), **services}

    def begin(self, hindrances: Mapping[str, str], now: float) -> Effects:
        """Wait until the next attempt. The caller has withdrawn all calls and dismissed all participants that have not begun."""
        execution, task = self._execution, self._scope.state.id
        yield from self._scope.reserving.release(now)
        earliest = min(map(self._scope.services.back_at, hindrances), default=now)
        wait = next_wait(execution.waiting_to_retry, hindrances, now, earliest)
        is_news = not is_repeated(wait, execution.waiting_to_retry)
        self._scope.log.end_attempt(is_news=is_news)
        if is_news:
            self._scope.log_event(wait, now)
        execution.replans.wait()
        execution.phase, execution.waiting_to_retry, execution.retry_at = Phase.WAITING, wait, wait.next_attempt
        execution.replan_because = None
        self._context.touched[task] = None
        yield SetTimer(RetryDue(task), execution.retry_at)
        yield from self._context.follow_arrivals(now)

    def hasten(self, now: float) -> Effects:
        """Try again soon: there is news that may concern the hindrances."""
        if self._execution.waiting_to_retry is not None:
            yield from self._reschedule(hastened(self._execution.waiting_to_retry, now))

    def postpone(self, now: float) -> Effects:
        """Put off the attempt that is due: a report is on its way to the map (FRP, property 5), or news of the map to this copy."""
        if self._execution.waiting_to_retry is not None:
            yield from self._reschedule(structs.replace(self._execution.waiting_to_retry, next_attempt=now + FIRST_PAUSE))

    def _reschedule(self, wait: WaitsToRetry) -> Effects:
        execution = self._execution
        if execution.retry_at is not None:
            execution.waiting_to_retry, execution.retry_at = wait, wait.next_attempt
            yield SetTimer(RetryDue(self._scope.state.id), execution.retry_at)

    def begin_attempt(self, now: float) -> bool:
        """Prepare an attempt: services whose hindrance may have passed are asked again. Returns whether the goal waits for one."""
        if self._execution.retry_at is None:
            return False
        self._execution.retry_at = None
        self._scope.log.begin_attempt()
        self._scope.services.readmit_refused(now)
        return True

    def end(self, now: float) -> None:
        """End the wait, if there is one: the plan is arranged."""
        waited, self._execution.waiting_to_retry = self._execution.waiting_to_retry, None
        if waited is not None:
            self._scope.log.end_attempt(is_news=True)
            self._scope.log_event(waits.WaitOver(attempts=waited.attempts, seconds=now - waited.since), now)

    def abandon(self) -> Effects:
        """End the wait of a goal that is given up."""
        self._execution.waiting_to_retry = self._execution.retry_at = None
        if self._execution.kind is GoalKind.TASK:
            self._scope.log.end_attempt(is_news=True)
            yield SetTimer(RetryDue(self._scope.state.id), None)
