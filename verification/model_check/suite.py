"""The configurations that are checked, and their results."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from verification.model_check.chart import pair_chart, single_chart
from verification.model_check.explore import StateSpace, Tick, explore
from verification.model_check.media import DUPLICATING, FIFO, LOSSY_FIFO, MEDIA, OUTBOX, Medium
from verification.model_check.pair import PairSpace, explore_pair
from verification.model_check.properties import Property
from verification.model_check.quotient import quotient
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


SINGLE_PROPERTIES = (
    Property.VALID_STATE,
    Property.CONTRACT,
    Property.TERMINATION,
    Property.PARTIAL_RESULT,
    Property.ORPHAN,
    Property.RESTART,
)


def check_one(medium: Medium, tick: Tick | None = None) -> Result:
    """Check one participant, with kills and restarts at any moment and, for property 7, without."""
    started_at = time.perf_counter()
    calm = explore(Link(Model(medium=medium, restarts=False, lapses=True)), single_participant=True, tick=tick)
    space = explore(Link(Model(medium=medium, lapses=True)), single_participant=True, tick=tick)
    cells: dict[Property, Counterexample | None] = dict.fromkeys(SINGLE_PROPERTIES)
    cells |= _counterexamples(space)
    if new := space.outcomes - calm.outcomes:
        cells[Property.RESTART] = _only_with_restarts(new)
    return Result(
        medium=medium.name, configuration="1 participant", states=len(space.states), seconds=time.perf_counter() - started_at, cells=cells
    )


def check_two(medium: Medium, tick: Tick | None = None) -> Result:
    """Check two participants of one step. Properties of one are checked in its part with arbitrary others."""
    started_at = time.perf_counter()
    medium = OUTBOX if medium is LOSSY_FIFO else medium
    cells: dict[Property, Counterexample | None] = dict.fromkeys(Property)
    _, calm = _explore_two(Model(medium=medium, restarts=False), tick)
    part, space = _explore_two(Model(medium=medium), tick)
    cells |= _counterexamples(part) | pair_counterexamples(space)
    if new := space.outcomes - calm.outcomes:
        cells[Property.RESTART] = _only_with_restarts(new)
    return Result(
        medium=medium.name, configuration="2 participants", states=len(space.states), seconds=time.perf_counter() - started_at, cells=cells
    )


def check_lost_disk(medium: Medium, lost_disk: LostDisk, tick: Tick | None = None) -> Result:
    """Check that one participant's part terminates when a journal is lost. No other property is required then."""
    started_at = time.perf_counter()
    space = explore(Link(Model(medium=medium, restarts=False, lost_disk=lost_disk)), single_participant=True, tick=tick)
    cells: dict[Property, Counterexample | None] = {Property.TERMINATION: None, **_counterexamples(space)}
    return Result(
        medium=medium.name,
        configuration=f"{lost_disk.value} disk is lost",
        states=len(space.states),
        seconds=time.perf_counter() - started_at,
        cells=cells,
    )


def check_assumption(*, cut_off: bool, clocks: bool, tick: Tick | None = None) -> Result:
    """Check two participants without one half of the timing assumption. Property 1 has to fail: no protocol can ensure it then."""
    started_at = time.perf_counter()
    _, space = _explore_two(Model(medium=FIFO, restarts=False, cut_off=cut_off, clocks=clocks), tick)
    configuration = "a silent participant works on" if not cut_off else "a late order is executed"
    cells = {Property.MUTUAL_EXCLUSION: pair_counterexamples(space).get(Property.MUTUAL_EXCLUSION)}
    return Result(
        medium=FIFO.name, configuration=configuration, states=len(space.states), seconds=time.perf_counter() - started_at, cells=cells
    )


def check_all(tick: Tick | None = None) -> Iterator[Result]:
    """Yield the results of all configurations in which the properties have to hold."""
    for medium in MEDIA:
        yield check_one(medium, tick)
    for medium in MEDIA:
        yield check_two(medium, tick)
    for medium, lost_disk in LOST_DISKS:
        yield check_lost_disk(medium, lost_disk, tick)


def _explore_two(model: Model, tick: Tick | None) -> tuple[StateSpace, PairSpace]:
    part = explore(Link(model), single_participant=False, tick=tick)
    return part, explore_pair(quotient(part), tick=tick)


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
