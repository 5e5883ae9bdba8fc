"""Kills an adapter, the other end of its wires, or the broker, while a robot fetches or carries something, and starts it again.

    python -m verification.adapter_runs [--runs 12] [--first 0] [--out out/adapter-runs]

No robot may drive on beyond what traffic granted while nobody is there who knows, and the task has to be accomplished in the end. The last
line is `N passed, N failed`.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import math
import random
import shutil
import sys
import time
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.demo.worlds import ros_python
from somrs.deployment.system import System
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.link.roads import RoadPoint
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from somrs.space.lines import point_distance

ROBOTS = ("Robot1", "Robot2")
THINGS = ("Jar002", "Jar003")
FARTHEST = 6.0
"""How far the robot has driven at most when something is killed, in metres."""
STANDING_TIME = 30.0
"""Within this time robots have to stand when nobody tells them anything, in seconds: the base of an order can be some metres long."""
MOST_OFFSET = 0.5
"""How far beside what was granted a robot may come to stand, in metres: it cuts corners, and brakes."""
MOST_TIME = 400.0
"""Seconds for a task."""


class Case(NamedTuple):
    """What is killed, by the label of its program, in a system with robots of this kind."""

    kind: str
    victim: str


CASES = (
    Case("vda5050 2.1", "vda5050"),
    Case("vda5050 2.1", "vda5050-simulated"),
    Case("vda5050 2.1", "broker"),
    Case("vda5050 3.0", "vda5050"),
    Case("vda5050 3.0", "broker"),
    Case("arcos", "arcos"),
    Case("arcos", "arcos-simulated"),
    Case("ros2", "ros2"),
    Case("ros2", "ros2-simulated"),
)


def adapters_for(kind: str) -> dict[str, dict[str, Any]] | None:
    """The settings for both robots; None if their protocol does not run here."""
    match kind.split():
        case ["vda5050", version]:
            return {"vda5050": {"broker": "own", "vehicles": {robot: {"simulated": version} for robot in ROBOTS}}}
        case ["ros2"]:
            python = ros_python()
            binding = resources.files("somrs.demo") / "data" / "scenario-6" / "robot.yaml"
            robots = {robot: {"binding": str(binding), "namespace": robot.lower(), "simulated": True} for robot in ROBOTS}
            return {"ros2": {"python": str(python), "discovery": "LOCALHOST", "robots": robots}} if python is not None else None
    return {}


class Run:
    """A run with a seed. `problems`: what was not as it has to be."""

    def __init__(self, seed: int, case: Case, folder: Path) -> None:
        self.seed, self.case, self._folder = seed, case, folder
        self._random = random.Random(seed)
        self.problems: list[str] = []
        self.text = ""

    async def play(self, adapters: dict[str, dict[str, Any]]) -> None:
        site = resources.files("somrs.demo") / "data" / "scenario-1.yaml"
        with resources.as_file(site) as file:
            system = System([file], self._folder, world=WorldKind.KINEMATIC, adapters=adapters, arcos=self.case.kind == "arcos")
            async with system, Client(system.addresses) as client, operator_link(system.addresses) as operator:
                await self._joined(client)
                task = await client.submit(Submit(effect=f"{self._random.choice(THINGS)} isOn Platform001"))
                watcher = asyncio.create_task(_end(client, task))
                try:
                    await self._kill(system, operator, self._random.uniform(0.3, FARTHEST))
                    async with asyncio.timeout(MOST_TIME):
                        view = await watcher
                    if view.outcome is not Outcome.ACCOMPLISHED:
                        self.problems.append(f"the task ended as {view.outcome}: {view.explanation}")
                except TimeoutError:
                    self.problems.append("the task does not end")
                finally:
                    watcher.cancel()

    async def _joined(self, client: Client) -> None:
        wanted_services = {f"{robot}.TransferObject" for robot in ROBOTS}
        while not wanted_services <= {offer.service for offer in await client.services()}:
            await asyncio.sleep(0.3)

    async def _kill(self, system: System, operator: OperatorLink, distance: float) -> None:
        """Kill the victim when a robot has driven so far, see where the robots come to stand, and start it again."""
        robot, driven, states = await self._driven(operator, distance)
        granted = {name: view.granted for name, view in (await operator.traffic()).robots.items() if name in ROBOTS}
        victim = system.programs[self.case.victim]
        victim.process.kill()
        await victim.process.wait()
        self.text = f"{self.case.victim} killed when {robot} had driven {driven:.1f} m"
        if not self.case.victim.endswith("-simulated"):
            await self._stand(operator)
        final_states = await operator.robots()
        for name in ROBOTS:
            offset = _beside((final_states[name].x, final_states[name].y), (states[name].x, states[name].y), granted.get(name, ()))
            if offset > MOST_OFFSET:
                self.problems.append(f"{name} stands {offset:.2f} m beside what it was granted")
        await system.restart(self.case.victim)

    async def _driven(self, operator: OperatorLink, distance: float) -> tuple[str, float, Any]:
        """Wait until a robot has driven so far, or has put down what it carried."""
        states, driven = await operator.robots(), dict.fromkeys(ROBOTS, 0.0)
        while True:
            following = await operator.robots()
            for name in ROBOTS:
                driven[name] += math.dist((states[name].x, states[name].y), (following[name].x, following[name].y))
            states = following
            robot = max(ROBOTS, key=lambda name: driven[name])
            if driven[robot] >= distance:
                return robot, driven[robot], states
            await asyncio.sleep(0.1)

    async def _stand(self, operator: OperatorLink) -> None:
        """Wait until the robots stand."""
        end, still_looks = time.monotonic() + STANDING_TIME, 0
        states = await operator.robots()
        while still_looks < 10:
            await asyncio.sleep(0.2)
            following = await operator.robots()
            moved = max(math.dist((states[name].x, states[name].y), (following[name].x, following[name].y)) for name in ROBOTS)
            still_looks, states = (still_looks + 1 if moved < 0.005 else 0), following
            if time.monotonic() > end:
                self.problems.append(f"a robot drives on {STANDING_TIME:.0f} s after {self.case.victim} was killed")
                return


def _beside(position: tuple[float, float], start: tuple[float, float], granted: tuple[RoadPoint, ...]) -> float:
    """How far a robot is beside its way, m. `start`: where it was when it was granted."""
    points = [start, *((point[0], point[1]) for point in granted)]
    lines = zip(points, points[1:] or points, strict=False)
    return min((point_distance(position, start_point, end_point) for start_point, end_point in lines), default=math.dist(position, start))


async def _end(client: Client, task: str) -> TaskView:
    view: TaskView | None = None
    async for news in client.news(task):
        view = news.view
    assert view is not None, "an accepted task has news"
    return view


def main() -> int:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    arguments.add_argument("--runs", type=int, default=len(CASES))
    arguments.add_argument("--first", type=int, default=0, help="the first seed; the others follow")
    arguments.add_argument("--out", type=Path, default=Path("out/adapter-runs"))
    options = arguments.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 200)
    shutil.rmtree(options.out, ignore_errors=True)
    options.out.mkdir(parents=True)
    passed = failed = skipped = 0
    for seed in range(options.first, options.first + options.runs):
        case = CASES[seed % len(CASES)]
        adapters = adapters_for(case.kind)
        if adapters is None:
            console.print(f"[yellow]{seed}: {case.kind} does not run here: NOT TESTED[/]")
            skipped += 1
            continue
        run = Run(seed, case, options.out / str(seed))
        with _problems_of(run):
            asyncio.run(run.play(adapters))
        passed, failed = passed + (not run.problems), failed + bool(run.problems)
        verdict = "; ".join(run.problems) or "recovered"
        console.print(f"{seed}: {case.kind}: {run.text}: {verdict}", style="bold red" if run.problems else "", highlight=False)
        if not run.problems:
            shutil.rmtree(options.out / str(seed), ignore_errors=True)
    print(f"{passed} passed, {failed} failed, {skipped} skipped")
    return 1 if failed else 0


@contextlib.contextmanager
def _problems_of(run: Run) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # noqa: BLE001  # whatever ends a run is its problem, and not that of the others
        run.problems.append(f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    sys.exit(main())
