"""Tasks keep to their own work: no two tasks change one object at a time, and none undoes what another one has done."""

from __future__ import annotations

from typing import TYPE_CHECKING

from somrs.ontology.qualified_names import plain_name
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.reservations import ReservationLost
from somrs.service_manager.participant.timers import Activity
from verification.fault_runs.site import TELLING
from verification.fault_runs.violation import Property, Violation

if TYPE_CHECKING:
    from verification.fault_runs.scenario_run import ScenarioRun
    from verification.fault_runs.simulated_device import DeviceWork


class OwnWork:
    """Checks this whenever a device begins to work."""

    def __init__(self, scenario_run: ScenarioRun) -> None:
        self._scenario_run = scenario_run
        self._dispossessed: set[str] = set()
        """The tasks whose reservations were given away, because nothing was heard of their Task Managers for too long."""

    def read(self, message: Message) -> None:
        if isinstance(message.body, ReservationLost):
            self._dispossessed.add(message.body.task)

    def started(self, device_work: DeviceWork) -> None:
        if device_work.order.method in TELLING:
            return
        object, is_undoing = device_work.object, device_work.activity is Activity.UNDO
        for task in self._scenario_run.running_tasks():
            if task.id == device_work.transaction:
                goals = {work.goal for work in task.log if work.participant == device_work.participant}
                is_undoing = is_undoing or GoalKind.UNDO in goals
            elif task.id not in self._dispossessed and object in map(plain_name, task.reservation.held.changes):
                text = f"{device_work.participant} begins to change {object} for {device_work.transaction}"
                raise Violation(Property.OWN_WORK, f"{text}, which {task.id} has reserved")
        if is_undoing and object in self._scenario_run.reality.places:
            self._check_last_change(device_work)

    def _check_last_change(self, device_work: DeviceWork) -> None:
        """Check that the last task which moved the thing is the one that undoes its work, if it has moved it at all."""
        actions = (action for action in self._scenario_run.reality.actions if action.object == device_work.object)
        tasks = [action.task for action in actions]
        if device_work.transaction in tasks and tasks[-1] not in (device_work.transaction, None):
            text = f"{device_work.participant} undoes work on {device_work.object} for {device_work.transaction}"
            raise Violation(Property.OWN_WORK, f"{text}, although {tasks[-1]} has moved it since")
