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

EFFORT = 2_000
"""The most steps of PIBT that a search for ways takes, unless said otherwise."""
DETOUR = 200
"""The most steps of PIBT that a search for ways on a detour takes: many brief ones find more than a long one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Traveller:
    """A robot: where it is, where it wants to (None: nowhere), the number of steps for which it has had this goal, and the least distance
    to it at which it has been. Of two robots, the one that has waited longer comes first. A robot that is not `movable` stays."""

    place: int
    goal: int | None = None
    waiting: float = 0.0
    nearest: float = FAR
    movable: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """The configurations of the robots, one step after the other, from where they are.

    `whole`: it is to be followed to its end, because nobody may come nearer to a goal on its first part. `stuck`: robots, by number, that
    cannot come to their goals, as is proved: the others have no room to let them pass.
    """

    steps: list[Configuration]
    whole: bool = False
    stuck: tuple[int, ...] = ()


class WindowPlanner:
    """Plans the next steps of robots on a graph. See `StepPlanner` for `rotations` and `shuffle`."""

    def __init__(self, graph: Graph, shuffle: Callable[[list[int]], None], *, rotations: bool = False) -> None:
        self.graph, self._shuffle = graph, shuffle
        self._planner = StepPlanner(graph, rotations=rotations, shuffle=shuffle)

    def plan(self, robots: Sequence[Traveller], steps: int, effort: int = EFFORT, *, searches: bool = False) -> Course:
        """The next steps of the robots; none if they bring nobody nearer.

        `effort`: the most steps of each search for ways. `searches`: search at once, because going step by step has brought nobody nearer.
        """
        course = self._step_by_step(robots, steps)
        if not searches and self._brings_nearer(course, robots):
            return Course(steps=course)
        places, goals, stuck = course[0], self._reachable(robots), list[int]()
        aims = [goals, *(self._goal_of(number, goals) for number in self._in_line(robots) if goals[number] not in (None, places[number]))]
        staying = _staying(robots)
        for aim in aims:
            try:
                ways = find_ways(self.graph, places, aim, self._planner, effort, staying)
            except SearchLimit:
                continue
            if ways is not None:
                return Course(steps=ways, whole=True)
            if aim is not goals:
                stuck += (number for number, goal in enumerate(aim) if goal is not None)
        ways = self._on_detours(places, [aim for aim in aims if aim is not goals], effort // DETOUR, staying) if not stuck else None
        return Course(steps=ways, whole=True) if ways is not None else Course(steps=course[:1], stuck=tuple(stuck))

    def _on_detours(
        self, places: Configuration, aims: Sequence[Goals], attempts: int, staying: Sequence[tuple[int, int]]
    ) -> list[Configuration] | None:
        """Ways for one of the robots to its goal, after all have gone somewhere else: one may have to go far back to let another pass."""
        fixed = dict(staying)
        for attempt in range(attempts if aims else 0):
            elsewhere = list(range(self.graph.size))
            self._shuffle(elsewhere)
            detour: Goals = [None if robot in fixed else elsewhere[robot] for robot in range(len(places))]
            try:
                if (there := find_ways(self.graph, places, detour, self._planner, DETOUR, staying)) is None:
                    continue
                onwards = find_ways(self.graph, there[-1], aims[attempt % len(aims)], self._planner, DETOUR, staying)
            except SearchLimit:
                continue
            if onwards is not None:
                return [*there, *onwards[1:]]
        return None

    def _goal_of(self, robot: int, goals: Goals) -> Goals:
        """The goal of one robot alone."""
        return [goal if number == robot else None for number, goal in enumerate(goals)]

    def _in_line(self, robots: Sequence[Traveller]) -> list[int]:
        """The robots, the one that has waited longest first."""
        return sorted(range(len(robots)), key=lambda number: -robots[number].waiting)

    def _step_by_step(self, robots: Sequence[Traveller], steps: int) -> list[Configuration]:
        targets = [robot.goal if robot.goal is not None else robot.place for robot in robots]
        estimates = [self.graph.distances(target) for target in targets]
        staying = _staying(robots)
        waiting, course = [robot.waiting for robot in robots], [tuple(robot.place for robot in robots)]
        for _ in range(steps):
            order = sorted(range(len(robots)), key=lambda robot: -waiting[robot])
            following = self._planner.step(course[-1], estimates, order, staying)
            assert following is not None, "all robots can wait"
            course.append(following)
            waiting = [waited + 1 if there != target else 0.0 for waited, there, target in zip(waiting, following, targets, strict=True)]
        return course

    def _brings_nearer(self, course: list[Configuration], robots: Sequence[Traveller]) -> bool:
        """Whether some robot comes nearer to its goal than it has been, or none has a way to go."""
        is_anybody_away = False
        for number, robot in enumerate(robots):
            if robot.goal is None or not robot.movable:
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
        for number in self._in_line(robots):
            robot = robots[number]
            if robot.goal is None or not robot.movable or robot.goal in taken or not taken.isdisjoint(self.graph.exclusions[robot.goal]):
                continue
            if self.graph.distances(robot.goal)[robot.place] < FAR:
                reachable[number] = robot.goal
                taken.add(robot.goal)
        return reachable


def _staying(robots: Sequence[Traveller]) -> list[tuple[int, int]]:
    """The robots that cannot move, with their places."""
    return [(number, robot.place) for number, robot in enumerate(robots) if not robot.movable]
