"""The tasks that a Task Manager carries out: what concerns several of them is passed to their transactions. `transaction/` has the work on
one."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.kernel.component import Effects
from somrs.kernel.replica import ReplicaUpdate
from somrs.ontology.modes import freed_devices
from somrs.ontology.objects import objects_of
from somrs.protocol.messages.waits import WaitsForRepository
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.state import TaskManagerState
from somrs.task_manager.transaction.repository_wait import RepositoryWait
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.transaction import Transaction


class RunningTasks:
    """Continues transactions. It has no state of its own."""

    def __init__(self, state: TaskManagerState, context: TaskManagerContext) -> None:
        self._state, self._context = state, context

    def transaction(self, id: str) -> Transaction:
        """The transaction of a task."""
        return Transaction(self._state.tasks[id], self._context)

    def repository_wait(self, id: str) -> RepositoryWait:
        """What a task waits for at the Repository."""
        return RepositoryWait(TaskScope(self._state.tasks[id], self._context))

    def restarted(self, now: float) -> Effects:
        """Go on with all tasks after a restart."""
        for task in self._state.running:
            yield from self.transaction(task).restarted(now)

    def clock_adjusted(self, now: float) -> Effects:
        """Follow a change of the pace of the world."""
        for task in self._state.running:
            yield from self.transaction(task).clock_adjusted(now)

    def services_joined(self, services: Sequence[str], now: float) -> Effects:
        """Tell the tasks which services are on offer since now."""
        for task in self._state.running if services else ():
            yield from self.transaction(task).services_joined(services, now)

    def map_changed(self, news: ReplicaUpdate, now: float) -> Effects:
        """Tell the tasks what has changed on the map and in the ontology."""
        if self._state.replica.ready:
            yield from self._pass_on_changes(news, now)
        for task in self._state.running if news.ontology_changed else ():
            yield from self.transaction(task).proceed(now)

    def _pass_on_changes(self, news: ReplicaUpdate, now: float) -> Effects:
        state = self._state
        # A lower version belongs to another store: the versions that reports wait for will never come.
        begun_anew = news.reloaded and state.replica.version < state.map_version
        if begun_anew:
            yield from state.requests.claim(tuple(state.claims()), now)
        state.map_version = state.replica.version
        due = [report for report in state.unsettled if begun_anew or report.version <= state.replica.version]
        state.unsettled = [report for report in state.unsettled if report not in due]
        for task in state.running if news.new_names else ():
            yield from self.transaction(task).objects_renamed(news.new_names, now)
        for report in due:
            if report.task in state.tasks:
                yield from self.transaction(report.task).settled(report.result, now)
        for task in state.running:
            if state.tasks[task].has_invariants:
                yield from self.transaction(task).map_changed(now)
        if news.changes and (waiting_tasks := [task for task in state.running if state.tasks[task].goal.retry_at is not None]):
            changed_objects = {name for change in news.changes for name in objects_of(change)}
            for task in waiting_tasks:
                yield from self.transaction(task).objects_changed(changed_objects, now)
        if freed := freed_devices(news.changes, state.replica.map, state.replica.ontology):
            for task in state.running:
                yield from self.transaction(task).devices_freed(freed, now)

    def admit_waiting(self, now: float) -> Effects:
        """Continue the tasks that waited for others: for their objects, for devices, or until fewer services are asked for terms."""
        state = self._state
        for task in state.local_reservations.admit_waiting(now) if state.local_reservations is not None else ():
            if task in state.tasks:
                yield from self.transaction(task).freed(now)
        for task in state.queues.admit_waiting(state.still_at_work):
            if task in state.tasks:
                yield from self.transaction(task).proceed(now)
        for task in state.next_to_ask():
            yield from self.transaction(task).proceed(now)

    def note_overdue(self, request: str, now: float) -> None:
        """The Repository has not answered in time."""
        overdue = self._state.requests.overdue(request)
        if overdue is not None and overdue[0] in self._state.running:
            self.repository_wait(overdue[0]).begin(request, WaitsForRepository(since=overdue[1]), now)

    def forget_ended(self) -> None:
        """Count the tasks that have ended as running no more."""
        state = self._state
        for id in [id for id in state.running if state.tasks[id].outcome is not None]:
            state.running.remove(id)
            state.forget_old_tasks()
