"""The results of runs, as figures that add up."""

from __future__ import annotations

import gc
from collections import Counter
from dataclasses import dataclass, field

from somrs.protocol.messages import events, waits
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.records import TaskRecord
from verification.fault_runs.component_factory import ComponentFactory
from verification.fault_runs.draw import draw
from verification.fault_runs.scenario import Scenario
from verification.fault_runs.scenario_run import ScenarioRun
from verification.fault_runs.violation import Violation

RECOVERIES: dict[type[Event], str] = {
    events.HandlerBegun: "handlers",
    events.ServiceReplaced: "replaced",
    events.Replanned: "planned anew",
    events.TriedOnceMore: "planned anew",
    waits.WaitsForTasks: "waited for another task",
    waits.WaitsForDevice: "waited for its turn at a device",
    events.LookBegun: "observations",
    events.NobodyLooks: "not observed",
    events.UndoneByOthers: "undone by others",
    events.UndoneByService: "undone by the participant",
    events.UndoneByHandler: "undone by a handler",
    events.FailuresUndone: "failures undone before a new plan",
}
"""The labels of recovery events, in the order of the recovery ladder."""

BROKEN = (State.FAILED, State.STOPPED, State.UNREACHABLE, State.COMPENSATED, State.STRANDED)


@dataclass
class Result:
    """The result of one run or of several. `failed` has the failing seeds, each with its property and description."""

    runs: int = 0
    tasks: Counter[str] = field(default_factory=Counter)
    troubled: Counter[str] = field(default_factory=Counter)
    """Tasks with a failure in them or around them, by outcome."""
    recoveries: Counter[str] = field(default_factory=Counter)
    messages: int = 0
    inputs: int = 0
    failed: dict[int, tuple[str, str]] = field(default_factory=dict)

    def add(self, result: Result) -> None:
        self.runs += result.runs
        self.tasks += result.tasks
        self.troubled += result.troubled
        self.recoveries += result.recoveries
        self.messages += result.messages
        self.inputs += result.inputs
        self.failed |= result.failed


def play_scenario(scenario: Scenario, factory: ComponentFactory | None = None) -> tuple[ScenarioRun, Violation | None]:
    """Play the scenario, and return the run and the violation, if there is one."""
    scenario_run = ScenarioRun(scenario, factory)
    try:
        scenario_run.play()
    except Violation as violation:
        return scenario_run, violation
    return scenario_run, None


def run(seed: int) -> Result:
    """Play the scenario of a seed. Garbage is collected only between runs, for speed."""
    gc.disable()
    try:
        return _run(seed)
    finally:
        if seed % 20 == 0:
            gc.collect()


def _run(seed: int) -> Result:
    scenario_run, violation = play_scenario(draw(seed))
    result = Result(runs=1, messages=len(scenario_run.world.messages), inputs=scenario_run.events)
    if violation is not None:
        result.failed[seed] = violation.property, violation.description
        return result
    fault_times = [time for time, _ in scenario_run.log]
    for address in scenario_run.managers:
        records = {entry.task: entry for entry in scenario_run.world.records[address] if isinstance(entry, TaskRecord)}
        for record in records.values():
            result.tasks[record.outcome] += 1
            if any(work.state in BROKEN for work in record.work) or any(
                record.submitted_at <= time <= record.ended_at for time in fault_times
            ):
                result.troubled[record.outcome] += 1
            for event in record.events:
                if (recovery := RECOVERIES.get(type(event.event))) is not None:  # type: ignore[arg-type]  # new records have an event
                    result.recoveries[recovery] += 1
                elif isinstance(event.event, events.WorkStranded) and not event.event.taken:
                    result.recoveries["stranded"] += 1
            result.recoveries["given up"] += record.outcome is Outcome.FAILED
    result.recoveries["rejected"] += len(scenario_run.client.rejected)
    return result
