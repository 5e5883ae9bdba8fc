"""What is checked: which configurations, and what came of each."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from verification.model_check.chart import chart_of_one, chart_of_two
from verification.model_check.explore import Space, Tick, explore
from verification.model_check.media import DUPLICATING, FIFO, LOSSY_FIFO, MEDIA, OUTBOX, Medium
from verification.model_check.pair import PairSpace, explore_pair
from verification.model_check.properties import Property
from verification.model_check.quotient import quotient
from verification.model_check.system import Link, Lost, Model

LOST = ((FIFO, Lost.PARTICIPANT), (FIFO, Lost.COORDINATOR), (DUPLICATING, Lost.COORDINATOR))
"""The media on which a disk is lost. On others the participant's loss has too many states to look at all of them."""


@dataclass(frozen=True, kw_only=True)
class Broken:
    """A property that falls, and the shortest run in which it does."""

    property: Property
    why: str
    chart: list[str]


@dataclass(frozen=True, kw_only=True)
class Result:
    """What came of one configuration. `cells` has what was looked for: None for what holds."""

    medium: str
    what: str
    states: int
    seconds: float
    cells: dict[Property, Broken | None]


ALONE = (Property.FITS, Property.CONTRACT, Property.HOME, Property.HALF_DONE, Property.ORPHAN, Property.RESTART)


def check_one(medium: Medium, tick: Tick | None = None) -> Result:
    """One participant, killed and restarted at any moment and, for property 7, never."""
    began = time.perf_counter()
    calm = explore(Link(Model(medium=medium, restarts=False, lapses=True)), alone=True, tick=tick)
    space = explore(Link(Model(medium=medium, lapses=True)), alone=True, tick=tick)
    cells: dict[Property, Broken | None] = dict.fromkeys(ALONE)
    cells |= _fallen(space)
    if new := space.outcomes - calm.outcomes:
        cells[Property.RESTART] = _only_with_restarts(new)
    return Result(medium=medium.name, what="1 participant", states=len(space.states), seconds=time.perf_counter() - began, cells=cells)


def check_two(medium: Medium, tick: Tick | None = None) -> Result:
    """Two participants of one step. What concerns each alone is looked for in its part with any others beside it."""
    began = time.perf_counter()
    medium = OUTBOX if medium is LOSSY_FIFO else medium
    cells: dict[Property, Broken | None] = dict.fromkeys(Property)
    _, calm = _two(Model(medium=medium, restarts=False), tick)
    part, space = _two(Model(medium=medium), tick)
    cells |= _fallen(part) | fallen_of_two(space)
    if new := space.outcomes - calm.outcomes:
        cells[Property.RESTART] = _only_with_restarts(new)
    return Result(medium=medium.name, what="2 participants", states=len(space.states), seconds=time.perf_counter() - began, cells=cells)


def check_lost_disk(medium: Medium, whose: Lost, tick: Tick | None = None) -> Result:
    """One participant, and a journal that is lost: nobody is held to what is forgotten, but all get home."""
    began = time.perf_counter()
    space = explore(Link(Model(medium=medium, restarts=False, lost_disk=whose)), alone=True, tick=tick)
    cells: dict[Property, Broken | None] = {Property.HOME: None, **_fallen(space)}
    return Result(
        medium=medium.name, what=f"{whose.value} disk is lost", states=len(space.states), seconds=time.perf_counter() - began, cells=cells
    )


def check_assumption(*, cut_off: bool, clocks: bool, tick: Tick | None = None) -> Result:
    """Two participants without a half of the timing assumption: property 1 has to fall, for no protocol can have it then."""
    began = time.perf_counter()
    _, space = _two(Model(medium=FIFO, restarts=False, cut_off=cut_off, clocks=clocks), tick)
    without = "a silent participant works on" if not cut_off else "a late order is obeyed"
    cells = {Property.HANDS: fallen_of_two(space).get(Property.HANDS)}
    return Result(medium=FIFO.name, what=without, states=len(space.states), seconds=time.perf_counter() - began, cells=cells)


def everything(tick: Tick | None = None) -> Iterator[Result]:
    """All that has to hold."""
    for medium in MEDIA:
        yield check_one(medium, tick)
    for medium in MEDIA:
        yield check_two(medium, tick)
    for medium, whose in LOST:
        yield check_lost_disk(medium, whose, tick)


def _two(model: Model, tick: Tick | None) -> tuple[Space, PairSpace]:
    part = explore(Link(model), alone=False, tick=tick)
    return part, explore_pair(quotient(part), tick=tick)


def _fallen(space: Space) -> dict[Property, Broken | None]:
    return {which: Broken(property=which, why=falls.why, chart=chart_of_one(space, falls)) for which, falls in space.falls.items()}


def fallen_of_two(space: PairSpace) -> dict[Property, Broken | None]:
    return {
        which: Broken(property=which, why=falls.why, chart=chart_of_two(space, falls.state, falls.why))
        for which, falls in space.falls.items()
    }


def _only_with_restarts(outcomes: Collection[object]) -> Broken:
    return Broken(property=Property.RESTART, why=f"only with restarts it ends so: {sorted(map(str, outcomes))}", chart=[])
