"""What the modules that work on one task share: the task's state, its participants, its services, and its log."""

from __future__ import annotations

from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.execution.participants import Participants
from somrs.task_manager.recovery.compensation import Compensation, Undoing
from somrs.task_manager.recovery.observation import Observation
from somrs.task_manager.reservations import ReservationRequester
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.task_log import TaskLog


class TaskScope:
    """A short-lived view of one task. It has no state of its own."""

    def __init__(self, state: TaskState, context: TaskManagerContext) -> None:
        self.state, self.context = state, context
        self.log = log = TaskLog(state, context)
        self.log_event = log.add_event
        self.participants = Participants(state.id, state.members, context, log.add_event, log.add_message)
        self.services = AvailableServices(state.services, context.replica, context.directory)
        self.reserving = ReservationRequester(state.reservation, state.id, state.task.effect, state.task.priority, context)

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
