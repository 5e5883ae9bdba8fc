"""The work of services in one task, in the order in which it began: the work to undo if the task is not accomplished."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct, field

from somrs.entish import Formula, Name
from somrs.entish.formula import Attribute, Comparison, Not, Relation, conjunction, conjuncts, names
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.effects import changes
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactAdded, FactRemoved, ValueSet, objects_of
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.ontology.values import constant
from somrs.planner.model.plan import Step
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.task_views import WorkView
from somrs.task_manager.execution.member import INTERRUPTED, Member
from somrs.task_manager.execution.workflow import StepRun


class Work(Struct, kw_only=True, eq=False):
    """The work of one service on one step.

    `situation` is what the service, or an observation, last reported about it. `key` is the key of the step.
    """

    number: int
    """Counts the work of a task, in the order in which it began."""
    label: str
    """The name of the step for clients."""
    key: str
    step: Step
    service_type: ServiceType
    participant: str
    service: str
    provider: str
    started_at: float = field(name="began")
    prior_situation: Formula | None = field(default=None, name="before")
    """The situation that compensation restores; None if there is nothing to restore."""
    concerned: tuple[str, ...] = ()
    """The objects that the step changes."""
    state: State = State.EXECUTING
    result: State | None = None
    """How the work ended. Compensation changes `state`, but not `result`."""
    ended: float | None = None
    observed_at: float | None = None
    """When that was so which an observation reported, if it says so."""
    untouched: bool = False
    """It counts as undone because it has changed nothing."""
    situation: str | None = None
    note: str = ""
    price: float | None = None
    currency: str = "EUR"
    goal: GoalKind = GoalKind.TASK
    """The kind of goal that the work serves. Work that compensates is not compensated itself."""
    superseded: bool = field(default=False, name="taken_over")
    """It was interrupted, and other work on the same objects replaced it. Compensating that work restores the situation before both."""
    overtaken: bool = False
    """Other tasks have changed its objects since, while this one waited: what it left is not there any more, and is not undone."""
    supersedes: int | None = field(default=None, name="took_over")
    """The number of the interrupted work that it replaced."""

    @property
    def matters(self) -> bool:
        """Whether the reasons of a task that was not accomplished mention this work."""
        return self.service_type.kind is ServiceKind.PHYSICAL and not self.superseded and self.goal is not GoalKind.UNDO

    @property
    def changed_nothing(self) -> bool:
        """Whether the service reported at its end that the prior situation still held. Later changes are due to other tasks."""
        if self.state not in (State.COMPLETED, State.FAILED, State.STOPPED) or self.prior_situation is None or self.situation is None:
            return False
        try:
            situation_parts = [*conjuncts(parse(self.situation))]
        except FormulaError:
            return False
        return all(part in situation_parts for part in conjuncts(self.prior_situation))

    def end(self, result: State, now: float) -> None:
        """Set the result. Later calls, which concern the compensation of the work, change nothing."""
        if self.result is None:
            self.result, self.ended = result, now

    def is_described_by(self, situation: Formula) -> bool:
        """Whether the situation mentions an object that the step changes."""
        return not set(self.concerned).isdisjoint(names(situation))

    def view(self) -> WorkView:
        return WorkView(
            step=self.label,
            service=self.service,
            service_type=self.step.service_type,
            inputs={name: str(term) for name, term in self.step.inputs.items()},
            began=self.started_at,
            state=self.state,
            result=self.result,
            ended=self.ended,
            situation=self.situation,
            before=str(self.prior_situation) if self.prior_situation is not None else None,
            note=self.note,
            goal=self.goal,
            price=self.price,
            currency=self.currency,
        )

    def in_words(self, map: Map, ontology: Ontology) -> str:
        """The outcome of the work as a sentence, for the reasons of a task that was not accomplished.

        Of what the service did not report, it says what the map has now.
        """
        action = f"{self.step.service_type} by {self.service}"
        since = ", which another task has changed since" if self.overtaken else ""
        match self.state:
            case State.COMPENSATED if self.untouched:
                return f"{action} changed nothing: {self.prior_situation}"
            case State.COMPENSATED:
                return f"{action} was undone: {self.prior_situation}"
            case State.STRANDED:
                leftover = f"it left {self.situation}" if self.situation else f"it did not say what it left: {self._now(map, ontology)}"
                return f"{action} could not be undone, and {leftover}"
            case State.COMPLETED:
                return f"{action} was done: {self.situation}{since}"
            case _:
                return f"{action} was interrupted: {self.situation or self.note}{since}"

    def _now(self, map: Map, ontology: Ontology) -> str:
        """What the map says of what the step changes."""
        situation = situation_to_restore(self.step, map, ontology)
        unknown = [name for name in self.concerned if name not in map.objects or map.objects[name].values.get(UNKNOWN) is True]
        parts = [f"now the map says {situation}"] if situation is not None else []
        if unknown or not parts:
            parts.append(f"nothing is known of {', '.join(unknown or self.concerned)}")
        return ", and ".join(parts)


class ExecutionLog(Struct, kw_only=True):
    """All work of one task. `work_count` includes dropped work."""

    works: list[Work] = field(default_factory=list)
    work_count: int = field(default=0, name="begun")

    def __iter__(self) -> Iterator[Work]:
        return iter(self.works)

    def begin(self, run: StepRun, service_type: ServiceType, member: Member, map: Map, ontology: Ontology, now: float) -> Work:
        """Add a step that is about to be executed. `map` is the map before it."""
        self.work_count += 1
        work = Work(
            number=self.work_count,
            label=run.label,
            key=run.key,
            step=run.step,
            service_type=service_type,
            participant=member.id,
            service=member.offer.service,
            provider=member.offer.provider,
            started_at=now,
            goal=run.goal,
        )
        if member.bid is not None:
            work.price, work.currency = member.bid.terms.price, member.bid.terms.currency
        if service_type.kind is ServiceKind.PHYSICAL:
            work.prior_situation, work.concerned = situation_to_restore(run.step, map, ontology), concerned_objects(run.step, map, ontology)
            self._supersede_interrupted(work)
        self.works.append(work)
        return work

    def _supersede_interrupted(self, work: Work) -> None:
        for earlier in reversed(self.works):
            if earlier.concerned == work.concerned and earlier.prior_situation is not None:
                if earlier.state in INTERRUPTED and not earlier.overtaken and GoalKind.UNDO not in (earlier.goal, work.goal):
                    work.prior_situation, earlier.superseded, work.supersedes = earlier.prior_situation, True, earlier.number
                return

    def overtake(self, objects: Iterable[str]) -> None:
        """Record that another task has changed these objects."""
        changed_objects = set(objects)
        for work in self.works:
            if work.state in (State.COMPLETED, *INTERRUPTED) and not changed_objects.isdisjoint(work.concerned):
                work.overtaken = True

    def has_work_on(self, situation: str) -> bool:
        """Whether work of the task may have changed what a reported situation speaks of."""
        try:
            formula = parse(situation)
        except FormulaError:
            return True
        return any(work.service_type.kind is ServiceKind.PHYSICAL and work.is_described_by(formula) for work in self.works)

    def drop(self, work: Work) -> None:
        """Remove work that did not begin."""
        self.works = [entry for entry in self.works if entry is not work]
        if work.supersedes is not None:
            self.work_by_number(work.supersedes).superseded = False

    def work_of(self, member: Member) -> Work | None:
        return next((work for work in reversed(self.works) if work.participant == member.id), None)

    def work_by_number(self, number: int) -> Work:
        return next(work for work in reversed(self.works) if work.number == number)

    def to_undo(self) -> list[Work]:
        """The work to undo, the latest first: later work may depend on earlier work."""
        return [
            work
            for work in reversed(self.works)
            if work.prior_situation is not None
            and work.goal is not GoalKind.UNDO
            and not work.superseded
            and not work.overtaken
            and work.state in (State.COMPLETED, *INTERRUPTED)
        ]

    def interrupted(self) -> list[Work]:
        """The interrupted work to undo, the latest first. What it left may prevent a plan."""
        return [work for work in self.to_undo() if work.state in INTERRUPTED]


def concerned_objects(step: Step, map: Map, ontology: Ontology) -> tuple[str, ...]:
    """The objects that the step changes, without its own device unless that is the only one."""
    try:
        map_changes = changes(step.effect, map, ontology)
    except FormulaError:
        return ()
    spoken_of = (names(part)[0] for part in conjuncts(step.effect) if names(part))  # the effect may hold already
    changed_objects = dict.fromkeys(objects_of(change)[0] for change in map_changes) or dict.fromkeys(spoken_of)
    other_objects = tuple(name for name in changed_objects if name != step.provider)
    return other_objects or tuple(changed_objects)


def situation_to_restore(step: Step, map: Map, ontology: Ontology) -> Formula | None:
    """The situation that compensation of the step restores (paper, "Failure handling"); None if there is nothing to restore.

    It consists of what the step changes, as it is on the map now, and of the parts of its effect that hold already.
    """
    try:
        map_changes = changes(step.effect, map, ontology)
        parts = [part for part in conjuncts(step.effect) if not changes(part, map, ontology)]
    except FormulaError:
        return None
    for change in map_changes:
        match change:
            case FactRemoved(fact):
                parts.append(_atom(fact))
            case ValueSet(name, path) if path != UNKNOWN and (old := map.objects[name].values.get(path)) is not None:
                attribute = ontology.attributes_of(map.objects[name].type).get(path)
                parts.append(Comparison(Attribute(Name(name), path), "=", constant(old, attribute)))
            case FactAdded(fact) if not ontology.relations[fact.relation].functional and ontology.relations[fact.relation].excludes is None:
                parts.append(Not(_atom(fact)))
    return conjunction(*parts) if parts else None


def _atom(fact: Fact) -> Relation:
    return Relation(fact.relation, tuple(Name(name) for name in fact.arguments))
