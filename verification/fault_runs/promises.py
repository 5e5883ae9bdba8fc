"""Properties of what tasks and services promise: work stops when what it needs does not hold any more, waits go on, outputs are used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from somrs.ontology.qualified_names import plain_name
from somrs.protocol.frp.session import service_of
from somrs.protocol.messages import events, frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.task_views import Phase
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.transaction.state import TaskState
from verification.fault_runs.scenario import Carry, Store
from verification.fault_runs.violation import Property, Violation

if TYPE_CHECKING:
    from verification.fault_runs.scenario_run import ScenarioRun
    from verification.fault_runs.simulated_device import DeviceWork, SimulatedDevice

RESERVED = "isReservedFor"

RETRY_TOLERANCE = 1.0
"""Seconds by which an attempt of a waiting task may be late."""


class Promises:
    """Checks these properties during a run."""

    def __init__(self, scenario_run: ScenarioRun) -> None:
        self._scenario_run = scenario_run
        self._stopped: set[tuple[str, str]] = set()
        """The participants that were told to stop, with their transactions."""
        self._penalties: dict[tuple[str, str], float | None] = {}
        """The penalty in the last terms of each participant, with its transaction."""
        self._undone: dict[tuple[str, float], list[str]] = {}
        """The participants of a transaction that were told to compensate at a time."""

    def read(self, message: Message) -> None:
        header = message.header
        pair = header.transaction or "", header.participant or ""
        match message.body:
            case frp.Stop() | frp.End():
                self._stopped.add(pair)
            case frp.Terms(penalty=penalty):
                self._penalties[pair] = penalty
            case frp.Compensate():
                self._undone.setdefault((pair[0], self._scenario_run.world.now), []).append(pair[1])
            case frp.Execute(inputs=inputs):
                self._check_place(header.sender, pair, inputs)

    def _check_place(self, sender: str, pair: tuple[str, str], inputs: Mapping[str, str]) -> None:
        """Check that a thing is carried to the table that was reserved for it, if its task asks for that and for nothing else."""
        manager, service_type = self._scenario_run.task_manager(sender), service_of(pair[1]).rpartition(".")[2]
        task = manager.state.tasks.get(pair[0]) if manager is not None else None
        work = next((work for work in task.log if work.participant == pair[1]), None) if task is not None else None
        if task is None or work is None or service_type != Carry.WEIGHED or RESERVED not in task.task.effect:
            return
        place, thing = plain_name(inputs["Place"]), plain_name(inputs["Object"])
        if work.goal is GoalKind.TASK and (place, thing) not in self._scenario_run.reality.reserved:
            raise Violation(Property.OUTPUTS, f"{pair[1]} is to bring {thing} to {place}, which nobody reserved")

    def started(self, simulated_device: SimulatedDevice, device_work: DeviceWork) -> None:
        """Check that a device that begins to work does not carry what is too heavy for it."""
        weight = self._scenario_run.reality.weights.get(device_work.object, 0.0)
        if device_work.order.method == Carry.WEIGHED and weight > simulated_device.traits.payload:
            text = f"{simulated_device.name} carries up to {simulated_device.traits.payload:g} kg, and is to carry {device_work.object}"
            raise Violation(Property.OUTPUTS, f"{text}, which weighs {weight:g} kg")

    def follow(self, manager: TaskManager, address: str) -> None:
        """Check the tasks of a Task Manager after each of its inputs."""
        for task in manager.state.tasks.values():
            if task.outcome is None:
                self._check_wait(task, address)
                self._check_invariants(task, manager)

    def ended(self, task: TaskState) -> None:
        """Check that nothing was undone for a penalty that nobody stated."""
        for entry in task.events:
            if isinstance(entry.event, events.UndoingCheaper):
                unstated = [name for name in self._undone.get((task.id, entry.at), ()) if self._penalties.get((task.id, name)) is None]
                if unstated or entry.event.undoing >= entry.event.going_on:
                    subject = unstated[0] if unstated else task.id
                    raise Violation(Property.OUTPUTS, f"{subject} undoes its work to save costs, although its terms state none")

    def _check_wait(self, task: TaskState, address: str) -> None:
        """Check that a task that waits says for what, and tries again when it says."""
        wait, now = task.goal.waiting_to_retry, self._scenario_run.world.now
        if wait is None or task.goal.phase is not Phase.WAITING or task.goal.retry_at is None:
            return
        if not task.task.waits or not wait.hindrances:
            raise Violation(Property.WAITING, f"{task.id} waits for nothing")
        due = max(wait.next_attempt, self._scenario_run.restart_times.get(address, 0.0))
        if now > due + RETRY_TOLERANCE:
            raise Violation(Property.WAITING, f"{task.id} was to try again {now - due:.1f} s ago")

    def _check_invariants(self, task: TaskState, manager: TaskManager) -> None:
        """Check that services are told to stop as soon as the coordinator's map says that a door is shut that has to stay open."""
        if Store.INVARIANT not in self._scenario_run.offered_types:
            return
        for work in task.log:
            door = work.step.inputs.get("Door")
            if work.state is not State.EXECUTING or work.service_type.name != Store.INVARIANT or door is None:
                continue
            is_open = manager.state.replica.map.objects[str(door)].values.get("Open")
            if is_open is False and (task.id, work.participant) not in self._stopped:
                raise Violation(Property.INVARIANT, f"{work.participant} goes on, although the map says that {door} is shut")
