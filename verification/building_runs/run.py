"""A run: a whole system in the kinematic world, all deliveries at once, and what must hold at the end."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.files.loading import load
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from somrs.space.shafts import shafts_of
from verification.building_runs.errands import Delivery, Trip, site_of

BETWEEN = 0.5
"""A robot whose height differs by more than this from that of all floors rides in a lift, m."""
LOOK = 0.005
"""The time between two looks at the robots, s."""
LIMIT = 5 * 3600.0
"""The simulated time after which robots that still move are in each other's way for good, s."""
RESTS = 60
"""How often in a row the world is found at rest, about once per second, before open tasks count as forgotten."""
ATTEMPTS = 3
"""A task that has tried so often waits for something that has to be mended."""


@dataclass(slots=True)
class Result:
    """What came of a run. `explanations` and `waiting`: why tasks were not accomplished, and for what others wait, by the goals;
    `problems`: what must not be."""

    outcomes: dict[str, str] = field(default_factory=dict)
    explanations: dict[str, str] = field(default_factory=dict)
    waiting: dict[str, str] = field(default_factory=dict)
    broken: str | None = None
    simulated: float = 0.0
    problems: list[str] = field(default_factory=list)


async def play(site: Sequence[Path], chosen: Sequence[Delivery | Trip], folder: Path, *, breaks: bool) -> Result:
    """Deliver in a building. `breaks`: the first robot that rides in a lift breaks there."""
    deliveries, jars = [errand for errand in chosen if isinstance(errand, Delivery)], folder / "jars.yaml"
    if deliveries:
        jars.write_text(site_of(deliveries))
    result = Result()
    async with (
        System((*site, jars) if deliveries else site, folder / "run", speed="max", world=WorldKind.KINEMATIC) as system,
        Client(system.addresses) as client,
        operator_link(system.addresses) as link,
    ):
        levels = _levels(site)
        breaker = asyncio.create_task(_break_in_lift(link, levels)) if breaks else None
        ids = {errand.formula: await client.submit(Submit(effect=errand.formula)) for errand in chosen}
        watches = [asyncio.create_task(_watch(client, goal, id, result)) for goal, id in ids.items()]
        try:
            await _until_done(watches, link, result)
        finally:
            for watch in (*watches, *([breaker] if breaker is not None else [])):
                watch.cancel()
            await asyncio.wait(watches)
        errors = {goal: watch.exception() for goal, watch in zip(ids, watches, strict=True) if not watch.cancelled()}
        result.problems += [f"{goal} could not be followed: {error}" for goal, error in errors.items() if error is not None]
        if breaker is not None and breaker.done() and not breaker.cancelled():
            result.broken = breaker.result()
        if result.broken is None:  # robots get wherever they are sent
            failed = [goal for goal, outcome in result.outcomes.items() if outcome != Outcome.ACCOMPLISHED]
            result.problems += [f"{goal} was not accomplished, although nothing was broken" for goal in (*failed, *result.waiting)]
        result.simulated = (await link.clock()).time
        await _check(client, link, deliveries, result)
    return result


async def _watch(client: Client, goal: str, id: str, result: Result) -> None:
    async for news in client.news(id):
        view: TaskView = news.view
        if view.outcome is not None:
            result.waiting.pop(goal, None)
            result.outcomes[goal] = view.outcome
            if view.outcome is not Outcome.ACCOMPLISHED:
                result.explanations[goal] = view.explanation
            if view.outcome is not Outcome.ACCOMPLISHED and not view.explanation:
                result.problems.append(f"{goal}: {view.outcome}, and it does not say why")
            return
        if view.waiting_to_retry is not None and view.waiting_to_retry.attempts >= ATTEMPTS:
            result.waiting[goal] = "; ".join(hindrance.reason for hindrance in view.waiting_to_retry.hindrances)
        else:
            result.waiting.pop(goal, None)


async def _until_done(watches: Sequence[asyncio.Task[None]], link: OperatorLink, result: Result) -> None:
    """Until each task has ended, or waits for something that has to be mended while all robots are idle."""
    rests, last_time = 0, -1.0
    while pending := [watch for watch in watches if not watch.done()]:
        await asyncio.wait(pending, timeout=1.0)
        now, states = (await link.clock()).time, await link.robots()
        rests, last_time = rests + 1 if now == last_time else 0, now  # a world at rest keeps its time
        open_count = sum(not watch.done() for watch in watches)
        if open_count <= len(result.waiting) and all(state.activity is None for state in states.values()):
            return
        if now > LIMIT or rests > RESTS:
            what = "nothing moves" if rests > RESTS else f"it is {now:.0f} s"
            result.problems.append(f"{open_count} tasks are open, {len(result.waiting)} of them say what they wait for, and {what}")
            return


async def _break_in_lift(link: OperatorLink, levels: Sequence[float]) -> str:
    while True:
        for name, state in (await link.robots()).items():
            if all(abs((state.z or 0.0) - level) > BETWEEN for level in levels):
                await link.fault(name, Fault.DRIVE)
                return name
        await asyncio.sleep(LOOK)


async def _check(client: Client, link: OperatorLink, deliveries: Sequence[Delivery], result: Result) -> None:
    """Nothing is left to clean up: jars are where the map has them, and only what was broken is out of order."""
    for delivery in deliveries:
        state = await link.observe(delivery.jar)
        if result.outcomes.get(delivery.formula) == Outcome.ACCOMPLISHED and state.support != delivery.goal:
            result.problems.append(f"{delivery.formula}: accomplished, but it is on {state.support}")
    for row in (await client.query("?Robot: MobileRobot.Working = FALSE")).rows:
        if row.bindings["Robot"] != result.broken:
            result.problems.append(f"{row.bindings['Robot']} does not work")
    result.problems += [f"{row.bindings['Thing']} is unknown" for row in (await client.query("?Thing: Graspable.Unknown = TRUE")).rows]


def _levels(site: Sequence[Path]) -> list[float]:
    model = load(site)
    shafts = shafts_of(model.map, model.ontology) if model.map is not None else []
    return [landing.level for shaft in shafts for landing in shaft.landings] or [0.0]
