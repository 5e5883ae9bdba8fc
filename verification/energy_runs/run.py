"""One energy run: a whole system of real processes, whose robots carry boxes for some simulated hours."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.deployment.launcher import Launcher
from somrs.deployment.supervision import keep_running
from somrs.deployment.system import System
from somrs.devices.simulator.drivers.charging import ENOUGH
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from verification.energy_runs.fleet import Fleet

LOOK = 1.0
"""Seconds between two looks at the robots."""

MOST_FAILURES = 5
"""The number of tasks that may fail, in addition to one for ten that are accomplished: robots block each other, too."""


@dataclass(slots=True)
class EnergyResult:
    """What happened in a run: simulated hours, how the tasks ended, and the charges of the robots."""

    seed: int
    hours: float = 0.0
    outcomes: dict[Outcome, int] = field(default_factory=lambda: dict.fromkeys(Outcome, 0))
    charging_tasks: int = 0
    lowest_charge: float = 100.0
    last_charges: dict[str, float] = field(default_factory=dict)
    stranded: set[str] = field(default_factory=set)
    explanations: list[str] = field(default_factory=list)

    @property
    def violation(self) -> str:
        """What must not happen; empty if it did not."""
        if self.stranded:
            return f"{', '.join(sorted(self.stranded))} stood with an empty battery"
        if self.outcomes[Outcome.FAILED] > MOST_FAILURES + self.outcomes[Outcome.ACCOMPLISHED] / 10:
            return f"{self.outcomes[Outcome.FAILED]} tasks failed"
        return ""


class EnergyRun:
    """A run of a fleet for some simulated hours. `data`: the folder of its system.

    `carried_at_once`: how many boxes are carried at the same time. If none is, the run is over when all robots are charged.
    """

    def __init__(
        self, fleet: Fleet, hours: float, data: Path, *, carried_at_once: int = 5, speed: str = "max", launcher: Launcher | None = None
    ) -> None:
        self.fleet, self.hours, self.data, self.speed, self._launcher = fleet, hours, data, speed, launcher
        self._carried_at_once = carried_at_once
        self.result = EnergyResult(fleet.seed)
        self._dice = random.Random(fleet.seed)
        self._free_boxes, self._free_destinations = [*fleet.boxes], set(fleet.destinations[1::2])
        self._is_over = asyncio.Event()
        self.on_look: Callable[..., object] | None = None
        """Called after each look at the robots, with the simulated hours `completed` and what is `told` of the run."""

    async def play(self) -> EnergyResult:
        self.data.mkdir(parents=True, exist_ok=True)
        site = self.data / "hall.yaml"
        site.write_text(self.fleet.site())
        async with (
            System([site], self.data / "run", speed=self.speed, world=WorldKind.KINEMATIC, launcher=self._launcher) as system,
            Client(system.addresses) as client,
            operator_link(system.addresses) as operator,
        ):
            supervisor = asyncio.create_task(keep_running(system, self.result.explanations.append))
            carriers = [asyncio.create_task(self._carry_boxes(client)) for _ in range(self._carried_at_once)]
            try:
                await self._watch(operator)
            finally:
                self._is_over.set()
                for task in (*carriers, supervisor):
                    task.cancel()
                await asyncio.gather(*carriers, supervisor, return_exceptions=True)
            own = [task for task in await client.tasks() if ".Charge >=" in task.effect]
            self.result.charging_tasks = len(own)
        return self.result

    async def _watch(self, operator: OperatorLink) -> None:
        """Look at the robots until the time is over, one of them has an empty battery, or too many tasks fail."""
        while not self.result.violation and not self._is_done():
            await asyncio.sleep(LOOK)
            for name, state in (await operator.robots()).items():
                charge = state.charge if state.charge is not None else 100.0
                self.result.last_charges[name] = charge
                self.result.lowest_charge = min(self.result.lowest_charge, charge)
                self.result.hours = max(self.result.hours, state.time / 3600)
                if charge == 0:
                    self.result.stranded.add(name)
            if self.on_look is not None:
                told = f"{self.result.outcomes[Outcome.ACCOMPLISHED]} tasks accomplished, lowest charge {self.result.lowest_charge:.0f} %"
                self.on_look(completed=self.result.hours, told=told)

    def _is_done(self) -> bool:
        charges = self.result.last_charges.values()
        is_charged = not self._carried_at_once and bool(charges) and min(charges) >= ENOUGH
        return is_charged or self.result.hours >= self.hours

    async def _carry_boxes(self, client: Client) -> None:
        """Submit tasks, one after the other, that bring a box to a free platform."""
        while not self._is_over.is_set():
            box = self._free_boxes.pop(self._dice.randrange(len(self._free_boxes)))
            destination = self._dice.choice(sorted(self._free_destinations))
            self._free_destinations.remove(destination)
            (place,) = (await client.query(f"{box} isOn ?Place")).rows
            task = await client.submit(Submit(effect=f"{box} isOn {destination}"))
            async for news in client.news(task):
                if news.view.outcome is not None:
                    self.result.outcomes[news.view.outcome] += 1
                    if news.view.outcome is not Outcome.ACCOMPLISHED:
                        self.result.explanations.append(f"{news.view.effect}: {news.view.explanation}")
            at_destination = (await client.query(f"{box} isOn {destination}")).rows
            self._free_destinations.add(place.bindings["Place"] if at_destination else destination)
            self._free_boxes.append(box)
