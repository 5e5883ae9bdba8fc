"""The log of a task for its client: events and messages, some of which are held back during an attempt of a task that waits."""

from __future__ import annotations

from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.events import Event
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.execution.execution_log import Work
from somrs.task_manager.execution.workflow import StepRun
from somrs.task_manager.transaction.retry import QUIET_EVENTS
from somrs.task_manager.transaction.state import Attempt, LoggedEvent, LoggedMessage, TaskState


class TaskLog:
    """Writes the log of one task. It has no state of its own."""

    # It is no part of `TaskScope`, whose parts it serves: a cycle would leave each of them to the garbage collector.

    def __init__(self, state: TaskState, context: TaskManagerContext) -> None:
        self._state, self._context = state, context

    def add_event(self, event: Event, now: float, subject: StepRun | Work | None = None) -> None:
        """Log an event. `subject`: the step or the work that it concerns."""
        state = self._state
        self._context.touched[state.id] = None
        logged = LoggedEvent(now, event, subject.label, subject.goal) if subject is not None else LoggedEvent(now, event)
        if state.attempt is not None and isinstance(event, QUIET_EVENTS):
            state.attempt.events.append(logged)
        else:
            self._store_event(logged)

    def _store_event(self, logged: LoggedEvent) -> None:
        self._state.setbacks += logged.kind is EventKind.SETBACK
        self._state.events.append(logged)

    def add_message(self, now: float, message: Message) -> None:
        """Log a message of the protocol, unless the task has ended."""
        state = self._state
        if state.outcome is not None:
            return
        logged, attempt = LoggedMessage(now, message), state.attempt
        if attempt is not None and self._is_of_attempt(message, attempt):
            attempt.messages.append(logged)
        else:
            self._store_message(logged)

    def _is_of_attempt(self, message: Message, attempt: Attempt) -> bool:
        member = self._state.members.find_member(message.header.participant)
        return member is not None and member.number >= attempt.first_number

    def _store_message(self, logged: LoggedMessage) -> None:
        self._state.messages.append(logged)
        self._state.message_count += 1
        self._context.touched[self._state.id] = None

    # Attempts of a task that waits

    def begin_attempt(self) -> None:
        """Hold back the events and messages of an attempt, until it ends."""
        self._state.attempt = Attempt(first_number=self._state.members.invited_count + 1)

    def end_attempt(self, *, is_news: bool) -> None:
        """Add what was held back to the log, if it `is_news`. Otherwise forget it, with the participants that were asked."""
        attempt, self._state.attempt = self._state.attempt, None
        if attempt is None:
            return
        if is_news:
            for event in attempt.events:
                self._store_event(event)
            for message in attempt.messages:
                self._store_message(message)
        else:
            self._state.members.forget_uncommitted(attempt.first_number)
