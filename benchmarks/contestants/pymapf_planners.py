"""pymapf (https://github.com/openplan-labs/pymapf): its PIBT, one step at a time, and its LaCAM, whose plan is followed for a while."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random

import pymapf
from pymapf.algorithms.pibt import pibt_step

from contestants.grids import Grid

Cell = tuple[int, int]
WINDOW = 10
"""The number of steps for which a plan of LaCAM is followed."""
SEARCH_TIME = 5.0
"""The time limit of LaCAM, in seconds."""


def pibt(grid: Grid) -> Callable[[tuple[int, ...], Sequence[int], Sequence[float]], tuple[int, ...]]:
    field, dice = _field(grid), Random(0)
    number = {cell: place for place, cell in enumerate(grid.cells)}
    names = [str(robot) for robot in range(len(grid.starts))]

    def plan(places: tuple[int, ...], goals: Sequence[int], waiting: Sequence[float]) -> tuple[int, ...]:
        positions = {name: grid.cells[place] for name, place in zip(names, places, strict=True)}
        aims = {name: grid.cells[goal] for name, goal in zip(names, goals, strict=True)}
        priorities = {name: waiting[robot] + robot / (len(names) + 1) for robot, name in enumerate(names)}
        tables = {name: grid.graph.distances(goal) for name, goal in zip(names, goals, strict=True)}

        def distance(name: str, cell: Cell) -> float:
            return tables[name][number[cell]]

        following = pibt_step(field, names, positions, aims, priorities, distance, rng=dice)
        return tuple(number[following[name]] for name in names) if following is not None else places

    return plan


def lacam(grid: Grid) -> Callable[[tuple[int, ...], Sequence[int], Sequence[float]], tuple[int, ...]]:
    field = _field(grid)
    number = {cell: place for place, cell in enumerate(grid.cells)}
    names = [str(robot) for robot in range(len(grid.starts))]
    ways: list[tuple[int, ...]] = []

    def plan(places: tuple[int, ...], goals: Sequence[int], _: Sequence[float]) -> tuple[int, ...]:
        if len(ways) < 2 or ways[0] != places:
            ways[:] = _solve(field, grid, names, number, places, goals)[: WINDOW + 1]
        del ways[0]
        return ways[0] if ways else places

    return plan


def _solve(
    field: pymapf.GridMap, grid: Grid, names: list[str], number: dict[Cell, int], places: tuple[int, ...], goals: Sequence[int]
) -> list[tuple[int, ...]]:
    """The configurations on the way to the goals. Of robots that have the same goal, the first one has it; the others go to where they are,
    or to a cell that is free, because LaCAM wants each robot to have a goal of its own."""
    taken: dict[int, int] = {}
    for robot, goal in enumerate(goals):
        taken.setdefault(goal, robot)
    free = iter(place for place in range(grid.graph.size) if place not in taken and place not in places)
    agents = []
    for robot, name in enumerate(names):
        aim = goals[robot] if taken[goals[robot]] == robot else places[robot]
        if aim != goals[robot] and taken.setdefault(aim, robot) != robot:
            aim = next(free)
        agents.append(pymapf.Agent(name, grid.cells[places[robot]], grid.cells[aim]))
    solution = pymapf.get_solver("lacam", time_limit=SEARCH_TIME).solve(pymapf.MAPFProblem(field, agents))
    if solution is None:
        return [places]
    length = max(len(path) for path in solution.paths.values())
    return [tuple(number[solution.paths[name][min(step, len(solution.paths[name]) - 1)]] for name in names) for step in range(length)]


def _field(grid: Grid) -> pymapf.GridMap:
    free = set(grid.cells)
    return pymapf.GridMap([[0 if (row, column) in free else 1 for column in range(grid.columns)] for row in range(grid.rows)])
