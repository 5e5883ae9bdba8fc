"""Ways for few robots, by a search among all configurations, breadth first: it proves that there are none where there are none."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Sequence

from somrs.traffic.planning.graph import Graph
from somrs.traffic.planning.lacam import SearchLimit
from somrs.traffic.planning.pibt import Configuration, Goals


def search_all(
    graph: Graph, start: Configuration, goals: Goals, most: int, staying: Collection[int] = (), numbers: Sequence[int] | None = None
) -> list[Configuration] | None:
    """The configurations from `start` to one with all robots at their goals, in the fewest moves; None if there are no ways.

    One robot moves at a time: as no robots may move in a circle, whatever they can do at once, they can do one after the other. `staying`:
    robots that cannot move. `numbers`: those of the robots in the graph, if these are only some of them. Raises SearchLimit after `most`
    configurations.
    """
    numbers = numbers if numbers is not None else range(len(start))
    bound = [(robot, goal) for robot, goal in enumerate(goals) if goal is not None]
    predecessors: dict[Configuration, Configuration | None] = {start: None}
    waiting = deque([start])
    while waiting:
        configuration: Configuration | None = waiting.popleft()
        assert configuration is not None
        if all(configuration[robot] == goal for robot, goal in bound):
            way: list[Configuration] = []
            while configuration is not None:
                way.append(configuration)
                configuration = predecessors[configuration]
            return way[::-1]
        for following in _moves(graph, configuration, staying, numbers):
            if following not in predecessors:
                predecessors[following] = configuration
                waiting.append(following)
        if len(predecessors) > most:
            raise SearchLimit
    return None


def _moves(graph: Graph, configuration: Configuration, staying: Collection[int], numbers: Sequence[int]) -> Iterator[Configuration]:
    occupied = set(configuration)
    for robot, place in enumerate(configuration):
        if robot in staying:
            continue
        occupied.remove(place)
        for following in graph.options(place, numbers[robot]):
            if following not in occupied and occupied.isdisjoint(graph.exclusions[following]):
                yield (*configuration[:robot], following, *configuration[robot + 1 :])
        occupied.add(place)
