"""The end of a task: its participants stop; if it is not accomplished, its work is to be undone; then it has its outcome.

How work is undone is in `recovery/compensation.py`, and the record of a task that has ended in `record.py`.
"""

from __future__ import annotations

from somrs.kernel.component import Effects, Record, SetTimer
from somrs.protocol.messages import events
from somrs.protocol.messages.frp import Outcome
from somrs.task_manager.recovery.compensation import Undoing
from somrs.task_manager.timers import DeadlineDue, StopDue
from somrs.task_manager.transaction.findings import findings
from somrs.task_manager.transaction.goal_executor import GoalExecutor
from somrs.task_manager.transaction.pausing import Pausing
from somrs.task_manager.transaction.record import record
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import waiting_texts

STOP_TIME = 60.0
"""Seconds that participants have to stop safely. Those that have not stopped by then are given up."""


class Ending:
    """Ends one task. It has no state of its own."""

    def __init__(self, scope: TaskScope) -> None:
        self._scope, self._state, self._context = scope, scope.state, scope.context

    def stop(self, outcome: Outcome, reasons: tuple[str, ...], now: float) -> Effects:
        """Give up all goals, and have the participants stop. The task will have this outcome."""
        state = self._state
        yield from Pausing(self._scope).end("", now)
        state.ending = outcome
        state.reasons = (*reasons, *(f"it was {text}" for text in waiting_texts(state.goal)))
        if outcome is Outcome.CANCELLED:
            self._scope.log_event(events.Stopping(reason=reasons[0]), now)
        for execution in state.executions:
            yield from GoalExecutor(execution, self._scope).abandon(now)
            if execution.look is not None:
                state.look_queue.requeue(execution.look)
        state.side_goals.clear()
        state.undoing = None
        state.look_queue.drop()
        yield SetTimer(DeadlineDue(state.id), None)
        yield from self._scope.participants.stop(reasons[0], now)
        yield SetTimer(StopDue(state.id), now + STOP_TIME)

    def begin_undoing(self) -> Effects:
        """Prepare to undo the work: all participants have stopped."""
        yield SetTimer(StopDue(self._state.id), None)
        self._state.undoing = Undoing.from_works(self._state.log.to_undo(), by_other_services=True)

    def conclude(self, outcome: Outcome, now: float) -> Effects:
        """Give the task its outcome, tell the participants, and record it."""
        state = self._state
        yield from Pausing(self._scope).end("", now)
        yield from self._scope.participants.end(outcome, now)
        state.outcome, state.ended_at = outcome, now
        if state.task.recognise:
            state.findings = findings(state.task.effect, state.log, self._context.replica)
        yield from self._scope.reserving.release(now, ended=True)
        if outcome is not Outcome.ACCOMPLISHED:
            replica = self._context.replica
            state.reasons += tuple(work.in_words(replica.map, replica.ontology) for work in state.log if work.matters)
        for timer in (DeadlineDue(state.id), StopDue(state.id)):
            yield SetTimer(timer, None)
        self._scope.log_event(events.TaskEnded(outcome=outcome, reasons=state.reasons), now)
        yield Record(record(state))
        state.messages.clear()
        self._scope.participants.forget(run.participant for run in state.goal)
