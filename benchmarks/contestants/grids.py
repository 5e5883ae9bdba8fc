"""The grids of the League of Robot Runners: https://github.com/MAPF-Competition/Start-Kit."""

from __future__ import annotations

from pathlib import Path
from random import Random

from msgspec import Struct, json

from somrs.traffic.planning.graph import Graph

WALLS = "@T"


class Delays(Struct, rename="camel"):
    """How often robots are delayed, and for how many steps (`delayConfig`). Delays begin independently of each other, also where the file
    has them as a Poisson process of the same mean rate."""

    seed: int
    min_delay: int
    max_delay: int
    p_delay: float
    duration_model: str
    gauss_mean_ratio: float = 0.5
    gauss_std_ratio: float = 0.22

    def of(self, robots: int, steps: int) -> list[frozenset[int]]:
        """By step: the robots that cannot move. A robot that can begins a delay with the probability `p_delay` in each step."""
        dice, ends = Random(self.seed), [0] * robots
        delayed: list[frozenset[int]] = []
        for step in range(steps):
            for robot in range(robots):
                if ends[robot] <= step and dice.random() < self.p_delay:
                    ends[robot] = step + self._duration(dice)
            delayed.append(frozenset(robot for robot in range(robots) if ends[robot] > step))
        return delayed

    def _duration(self, dice: Random) -> int:
        if self.duration_model == "uniform":
            return dice.randint(self.min_delay, self.max_delay)
        span = self.max_delay - self.min_delay
        drawn = round(dice.gauss(self.min_delay + self.gauss_mean_ratio * span, self.gauss_std_ratio * span))
        return min(max(drawn, self.min_delay), self.max_delay)


class Problem(Struct, rename="camel"):
    """The file of a problem. The paths are relative to it."""

    map_file: str
    agent_file: str
    task_file: str
    team_size: int
    delay_config: Delays


class Grid(Struct):
    """The free cells of a grid, numbered, with the robots and their tasks: the places where a robot has to be, in their order."""

    graph: Graph
    cells: list[tuple[int, int]]
    starts: list[int]
    tasks: list[list[int]]
    delays: Delays
    rows: int
    columns: int


def read_grid(file: Path) -> Grid:
    problem = json.decode(file.read_bytes(), type=Problem)
    rows = [line for line in (file.parent / problem.map_file).read_text().splitlines()[4:] if line]
    cells = [(row, column) for row, line in enumerate(rows) for column, sign in enumerate(line) if sign not in WALLS]
    number = {cell: index for index, cell in enumerate(cells)}
    lanes = [
        (place, number[other], 1.0)
        for (row, column), place in number.items()
        for other in ((row, column + 1), (row + 1, column), (row, column - 1), (row - 1, column))
        if other in number
    ]
    columns = len(rows[0])

    def place(written: str) -> int:
        return number[divmod(int(written), columns)]

    starts = [place(line) for line in _lines(file.parent / problem.agent_file)[: problem.team_size]]
    tasks = [[place(part) for part in line.split(",")] for line in _lines(file.parent / problem.task_file)]
    return Grid(Graph(len(cells), lanes), cells, starts, tasks, problem.delay_config, len(rows), columns)


def _lines(file: Path) -> list[str]:
    """The lines after the first, which gives their number."""
    return [line for line in file.read_text().splitlines() if line and not line.startswith("#")][1:]
