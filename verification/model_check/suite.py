"""The configurations that are checked, and their results."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial

from verification.model_check.chart import pair_chart, single_chart
from verification.model_check.explore import StateSpace, explore
from verification.model_check.media import DUPLICATING, FIFO, LOSSY_FIFO, MEDIA, OUTBOX, Medium
from verification.model_check.pair import PairSpace, explore_pair
from verification.model_check.property import Property
from verification.model_check.quotient import quotient
from verification.model_check.step import StepKind
from verification.model_check.system import Link, LostDisk, Model

LOST_DISKS = ((FIFO, LostDisk.PARTICIPANT), (FIFO, LostDisk.COORDINATOR), (DUPLICATING, LostDisk.COORDINATOR))
"""The media on which a disk is lost. On the others, the loss of the participant's disk has too many states."""


@dataclass(frozen=True, kw_only=True)
class Counterexample:
    """A violated property, and a shortest run that violates it."""

    property: Property
    reason: str
    chart: list[str]


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of one configuration. `cells` has the properties that were checked; None means that the property holds."""

    medium: str
    configuration: str
    states: int
    seconds: float
    cells: dict[Property, Counterexample | None]


Check = Callable[[], Result]
"""The check of one configuration. It can be sent to another process."""


def run_check(check: Check) -> Result:
    """Run the check, in whichever process this is."""
    return check()


SINGLE_PROPERTIES = (
    Property.VALID_STATE,
    Property.CONTRACT,
    Property.TERMINATION,
    Property.PARTIAL_RESULT,
    Property.ORPHAN,
    Property.RESTART,
)


KIND_PROPERTIES: dict[StepKind, tuple[Property, ...]] = {
    StepKind.PLAIN: (),
    StepKind.CONDITIONAL: (Property.CONDITION, Property.REFUSAL),
    StepKind.NOT_NOW: (Property.REFUSAL,),
    StepKind.WHILE: (Property.INVARIANT,),
    StepKind.RECOGNITION: (Property.RECOGNITION,),
}
"""The properties that concern one kind of step only."""

KINDS = tuple(kind for kind in StepKind if kind is not StepKind.PLAIN)


def check_one(medium: Medium) -> Result:
    """Check one participant, with kills and restarts at any moment and, for property 7, without."""
    return _check_part(StepKind.PLAIN, medium, "1 participant")


def check_two(medium: Medium) -> Result:
    """Check two participants of one step. Properties of one are checked in its part with arbitrary others."""
    return _check_pair(StepKind.PLAIN, OUTBOX if medium == LOSSY_FIFO else medium, "2 participants")


def _check_part(kind: StepKind, medium: Medium, configuration: str) -> Result:
    started_at = time.perf_counter()
    calm = explore(Link(Model(medium=medium, restarts=False, lapses=True, kind=kind)), single_participant=True)
    space = explore(Link(Model(medium=medium, lapses=True, kind=kind)), single_participant=True)
    cells: dict[Property, Counterexample | None] = dict.fromkeys((*SINGLE_PROPERTIES, *KIND_PROPERTIES[kind]))
    cells |= _counterexamples(space)
    if new := space.outcomes - calm.outcomes:
        cells[Property.RESTART] = _only_with_restarts(new)
    seconds = time.perf_counter() - started_at
    return Result(medium=medium.name, configuration=configuration, states=len(space.states), seconds=seconds, cells=cells)


def _check_pair(kind: StepKind, medium: Medium, configuration: str) -> Result:
    started_at = time.perf_counter()
    properties = (*SINGLE_PROPERTIES, Property.MUTUAL_EXCLUSION, *KIND_PROPERTIES[kind])
    cells: dict[Property, Counterexample | None] = dict.fromkeys(properties)
    _, calm = _explore_two(Model(medium=medium, restarts=False, kind=kind))
    part, space = _explore_two(Model(medium=medium, kind=kind))
    cells |= _counterexamples(part) | pair_counterexamples(space)
    if new := space.outcomes - calm.outcomes:
        cells[Property.RESTART] = _only_with_restarts(new)
    seconds = time.perf_counter() - started_at
    return Result(medium=medium.name, configuration=configuration, states=len(space.states), seconds=seconds, cells=cells)


def check_kind(kind: StepKind, medium: Medium) -> Result:
    """Check one participant with a step of this kind, with kills and restarts at any moment and, for property 7, without."""
    return _check_part(kind, OUTBOX if medium == LOSSY_FIFO else medium, str(kind))


def check_kind_with_two(kind: StepKind, medium: Medium) -> Result:
    """Check two participants of one step of this kind."""
    return _check_pair(kind, OUTBOX if medium == LOSSY_FIFO else medium, f"{kind}, 2 participants")


def check_lost_disk(medium: Medium, lost_disk: LostDisk) -> Result:
    """Check that one participant's part terminates when a journal is lost. No other property is required then."""
    started_at = time.perf_counter()
    space = explore(Link(Model(medium=medium, restarts=False, lost_disk=lost_disk)), single_participant=True)
    cells: dict[Property, Counterexample | None] = {Property.TERMINATION: None, **_counterexamples(space)}
    return Result(
        medium=medium.name,
        configuration=f"{lost_disk.value} disk is lost",
        states=len(space.states),
        seconds=time.perf_counter() - started_at,
        cells=cells,
    )


def check_assumption(*, cut_off: bool, clocks: bool) -> Result:
    """Check two participants without one half of the timing assumption. Property 1 has to fail: no protocol can ensure it then."""
    started_at = time.perf_counter()
    _, space = _explore_two(Model(medium=FIFO, restarts=False, cut_off=cut_off, clocks=clocks))
    configuration = "a silent participant works on" if not cut_off else "a late order is executed"
    cells = {Property.MUTUAL_EXCLUSION: pair_counterexamples(space).get(Property.MUTUAL_EXCLUSION)}
    return Result(
        medium=FIFO.name, configuration=configuration, states=len(space.states), seconds=time.perf_counter() - started_at, cells=cells
    )


def plain_checks() -> list[Check]:
    """The checks of all configurations of a plain step, in which the properties have to hold."""
    return [
        *(partial(check_one, medium) for medium in MEDIA),
        *(partial(check_two, medium) for medium in MEDIA),
        *(partial(check_lost_disk, medium, lost_disk) for medium, lost_disk in LOST_DISKS),
    ]


def kind_checks() -> list[Check]:
    """The checks of steps that depend on more than the protocol, each kind by itself."""
    checks: list[Check] = []
    for kind in KINDS:
        checks += (partial(check_kind, kind, medium) for medium in MEDIA)
        checks.append(partial(check_kind_with_two, kind, DUPLICATING))
    return checks


def assumption_checks() -> list[Check]:
    """The checks without one half of the timing assumption."""
    return [partial(check_assumption, cut_off=False, clocks=True), partial(check_assumption, cut_off=True, clocks=False)]


def _explore_two(model: Model) -> tuple[StateSpace, PairSpace]:
    part = explore(Link(model), single_participant=False)
    return part, explore_pair(quotient(part))


def _counterexamples(space: StateSpace) -> dict[Property, Counterexample | None]:
    return {
        prop: Counterexample(property=prop, reason=violation.reason, chart=single_chart(space, violation))
        for prop, violation in space.violations.items()
    }


def pair_counterexamples(space: PairSpace) -> dict[Property, Counterexample | None]:
    return {
        prop: Counterexample(property=prop, reason=violation.reason, chart=pair_chart(space, violation.state, violation.reason))
        for prop, violation in space.violations.items()
    }


def _only_with_restarts(outcomes: Collection[object]) -> Counterexample:
    return Counterexample(property=Property.RESTART, reason=f"outcomes only with restarts: {sorted(map(str, outcomes))}", chart=[])
