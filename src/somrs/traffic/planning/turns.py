"""Who waits outside a corridor because it is the turn of others: that is no reason to search for another way."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from typing import Protocol

from somrs.traffic.planning.corridors import NOWHERE
from somrs.traffic.planning.graph import Graph

FAR_AHEAD = 10
"""The number of places ahead of a robot at which a corridor is one for which it waits."""

Estimate = Sequence[float]
"""By place: how far it is to a robot's goal."""


class Traveller(Protocol):
    """A robot that may be under way; see `window.Traveller`."""

    @property
    def place(self) -> int: ...

    @property
    def goal(self) -> int | None: ...

    @property
    def movable(self) -> bool: ...

    @property
    def held_up(self) -> bool: ...


def waits_its_turn(graph: Graph, number: int, robots: Sequence[Traveller], estimates: Mapping[int, Estimate]) -> bool:
    """Whether others come through the next corridor on the way of a robot, towards it, and get on."""
    robot, estimate, corridors = robots[number], estimates[number], graph.corridors
    if robot.goal is None:
        return False
    way = (robot.place, *islice(graph.way(robot.place, robot.goal, number), FAR_AHEAD))
    corridor = next((corridors[place] for place in way if corridors[place] != NOWHERE), NOWHERE)
    return corridor != NOWHERE and any(
        oncoming != number and corridors[place] == corridor and estimate[following] > estimate[place]
        for oncoming, place, following in _steps(graph, robots)
    )


def _steps(graph: Graph, robots: Sequence[Traveller]) -> Iterable[tuple[int, int, int]]:
    """The robots that get on, with their places and the next ones on their ways."""
    for number, robot in enumerate(robots):
        if robot.movable and robot.goal not in (None, robot.place) and not robot.held_up:
            following = next(iter(graph.way(robot.place, robot.goal, number)), None)
            if following is not None:
                yield number, robot.place, following
