"""What came of a run, and of many: figures to be added up."""

from __future__ import annotations

import gc
from collections import Counter
from dataclasses import dataclass, field

from somrs.protocol.messages import events
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.records import TaskRecord
from verification.fault_runs.draw import draw
from verification.fault_runs.properties import Violation
from verification.fault_runs.stage import Parts, Stage
from verification.fault_runs.story import Story

RUNGS: dict[type[Event], str] = {
    events.HandlerBegun: "handlers",
    events.ServiceReplaced: "replaced",
    events.Replanned: "planned anew",
    events.TriedOnceMore: "planned anew",
    events.WaitsForTasks: "waited for another task",
    events.WaitsForDevice: "waited for its turn at a device",
    events.LookBegun: "looks",
    events.NobodyLooks: "nothing assumed",
    events.UndoneByOthers: "undone by others",
    events.UndoneByService: "undone by the participant",
    events.UndoneByHandler: "undone by what was laid down",
    events.FailuresUndone: "failures undone, to plan again",
}
"""The rungs of the ladder of recovery, and what comes with them."""

BROKEN = (State.FAILED, State.STOPPED, State.UNREACHABLE, State.COMPENSATED, State.STRANDED)


@dataclass
class Result:
    """Of one run or of several. `failed` are seeds, with the property and what was seen."""

    runs: int = 0
    tasks: Counter[str] = field(default_factory=Counter)
    troubled: Counter[str] = field(default_factory=Counter)
    """Tasks in which, or around which, something broke, by how they ended."""
    rungs: Counter[str] = field(default_factory=Counter)
    messages: int = 0
    inputs: int = 0
    failed: dict[int, tuple[str, str]] = field(default_factory=dict)

    def add(self, other: Result) -> None:
        self.runs += other.runs
        self.tasks += other.tasks
        self.troubled += other.troubled
        self.rungs += other.rungs
        self.messages += other.messages
        self.inputs += other.inputs
        self.failed |= other.failed


def played(story: Story, parts: Parts | None = None) -> tuple[Stage, Violation | None]:
    """The story's stage after it was played, and what did not hold, if anything."""
    stage = Stage(story, parts)
    try:
        stage.play()
    except Violation as violation:
        return stage, violation
    return stage, None


def run(seed: int) -> Result:
    """Play the story of a seed. Rubbish is collected between runs, not in them."""
    gc.disable()
    try:
        return _run(seed)
    finally:
        if seed % 20 == 0:
            gc.collect()


def _run(seed: int) -> Result:
    stage, violation = played(draw(seed))
    result = Result(runs=1, messages=len(stage.world.messages), inputs=stage.events)
    if violation is not None:
        result.failed[seed] = violation.property, violation.seen
        return result
    blows = [at for at, _ in stage.log]
    for address in stage.managers:
        records = {entry.task: entry for entry in stage.world.records[address] if isinstance(entry, TaskRecord)}
        for record in records.values():
            result.tasks[record.outcome] += 1
            if any(work.state in BROKEN for work in record.work) or any(record.submitted_at <= at <= record.ended_at for at in blows):
                result.troubled[record.outcome] += 1
            for event in record.events:
                if (rung := RUNGS.get(type(event.event))) is not None:  # type: ignore[arg-type]  # records of today have an event
                    result.rungs[rung] += 1
                elif isinstance(event.event, events.WorkStranded) and not event.event.taken:
                    result.rungs["stranded"] += 1
            result.rungs["given up"] += record.outcome is Outcome.FAILED
    result.rungs["rejected"] += len(stage.client.rejected)
    return result
