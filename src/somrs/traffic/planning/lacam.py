"""Ways for all robots to their goals, by lazy constraints addition search (LaCAM; Okumura 2023).

A depth-first search among the configurations of all robots. The next configuration comes from one step of PIBT; when the search returns to
a configuration, the step is made under one more constraint (a robot, and its next place), until all have been tried. It therefore finds
ways wherever there are any, and mostly at once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from somrs.traffic.planning.graph import Graph
from somrs.traffic.planning.pibt import Configuration, Goals, StepPlanner

Constraints = tuple[tuple[int, int], ...]
"""Robots with the places that they go to next."""


class SearchLimit(Exception):
    """The search gave up. There may or may not be ways."""


@dataclass(slots=True, eq=False)
class _Node:
    """A configuration, with the constraints that are to be tried from it."""

    configuration: Configuration
    parent: _Node | None
    order: Sequence[int]
    """The robots, those that are to be constrained first at the front."""
    waiting: Sequence[float]
    """By robot: the number of steps for which it has not been at its goal, and less than one before."""
    untried: deque[Constraints]


def find_ways(
    graph: Graph,
    start: Configuration,
    goals: Goals,
    planner: StepPlanner,
    most_steps: int = 100_000,
    staying: Sequence[tuple[int, int]] = (),
) -> list[Configuration] | None:
    """The configurations from `start` to one with all robots at their goals, both included; None if there are no ways.

    `staying`: robots that cannot move, with their places. Raises SearchLimit after so many steps of PIBT.
    """
    anywhere = [1.0] * graph.size
    estimates = [graph.distances(goal) if goal is not None else anywhere for goal in goals]
    robots = range(len(start))
    movable = [robot for robot in robots if robot not in dict(staying)]
    bound = [robot for robot, goal in enumerate(goals) if goal is not None]

    def node(configuration: Configuration, parent: _Node | None) -> _Node:
        if parent is None:
            farthest = max((estimates[robot][start[robot]] for robot in robots), default=0.0) or 1.0
            waiting = [min(estimates[robot][start[robot]] / (farthest + 1), 0.99) for robot in robots]
        else:
            waiting = [parent.waiting[robot] + 1 if configuration[robot] != goals[robot] else parent.waiting[robot] % 1 for robot in robots]
        order = sorted(movable, key=lambda robot: -waiting[robot])
        return _Node(configuration, parent, order, waiting, deque([()]))

    first = node(start, None)
    known = {start: first}
    path = [first]
    steps = 0
    while path:
        here = path[-1]
        if all(here.configuration[robot] == goals[robot] for robot in bound):
            return _way(here)
        if not here.untried:
            path.pop()
            continue
        constraints = here.untried.popleft()
        if len(constraints) < len(movable):
            robot = here.order[len(constraints)]
            place = here.configuration[robot]
            here.untried.extend((*constraints, (robot, target)) for target in (*graph.options(place, robot), place))
        steps += 1
        if steps > most_steps:
            raise SearchLimit
        following = planner.step(here.configuration, estimates, here.order, (*staying, *constraints))
        if following is None:
            continue
        existing = known.get(following)
        if existing is None:
            existing = known[following] = node(following, here)
        path.append(existing)
    return None


def _way(node: _Node | None) -> list[Configuration]:
    way: list[Configuration] = []
    while node is not None:
        way.append(node.configuration)
        node = node.parent
    return way[::-1]
