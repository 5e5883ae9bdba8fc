"""What the modules that work on one task share: the task's state, its participants, its services, and its event log."""

from __future__ import annotations

from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.events import Event, EventKind, kind_of
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.execution.execution_log import Work
from somrs.task_manager.execution.participants import Participants
from somrs.task_manager.execution.workflow import StepRun
from somrs.task_manager.transaction.state import LoggedEvent, LoggedMessage, TaskState


class TaskScope:
    """A short-lived view of one task. It has no state of its own."""

    def __init__(self, state: TaskState, context: TaskManagerContext) -> None:
        self.state, self.context = state, context
        self.participants = Participants(state.id, state.members, context, self.log_event, self._log_message)
        self.services = AvailableServices(state.services, context.replica)

    def log_event(self, event: Event, now: float, subject: StepRun | Work | None = None) -> None:
        """Log an event for the client. `subject`: the step or the work that it concerns."""
        state = self.state
        self.context.touched[state.id] = None
        state.setbacks += kind_of(event) is EventKind.SETBACK
        state.events.append(LoggedEvent(now, event, subject.label, subject.goal) if subject is not None else LoggedEvent(now, event))

    def _log_message(self, now: float, message: Message) -> None:
        state = self.state
        if state.outcome is None:
            state.messages.append(LoggedMessage(now, message))
            state.message_count += 1
            self.context.touched[state.id] = None
