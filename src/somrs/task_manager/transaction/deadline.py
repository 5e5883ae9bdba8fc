"""The deadline of a task, in the world's time (`world_clock.py`)."""

from __future__ import annotations

from somrs.kernel.component import Effects, SetTimer
from somrs.task_manager.timers import DeadlineDue
from somrs.task_manager.transaction.scope import TaskScope


class Deadline:
    """Watches the deadline of one task, if it has one. It has no state of its own."""

    def __init__(self, scope: TaskScope) -> None:
        self._state, self._clock = scope.state, scope.context.clock

    def latest_finish(self, now: float) -> float | None:
        """When work has to be done if as many seconds pass from now on as in the world, as services promise it; None without a deadline."""
        state = self._state
        if state.due_time is None or state.ending is not None:
            return None
        return now + state.due_time - self._clock.time_at(now)

    def watch(self, now: float) -> Effects:
        """Have the timer fire when the deadline is over in the world, as its time passes now."""
        state = self._state
        if state.task.deadline is None or state.ending is not None:
            return
        if state.due_time is None:
            state.due_time = self._clock.time_at(now) + state.submitted_at + state.task.deadline - now
        state.due_at = self._clock.wall_time(state.due_time)
        yield SetTimer(DeadlineDue(state.id), state.due_at)
