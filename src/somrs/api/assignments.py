"""Which steps of tasks the devices execute, and for which they have contracts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from msgspec import Struct

from somrs.api.reliability_stats import device_of
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.task_views import StepView, TaskView, WorkView

BUSY = (State.EXECUTING, State.STOPPING, State.COMPENSATING)


class Assignment(Struct, frozen=True, kw_only=True):
    """A step of a task that a device executes or, in the state `Committed`, has a contract for. `fraction`: its progress, 0 to 1, if the
    service reports it; `note`: what it says of it."""

    task: str
    effect: str
    step: str
    service: str
    service_type: str
    inputs: dict[str, str]
    state: State
    fraction: float | None = None
    note: str = ""


def by_device(tasks: Iterable[TaskView]) -> Mapping[str, tuple[Assignment, ...]]:
    """The assignments of each device, those under way first."""
    device_assignments: dict[str, list[Assignment]] = {}
    for task in tasks:
        for assignment in _find_assignments(task):
            device_assignments.setdefault(device_of(assignment.service), []).append(assignment)
    return {
        device: tuple(sorted(assignments, key=lambda assignment: assignment.state not in BUSY))
        for device, assignments in device_assignments.items()
    }


def _find_assignments(task: TaskView) -> Iterator[Assignment]:
    steps = [step for step in task.steps if step.service is not None and step.state in (*BUSY, State.COMMITTED)]
    planned = {step.step for step in steps}
    for step in steps:
        yield _make_assignment(task, step, step.fraction, step.note)
    for work in task.work:
        if work.state in BUSY and work.step not in planned:  # it observes, compensates, or follows a handler
            yield _make_assignment(task, work)


def _make_assignment(task: TaskView, step: StepView | WorkView, fraction: float | None = None, note: str = "") -> Assignment:
    return Assignment(
        task=task.task,
        effect=task.effect,
        step=step.step,
        service=step.service or "",
        service_type=step.service_type,
        inputs=step.inputs,
        state=step.state,
        fraction=fraction,
        note=note,
    )
