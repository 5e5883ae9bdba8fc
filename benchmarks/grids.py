"""Measures the planner of steps on grids, beside those of pymapf: `python benchmarks/grids.py [FOLDER]`.

The folder has the grids of the League of Robot Runners (`NAME.domain/*.json`; its format is in its `Input_Output_Format.md`). Robots move
on four neighbours, one cell a step, and are delayed as the file says. Each robot gets the next task as soon as it has done one, from the
same list for all planners. A task is done when the robot has been at all its places, in their order. A planner that needs more time than
robots have for a step does not keep up, and is not run to the end.
"""

from __future__ import annotations

import importlib.util
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from random import Random

from contestants.grids import Grid, read_grid

from somrs.traffic.planning.pibt import Configuration, StepPlanner

STEPS = 1_000
STEP, TRIAL = 1.0, 50
"""The seconds that a robot has for a step. A planner is stopped that needs more for all its steps, but not before it has had the time of so
many steps."""
FOLDER = Path("../shared/benchmarks/mapf")

Planner = Callable[[Configuration, Sequence[int], Sequence[float]], Configuration]
"""The next places of all robots, from their places, their goals, and the number of steps for which each has had its goal."""


def main() -> int:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    if not folder.is_dir():
        print(f"NOT MEASURED: there is no folder {folder}; name the one with the grids: python benchmarks/grids.py FOLDER")
        return 0
    for file in sorted(folder.glob("*.domain/*.json")):
        grid = read_grid(file)
        print(f"{file.stem}: {grid.graph.size} cells, {len(grid.starts)} robots")
        print(f"  {'':34} {'tasks':>6} {'share':>6} {'ms a step':>10} {'worst':>7}")
        bound = lone_robots(grid)
        for name, planner in contestants(grid):
            done, seconds = run(grid, planner)
            milliseconds = [1_000 * second for second in seconds]
            mean, worst = statistics.mean(milliseconds), max(milliseconds)
            if len(seconds) < STEPS:
                print(f"  {name:34} {'too slow':>13} {mean:10.1f} {worst:7.0f}, stopped after {len(seconds)} steps", flush=True)
                continue
            print(f"  {name:34} {done:6} {done / bound:6.0%} {mean:10.1f} {worst:7.0f}", flush=True)
        print(f"  {'lone robots':34} {bound:6} {1:6.0%}")
    return 0


def contestants(grid: Grid) -> Iterator[tuple[str, Planner]]:
    yield "SO-MRS", step_planner(grid)
    if importlib.util.find_spec("pymapf") is None:
        print("  NOT MEASURED: pymapf is not installed; pip install -e '.[rivals]'")
        return
    from contestants import pymapf_planners

    yield "pymapf, PIBT", pymapf_planners.pibt(grid)
    yield f"pymapf, LaCAM every {pymapf_planners.WINDOW} steps", pymapf_planners.lacam(grid)


def step_planner(grid: Grid) -> Planner:
    planner = StepPlanner(grid.graph, rotations=True, shuffle=Random(0).shuffle)
    offsets = [robot / len(grid.starts) for robot in range(len(grid.starts))]

    def plan(places: Configuration, goals: Sequence[int], waiting: Sequence[float]) -> Configuration:
        order = sorted(range(len(places)), key=lambda robot: -waiting[robot] - offsets[robot])
        following = planner.step(places, [grid.graph.distances(goal) for goal in goals], order)
        assert following is not None
        return following

    return plan


def run(grid: Grid, planner: Planner) -> tuple[int, list[float]]:
    """The number of tasks that are done in `STEPS` steps, and the planner's seconds for each step: fewer, if it does not keep up."""
    places, tasks = tuple(grid.starts), Tasks(grid)
    delays = grid.delays.of(len(places), STEPS)
    seconds: list[float] = []
    for step in range(STEPS):
        started_at = time.process_time()
        following = planner(places, tasks.goals, tasks.waiting)
        seconds.append(time.process_time() - started_at)
        places = execute(grid, places, following, delays[step])
        tasks.proceed(places)
        if sum(seconds) > STEP * max(len(seconds), TRIAL):
            break
    return tasks.done, seconds


def lone_robots(grid: Grid) -> int:
    """The number of tasks that robots would do that are delayed, but are in nobody's way, each on its shortest way."""
    places, tasks, graph = list(grid.starts), Tasks(grid), grid.graph
    for delayed in grid.delays.of(len(places), STEPS):
        for robot, goal in enumerate(tasks.goals):
            if robot not in delayed and places[robot] != goal:
                distances = graph.distances(goal)
                places[robot] = min(graph.successors[places[robot]], key=distances.__getitem__)
        tasks.proceed(places)
    return tasks.done


class Tasks:
    """What robots have to do: the places of a task, one after the other, and then the next task of the list."""

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._next = 0
        self._left = [self._take() for _ in grid.starts]
        self.waiting = [0.0] * len(grid.starts)
        self.done = 0
        self.proceed(grid.starts)

    def _take(self) -> list[int]:
        task = self._grid.tasks[self._next % len(self._grid.tasks)]
        self._next += 1
        return list(task)

    @property
    def goals(self) -> list[int]:
        return [places[0] for places in self._left]

    def proceed(self, places: Sequence[int]) -> None:
        """The robots are at these places now."""
        for robot, place in enumerate(places):
            self.waiting[robot] += 1
            while self._left[robot][0] == place:
                self.waiting[robot] = 0.0
                del self._left[robot][0]
                if not self._left[robot]:
                    self.done += 1
                    self._left[robot] = self._take()


def execute(grid: Grid, places: Configuration, following: Configuration, delayed: frozenset[int]) -> Configuration:
    """The places after the step: delayed robots stay, and so do those that would come to where another stays."""
    assert len(set(following)) == len(following), "two robots in one place"
    now = {place: robot for robot, place in enumerate(places)}
    for robot, (here, there) in enumerate(zip(places, following, strict=True)):
        assert here == there or there in grid.graph.successors[here], "a robot jumps"
        other = now.get(there)
        assert other is None or other == robot or following[other] != here, "two robots change places"
    staying = [robot for robot in range(len(places)) if robot in delayed or places[robot] == following[robot]]
    stays = set(staying)
    coming = {place: robot for robot, place in enumerate(following) if place != places[robot]}
    while staying:
        behind = coming.get(places[staying.pop()])
        if behind is not None and behind not in stays:
            stays.add(behind)
            staying.append(behind)
    return tuple(here if robot in stays else there for robot, (here, there) in enumerate(zip(places, following, strict=True)))


if __name__ == "__main__":
    sys.exit(main())
