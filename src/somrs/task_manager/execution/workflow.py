"""The concrete plan of one task: each step of the abstract plan, with its service and its progress."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from enum import StrEnum

from msgspec import Struct, field

from somrs.entish import Formula
from somrs.ontology.types import Value
from somrs.planner.model.plan import Plan, Step
from somrs.planner.model.provider_choice import assign_provider
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.task_manager.context import Interval
from somrs.task_manager.execution.member import Member, Members


class Progress(StrEnum):
    """The progress of a step."""

    OPEN = "open"
    """No service has the step, and none is being asked."""
    ARRANGING = "arranging"
    """Services have been asked, and their answers are awaited."""
    ARRANGED = "arranged"
    """One service is committed to it."""
    EXECUTING = "executing"
    REPORTING = "reporting"
    """The step has ended, and its result is not on the map yet."""
    COMPLETED = "done"


_UNPROMISED = (Progress.OPEN, Progress.ARRANGING)
_PROMISED = (Progress.ARRANGED, Progress.EXECUTING)


class StepRun(Struct, kw_only=True, eq=False):
    """A step of the plan, with its progress.

    `label` is its name for people; `key` is unique among all steps of the transaction. `participant` is the id of the participant that is
    or was committed to the step, and `provider` its device. `reported` is the situation that a failed service or an observation reported.
    """

    step: Step
    label: str
    key: str
    goal: GoalKind = GoalKind.TASK
    """The kind of goal that the plan serves."""
    progress: Progress = Progress.OPEN
    failure: str | None = None
    """Why the step failed after its start. It has to be recovered before it is arranged again."""
    participant: str | None = None
    provider: str | None = None
    precondition: Formula | None = None
    reported: Formula | None = None
    excluded: dict[str, str] = {}
    """Services that are not asked again for this step, and why."""
    lapsed: set[str] = set()
    """Services whose terms expired once before the step could begin."""
    lapses: int = 0
    """How often terms did not hold any more that had been accepted."""
    handled: set[str] = set()
    """The effects of the handlers that have been tried for its failure."""
    outputs: dict[str, Value] = {}
    """The outputs that the service reported at its end."""
    start: float = 0.0
    finish: float = 0.0
    is_waiting: bool = field(default=False, name="waits")
    """The step is arranged, and waits for its device."""

    @property
    def work(self) -> Hashable:
        """What the step asks of a service, without the step's name."""
        return self.step.service_type, tuple(self.step.inputs.items())


class Workflow(Struct, dict=True, eq=False):
    """The steps of a plan with their progress, in the order that the plan's links define.

    Indexes give the next steps without a pass over all steps: a plan has hundreds, and an event moves few of them. The indexes are not
    stored, but rebuilt from the steps.
    """

    plan: Plan
    runs: dict[str, StepRun]
    """By the step's id, in topological order."""

    @classmethod
    def from_plan(cls, plan: Plan, name: str = "", label: str = "", goal: GoalKind = GoalKind.TASK) -> Workflow:
        """A workflow in which all steps are open."""
        steps = plan.topological()
        return cls(plan, {step.id: StepRun(step=step, label=f"{label}{step.id}", key=f"{name}{step.id}", goal=goal) for step in steps})

    def __post_init__(self) -> None:
        runs, plan = self.runs, self.plan
        self._place = {id: number for number, id in enumerate(runs)}
        self._by_key = {run.key: run for run in runs.values()}
        self._predecessors = {id: tuple(runs[predecessor] for predecessor in plan.predecessors(id)) for id in runs}
        self._successors = {id: tuple(runs[successor] for successor in plan.successors(id)) for id in runs}
        self._count = Counter({**dict.fromkeys(Progress, 0), **Counter(run.progress for run in runs.values())})
        self._unarranged = {
            id: sum(predecessor.progress in _UNPROMISED for predecessor in predecessors) for id, predecessors in self._predecessors.items()
        }
        """By step: the number of direct predecessors that no service is committed to."""
        self._undone = {
            id: sum(predecessor.progress is not Progress.COMPLETED for predecessor in predecessors)
            for id, predecessors in self._predecessors.items()
        }
        self._open: set[str] = set()
        """The steps to arrange next: open steps whose predecessors are all promised."""
        self._ready: set[str] = set()
        self._failed = {id for id, run in runs.items() if run.failure is not None}
        self._promised: dict[str, set[str]] = {}
        """By provider: the steps that it is committed to or executes."""
        for id, run in runs.items():
            self._sort(run)
            if run.provider is not None and run.progress in _PROMISED:
                self._promised.setdefault(run.provider, set()).add(id)

    def __iter__(self) -> Iterator[StepRun]:
        return iter(self.runs.values())

    # How steps change

    def move(self, run: StepRun, progress: Progress) -> None:
        """Change the progress of a step."""
        old_progress, run.progress = run.progress, progress
        self._count[old_progress] -= 1
        self._count[progress] += 1
        self._sort(run)
        if run.provider is not None:
            _set_member(self._promised.setdefault(run.provider, set()), run.step.id, progress in _PROMISED)
        promised_delta = (progress not in _UNPROMISED) - (old_progress not in _UNPROMISED)
        done_delta = (progress is Progress.COMPLETED) - (old_progress is Progress.COMPLETED)
        if promised_delta or done_delta:
            for successor in self._successors[run.step.id]:
                self._unarranged[successor.step.id] -= promised_delta
                self._undone[successor.step.id] -= done_delta
                self._sort(successor)

    def assign(self, run: StepRun, member: Member, start: float, finish: float) -> None:
        """Mark a step as arranged: the participant is committed to it from `start` to `finish`."""
        run.participant, run.provider, run.start, run.finish, run.is_waiting = member.id, member.offer.provider, start, finish, False
        self.move(run, Progress.ARRANGED)

    def release(self, run: StepRun, failure: str | None = None) -> None:
        """Open a step again, because its service has left. `failure`: why it failed, if it had begun."""
        self.move(run, Progress.OPEN)
        run.participant = run.provider = None
        self.set_failure(run, failure)

    def set_failure(self, run: StepRun, failure: str | None) -> None:
        """Mark a step as failed; or, with None, as recovered."""
        run.failure = failure
        _set_member(self._failed, run.step.id, failure is not None)

    def _sort(self, run: StepRun) -> None:
        id = run.step.id
        _set_member(self._open, id, run.progress is Progress.OPEN and self._unarranged[id] == 0)
        _set_member(self._ready, id, run.progress is Progress.ARRANGED and self._undone[id] == 0)

    def _in_order(self, ids: Iterable[str]) -> list[StepRun]:
        return [self.runs[id] for id in sorted(ids, key=self._place.__getitem__)]

    # Next steps

    def adopt(self, old: Workflow, members: Members) -> Iterator[Member]:
        """Take over the contracts of the old plan for equal steps. Yields the participants whose steps no longer exist."""
        waiting: dict[Hashable, deque[StepRun]] = {}
        for run in self:
            waiting.setdefault(run.work, deque()).append(run)
        for run in old:
            member = members.find_member(run.participant)
            if run.progress is not Progress.ARRANGED or member is None:
                continue
            provider = member.offer.provider
            matching_run = next(
                (
                    new
                    for new in waiting.get(run.work, ())
                    if new.step.provider in (None, provider) or provider in new.step.alternative_providers
                ),
                None,
            )
            if matching_run is not None:
                new = matching_run
                waiting[run.work].remove(new)
                self.bind(new, provider)
                self.assign(new, member, run.start, run.finish)
                new.precondition = run.precondition
                member.step = new.key
            else:
                yield member

    def bind(self, run: StepRun, provider: str) -> None:
        """Assign the device to the step, and to all steps of the same device group."""
        if run.step.alternative_providers:
            for other_run in [other_run for other_run in self if other_run.step.device_group == run.step.device_group]:
                other_run.step = assign_provider(other_run.step, provider)

    def run_of(self, member: Member) -> StepRun | None:
        """The step for which the participant was asked."""
        return self._by_key.get(member.step)

    def held_by(self, member: Member) -> StepRun | None:
        """The step that the participant is committed to or executes."""
        run = self.run_of(member)
        return run if run is not None and run.participant == member.id else None

    def predecessors(self, step: str) -> Sequence[StepRun]:
        """The steps that must be completed before this one."""
        return self._predecessors[step]

    @property
    def open(self) -> list[StepRun]:
        """The steps to arrange next: all their predecessors are promised, so that their earliest start is known."""
        return self._in_order(self._open)

    @property
    def remaining(self) -> list[StepRun]:
        """The steps that are not completed, in topological order."""
        return [run for run in self if run.progress is not Progress.COMPLETED]

    @property
    def failed(self) -> StepRun | None:
        """The first step that has to be recovered."""
        return next(iter(self._in_order(self._failed)), None)

    @property
    def ready(self) -> list[StepRun]:
        """Arranged steps whose predecessors are all completed."""
        return self._in_order(self._ready)

    @property
    def arranged(self) -> bool:
        """Whether every step is arranged, in execution or completed."""
        return not any(self._count[progress] for progress in _UNPROMISED)

    @property
    def unarranged(self) -> Iterator[StepRun]:
        """The steps to which no service is committed."""
        return (run for run in self if run.progress in _UNPROMISED)

    @property
    def busy(self) -> bool:
        """Whether any step is executing or reporting."""
        return bool(self._count[Progress.EXECUTING] or self._count[Progress.REPORTING])

    @property
    def is_completed(self) -> bool:
        return self._count[Progress.COMPLETED] == len(self.runs)

    @property
    def step_count(self) -> int:
        """The number of steps."""
        return len(self.runs)

    @property
    def done_count(self) -> int:
        return self._count[Progress.COMPLETED]

    def promised(self, provider: str) -> list[Interval]:
        """The intervals in which the provider is committed."""
        return [(self.runs[id].start, self.runs[id].finish) for id in self._promised.get(provider, ())]

    @property
    def providers(self) -> Iterable[str]:
        """The providers that are or were committed to a step."""
        return self._promised

    def promised_effects(self, run: StepRun) -> list[Formula]:
        """What the steps bring about that have to be completed before this one and are not yet, in the order of the plan."""
        waiting, ids = [*self.predecessors(run.step.id)], set[str]()
        while waiting:
            predecessor = waiting.pop()
            if predecessor.progress is not Progress.COMPLETED and predecessor.step.id not in ids:
                ids.add(predecessor.step.id)
                waiting += self.predecessors(predecessor.step.id)
        return [outcome for predecessor in self._in_order(ids) if (outcome := predecessor.step.outcome) is not None]

    def concurrent(self, run: StepRun) -> list[StepRun]:
        """The steps that are not completed and that the plan puts neither before nor after this one."""
        ordered = self._reached(run, self._predecessors) | self._reached(run, self._successors) | {run.step.id}
        return [other for other in self.remaining if other.step.id not in ordered]

    def _reached(self, run: StepRun, neighbours: Mapping[str, Sequence[StepRun]]) -> set[str]:
        waiting, ids = [*neighbours[run.step.id]], set[str]()
        while waiting:
            if (neighbour := waiting.pop().step.id) not in ids:
                ids.add(neighbour)
                waiting += neighbours[neighbour]
        return ids

    def earliest_start(self, run: StepRun, now: float) -> float:
        """The promised finish of all predecessors of the step; at least `now`."""
        return max(
            [now, *(predecessor.finish for predecessor in self.predecessors(run.step.id) if predecessor.progress is not Progress.COMPLETED)]
        )


def _set_member(ids: set[str], id: str, is_member: bool) -> None:
    if is_member:
        ids.add(id)
    else:
        ids.discard(id)
