"""The next steps of all robots together. The plan is made anew, again and again, as long as there are goals (lifelong planning).

Robots without a goal take part, too: they stay as long as nobody wants to get past them, and make room otherwise. PIBT plans one step
after the other; where it brings nobody nearer to a goal, a search (LaCAM) looks for ways further ahead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from somrs.traffic.planning.graph import FAR, Graph
from somrs.traffic.planning.lacam import SearchLimit, find_ways
from somrs.traffic.planning.pibt import Configuration, Goals, StepPlanner

SEARCH_STEPS = 20_000
"""The most steps of PIBT that a search for ways takes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Traveller:
    """A robot: where it is, where it wants to (None: nowhere), the number of steps for which it has had this goal, and the least distance
    to it at which it has been. Of two robots, the one that has waited longer comes first."""

    place: int
    goal: int | None = None
    waiting: float = 0.0
    nearest: float = FAR


class WindowPlanner:
    """Plans the next steps of robots on a graph. See `StepPlanner` for `rotations` and `shuffle`."""

    def __init__(self, graph: Graph, *, rotations: bool = False, shuffle: Callable[[list[int]], None] | None = None) -> None:
        self.graph = graph
        self._planner = StepPlanner(graph, rotations=rotations, shuffle=shuffle)

    def plan(self, robots: Sequence[Traveller], steps: int) -> list[Configuration]:
        """The configurations from the robots' places on, so many steps ahead; or, if ways to the goals had to be searched for, all of them.

        Such ways are to be followed to their end: nobody may come nearer to a goal on their first part. Robots without a way stand still.
        """
        course = self._step_by_step(robots, steps)
        if self._brings_nearer(course, robots):
            return course
        try:
            ways = find_ways(self.graph, course[0], self._reachable(robots), self._planner, SEARCH_STEPS)
        except SearchLimit:
            ways = None
        return ways if ways is not None else course

    def _step_by_step(self, robots: Sequence[Traveller], steps: int) -> list[Configuration]:
        targets = [robot.goal if robot.goal is not None else robot.place for robot in robots]
        estimates = [self.graph.distances(target) for target in targets]
        waiting, course = [robot.waiting for robot in robots], [tuple(robot.place for robot in robots)]
        for _ in range(steps):
            order = sorted(range(len(robots)), key=lambda robot: -waiting[robot])
            following = self._planner.step(course[-1], estimates, order)
            assert following is not None, "all robots can wait"
            course.append(following)
            waiting = [waited + 1 if there != target else 0.0 for waited, there, target in zip(waiting, following, targets, strict=True)]
        return course

    def _brings_nearer(self, course: list[Configuration], robots: Sequence[Traveller]) -> bool:
        """Whether some robot comes nearer to its goal than it has been, or none has a way to go."""
        is_anybody_away = False
        for number, robot in enumerate(robots):
            if robot.goal is None:
                continue
            distances = self.graph.distances(robot.goal)
            if 0 < distances[robot.place] < FAR:
                is_anybody_away = True
                if min(distances[configuration[number]] for configuration in course) < min(robot.nearest, distances[robot.place]):
                    return True
        return not is_anybody_away

    def _reachable(self, robots: Sequence[Traveller]) -> Goals:
        """The goals that robots can be at together: of those that exclude each other, the first in line keeps its own."""
        reachable: list[int | None] = [None] * len(robots)
        taken: set[int] = set()
        for number in sorted(range(len(robots)), key=lambda number: -robots[number].waiting):
            robot = robots[number]
            if robot.goal is None or robot.goal in taken or not taken.isdisjoint(self.graph.exclusions[robot.goal]):
                continue
            if self.graph.distances(robot.goal)[robot.place] < FAR:
                reachable[number] = robot.goal
                taken.add(robot.goal)
        return reachable
