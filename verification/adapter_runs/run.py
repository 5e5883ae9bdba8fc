"""One run: a system with adapters, a task, a kill in the middle of it, and what becomes of it."""

from __future__ import annotations

import asyncio
from pathlib import Path

from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.deployment.system import System
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from verification.adapter_runs.cases import Phase, draw
from verification.adapter_runs.checks import until_agreed
from verification.adapter_runs.site import ROBOTS, goal_of, write_site
from verification.adapter_runs.watching import Watch

MOST_TIME = 400.0
"""Seconds for a task, and for a robot to come to the phase in which something is killed."""


class Run:
    """The run with a seed. `problems`: what was not as it has to be; `text`, `ending`: what was done, and what became of the task, for
    people."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.draw, self._folder = draw(seed), folder
        self.problems: list[str] = []
        self.text = self.ending = ""
        self.is_accomplished = False

    async def play(self) -> None:
        self._folder.mkdir(parents=True)
        case = self.draw.case
        site = write_site(case, self._folder)
        system = System([site], self._folder / "data", world=WorldKind.KINEMATIC, arcos=case.kind == "arcos")
        async with system, Client(system.addresses) as client, operator_link(system.addresses) as operator:
            async with asyncio.timeout(MOST_TIME):
                await _joined(client)
            task = await client.submit(Submit(effect=goal_of(case, self.draw.thing)))
            ending = asyncio.create_task(_end(client, task))
            try:
                await self._kill(system, operator)
                async with asyncio.timeout(MOST_TIME):
                    view = await ending
                self.is_accomplished = view.outcome is Outcome.ACCOMPLISHED
                self.ending = "recovered" if self.is_accomplished else f"the task ended as {view.outcome}: {view.explanation}"
                if not (self.is_accomplished or view.explanation):
                    self.problems.append(f"the task ended as {view.outcome}, and nobody says why")
                await self._check(client, operator)
            except TimeoutError:
                self.problems.append("the task does not end")
            finally:
                ending.cancel()

    async def _kill(self, system: System, operator: OperatorLink) -> None:
        """Kill the victims in their phase, see where the robots come to stand, and start them again."""
        case, watch = self.draw.case, Watch(operator, self.draw.thing)
        async with asyncio.timeout(MOST_TIME):
            await watch.until(case.phase)
        await asyncio.sleep(self.draw.delay)
        granted = await watch.granted()
        for victim in case.victims:
            system.programs[victim].process.kill()
        outage = f"{self.draw.outage:.0f} s"
        self.text = (
            f"{' and '.join(case.victims)} killed while {watch.robot} was {case.phase} (+{self.draw.delay:.1f} s), away for {outage}"
        )
        for victim in case.victims:
            await system.programs[victim].process.wait()
        if not case.victims[0].endswith("-simulated") and case.phase not in (Phase.PASSING, Phase.RIDING):
            if (problem := await watch.stand()) is not None:
                self.problems.append(problem)
            self.problems += await watch.beside(granted)
        await asyncio.sleep(self.draw.outage)
        for victim in sorted(case.victims, key=_start_order):
            await system.restart(victim)

    async def _check(self, client: Client, operator: OperatorLink) -> None:
        """What has to hold after the task."""
        self.problems += await until_agreed(client, operator, ("Jar1", "Jar2"))
        if self.draw.case.phase is Phase.RIDING:
            await self._call_lift(client)
        try:
            async with asyncio.timeout(MOST_TIME / 4):
                await _joined(client)
        except TimeoutError:
            self.problems.append("not all robots offer their services again")

    async def _call_lift(self, client: Client) -> None:
        """No robot has the lift any more, and it does what it is told."""
        try:
            async with asyncio.timeout(MOST_TIME / 4):
                view = await _end(client, await client.submit(Submit(effect="Lift1 standsAt Storey1")))
        except TimeoutError:
            self.problems.append("the lift cannot be called")
        else:
            if view.outcome is not Outcome.ACCOMPLISHED:
                self.problems.append(f"the lift cannot be called: {view.explanation}")


def _start_order(victim: str) -> int:
    """Brokers come first, and then the other ends, as when a system starts."""
    return 0 if victim == "broker" else 1 if victim.endswith("-simulated") else 2


async def _joined(client: Client) -> None:
    """Wait until both robots offer their services."""
    names = {f"{robot}.TransferObject" for robot in ROBOTS}
    while not names <= {offer.service for offer in await client.services()}:
        await asyncio.sleep(0.3)


async def _end(client: Client, task: str) -> TaskView:
    view: TaskView | None = None
    async for news in client.news(task):
        view = news.view
    assert view is not None, "an accepted task has news"
    return view
