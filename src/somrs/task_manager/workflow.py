"""The concrete plan of one task: each step of the abstract plan, who does it, and how far it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum

from somrs.entish import Formula
from somrs.planner.plan import Plan, Step
from somrs.task_manager.participants import Member


class Progress(StrEnum):
    """How far a step is."""

    OPEN = "open"
    """Nobody has it yet."""
    ARRANGING = "arranging"
    """Services were asked, and their answers are awaited."""
    ARRANGED = "arranged"
    """One service is committed to it."""
    EXECUTING = "executing"
    REPORTING = "reporting"
    """It is over, and what it came to is being put on the map."""
    DONE = "done"


@dataclass(slots=True, kw_only=True, eq=False)
class StepRun:
    """A step of the plan and its life so far. `reported` is what a failed service, or whoever looked, said is so now.

    `label` is what people know the step by; `key` tells it from all other steps of the transaction.
    """

    step: Step
    label: str
    key: str
    progress: Progress = Progress.OPEN
    precondition: Formula | None = None
    reported: Formula | None = None
    member: Member | None = None
    excluded: dict[str, str] = field(default_factory=dict)
    """Services not to be asked again for this step, and why."""
    lapsed: set[str] = field(default_factory=set)
    """Services whose terms ran out once before the step could begin."""
    handled: set[str] = field(default_factory=set)
    """What was laid down for its failure and has been tried, by its effect."""
    failure: str | None = None
    """It was begun, and is nobody's now; something has to be done about that before it is arranged again."""
    start: float = 0.0
    finish: float = 0.0

    def lose(self, failure: str | None = None) -> None:
        """The service that had it is out."""
        self.progress, self.member, self.failure = Progress.OPEN, None, failure

    def same_work(self, other: StepRun) -> bool:
        """Whether both ask the same of a service, whatever the steps are called."""
        mine, its = self.step, other.step
        return (mine.service_type, mine.inputs, mine.provider) == (its.service_type, its.inputs, its.provider)


class Workflow:
    """The steps of a plan with their states; order comes from the plan's links."""

    def __init__(self, plan: Plan, name: str = "", label: str = "") -> None:
        self.plan = plan
        self.runs = {step.id: StepRun(step=step, label=f"{label}{step.id}", key=f"{name}{step.id}") for step in plan.topological()}

    def __iter__(self) -> Iterator[StepRun]:
        return iter(self.runs.values())

    def adopt(self, old: Workflow) -> Iterator[Member]:
        """Take over what still stands of the plan before. The services whose steps are no more are left over."""
        for run in old:
            if run.progress is not Progress.ARRANGED or run.member is None:
                continue
            same = next((new for new in self if new.progress is Progress.OPEN and new.same_work(run)), None)
            if same is not None:
                same.progress, same.member = run.progress, run.member
                same.start, same.finish, same.precondition = run.start, run.finish, run.precondition
                run.member.step = same.key
            else:
                yield run.member

    def held_by(self, member: Member) -> StepRun | None:
        """The step that the participant is committed to, or does."""
        return next((run for run in self if run.member is member), None)

    def before(self, step: str) -> list[StepRun]:
        """The steps that must be done before this one."""
        return [self.runs[before] for before in self.plan.before(step)]

    def open(self) -> StepRun | None:
        """The next step to arrange, in causal order, when none is being arranged."""
        if any(run.progress is Progress.ARRANGING for run in self):
            return None
        return next((run for run in self if run.progress is Progress.OPEN), None)

    def failed(self) -> StepRun | None:
        """A step that was begun, and has to be recovered."""
        return next((run for run in self if run.failure is not None), None)

    def ready(self) -> Iterable[StepRun]:
        """Arranged steps whose predecessors are all done."""
        return [
            run for run in self if run.progress is Progress.ARRANGED and all(b.progress is Progress.DONE for b in self.before(run.step.id))
        ]

    @property
    def arranged(self) -> bool:
        """Whether every step has its service, or had it."""
        return all(run.progress not in (Progress.OPEN, Progress.ARRANGING) for run in self)

    @property
    def busy(self) -> bool:
        """Whether any step is under way."""
        return any(run.progress in (Progress.EXECUTING, Progress.REPORTING) for run in self)

    @property
    def done(self) -> bool:
        return all(run.progress is Progress.DONE for run in self)

    def earliest_start(self, run: StepRun, now: float) -> float:
        """When everything before the step is promised to be finished."""
        return max([now, *(before.finish for before in self.before(run.step.id) if before.progress is not Progress.DONE)])
