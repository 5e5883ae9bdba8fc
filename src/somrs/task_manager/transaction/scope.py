"""What the modules that work on one task share: the task's state, its participants, its services, and its event log."""

from __future__ import annotations

from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.events import Event
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.execution.execution_log import Work
from somrs.task_manager.execution.participants import Participants
from somrs.task_manager.execution.workflow import StepRun
from somrs.task_manager.recovery.compensation import Compensation, Undoing
from somrs.task_manager.recovery.observation import Observation
from somrs.task_manager.reservations import ReservationRequester
from somrs.task_manager.transaction.retry import QUIET_EVENTS
from somrs.task_manager.transaction.state import Attempt, LoggedEvent, LoggedMessage, TaskState


class TaskScope:
    """A short-lived view of one task. It has no state of its own."""

    def __init__(self, state: TaskState, context: TaskManagerContext) -> None:
        self.state, self.context = state, context
        self.participants = Participants(state.id, state.members, context, self.log_event, self._log_message)
        self.services = AvailableServices(state.services, context.replica, context.directory)
        self.reserving = ReservationRequester(state.reservation, state.id, state.task.effect, state.task.priority, context)

    def log_event(self, event: Event, now: float, subject: StepRun | Work | None = None) -> None:
        """Log an event for the client. `subject`: the step or the work that it concerns."""
        state = self.state
        self.context.touched[state.id] = None
        logged = LoggedEvent(now, event, subject.label, subject.goal) if subject is not None else LoggedEvent(now, event)
        if state.attempt is not None and isinstance(event, QUIET_EVENTS):
            state.attempt.events.append(logged)
        else:
            self._add_event(logged)

    def _add_event(self, logged: LoggedEvent) -> None:
        self.state.setbacks += logged.kind is EventKind.SETBACK
        self.state.events.append(logged)

    def _log_message(self, now: float, message: Message) -> None:
        state, logged = self.state, LoggedMessage(now, message)
        member = state.members.find_member(message.header.participant)
        if state.outcome is not None:
            return
        if state.attempt is not None and member is not None and member.number >= state.attempt.first_number:
            state.attempt.messages.append(logged)
        else:
            self._add_message(logged)

    def _add_message(self, logged: LoggedMessage) -> None:
        self.state.messages.append(logged)
        self.state.message_count += 1
        self.context.touched[self.state.id] = None

    def compensation(self, undoing: Undoing) -> Compensation:
        state = self.state
        return Compensation(
            undoing,
            task=state.task,
            log=state.log,
            members=state.members,
            participants=self.participants,
            reserving=self.reserving,
            context=self.context,
            log_event=self.log_event,
        )

    @property
    def observation(self) -> Observation:
        state = self.state
        return Observation(
            state.look_queue,
            owner=state.id,
            reservation=state.reservation,
            log=state.log,
            members=state.members,
            services=self.services,
            reports=state.reports,
            context=self.context,
            log_event=self.log_event,
        )

    # Attempts of a task that waits

    def begin_attempt(self) -> None:
        """Hold back the events and messages of an attempt, until it ends."""
        self.state.attempt = Attempt(first_number=self.state.members.invited_count + 1)

    def end_attempt(self, *, is_news: bool) -> None:
        """Add what was held back to the task's log, if it `is_news`. Otherwise forget it, with the participants that were asked."""
        attempt, self.state.attempt = self.state.attempt, None
        if attempt is None:
            return
        if is_news:
            for event in attempt.events:
                self._add_event(event)
            for message in attempt.messages:
                self._add_message(message)
        else:
            self.state.members.forget_uncommitted(attempt.first_number)
