"""The work of planning traffic, for the program around the component: it may take longer than a program may be deaf to messages."""

from __future__ import annotations

from typing import Any, Protocol

from somrs.traffic.berths import with_berths
from somrs.traffic.planning.barriers import Barrier
from somrs.traffic.planning.window import Traveller, WindowPlanner
from somrs.traffic.roadmap import Roadmap, numbered
from somrs.traffic.state import Obstacle, PlanTraffic, TrafficPlan


class Dice(Protocol):
    """Random choices, such as `random.Random` makes."""

    def seed(self, seed: int, /) -> None:
        """Begin a sequence that is the same for the same number."""

    def shuffle(self, items: Any, /) -> None:
        """Bring items into a random order."""


class TrafficPlanner:
    """Plans the traffic on one roadmap. Random choices depend on the problem alone, so that a run can be repeated."""

    def __init__(self, roadmap: Roadmap, dice: Dice) -> None:
        self._graph = numbered(roadmap).graph
        self._dice = dice

    def plan(self, problem: PlanTraffic) -> TrafficPlan:
        numbers = {robot.name: number for number, robot in enumerate(problem.robots)}
        graph = with_berths(self._graph, problem.closed, problem.private, numbers)
        planner = WindowPlanner(graph, self._dice.shuffle, blocked=problem.blocked)
        self._dice.seed(problem.serial)
        travellers = [
            Traveller(
                place=robot.place,
                goal=robot.goal,
                waiting=robot.waiting,
                nearest=robot.nearest,
                movable=robot.movable,
                busy=robot.busy,
                begins=robot.begins,
                held_up=robot.held_up,
                stalled=robot.stalled,
            )
            for robot in problem.robots
        ]
        course = planner.plan(travellers, problem.steps, problem.effort, searches=problem.searches)
        ways = {robot.name: tuple(places[number] for places in course.steps) for number, robot in enumerate(problem.robots)}
        stuck = {problem.robots[number].name: _obstacle(problem, number, barrier) for number, barrier in course.stuck.items()}
        return TrafficPlan(ways=ways, whole=course.whole, stuck=stuck)


def _obstacle(problem: PlanTraffic, number: int, barrier: Barrier) -> Obstacle:
    robots = problem.robots
    return Obstacle(goal=robots[number].goal, robots=tuple(robots[blocker].name for blocker in barrier.robots), places=barrier.places)
