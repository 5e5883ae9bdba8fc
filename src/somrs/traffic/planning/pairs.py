"""Ways for a robot to its goal past another one, if the two are alone: found among all pairs of their places, or proved not to exist.

Whatever other robots there are, the two can do no more than this.
"""

from __future__ import annotations

from collections.abc import Hashable
from heapq import heappop, heappush

from somrs.traffic.planning.graph import FAR, Graph
from somrs.traffic.planning.lacam import SearchLimit

Pair = tuple[int, int]
"""The places of the robot and of the other one."""


def search_pair(
    graph: Graph, start: Pair, goal: int, robots: tuple[Hashable, Hashable], limit: int, *, fixed: bool = False
) -> list[Pair] | None:
    """The pairs of places from `start` to one with the first robot at its goal, with as few moves of the other one as possible; None if
    there are no ways.

    One robot moves at a time. `robots`: who they are in the graph. `fixed`: the other one cannot move. Raises SearchLimit after `limit`
    pairs.
    """
    distances = graph.distances(goal)
    predecessors: dict[Pair, Pair | None] = {start: None}
    waiting = [(0, distances[start[0]], start)]
    while waiting:
        moves, _, pair = heappop(waiting)
        place, blocker = pair
        if place == goal:
            return _way(predecessors, pair)
        for following in graph.options(place, robots[0]):
            if following != blocker and following not in graph.exclusions[blocker] and distances[following] < FAR:
                _reach(predecessors, waiting, pair, (following, blocker), (moves, distances[following]))
        for following in graph.options(blocker, robots[1]) if not fixed else ():
            if following != place and following not in graph.exclusions[place]:
                _reach(predecessors, waiting, pair, (place, following), (moves + 1, distances[place]))
        if len(predecessors) > limit:
            raise SearchLimit
    return None


def _reach(
    predecessors: dict[Pair, Pair | None],
    waiting: list[tuple[int, float, Pair]],
    pair: Pair,
    following: Pair,
    rank: tuple[int, float],
) -> None:
    if following not in predecessors:
        predecessors[following] = pair
        heappush(waiting, (*rank, following))


def _way(predecessors: dict[Pair, Pair | None], end: Pair) -> list[Pair]:
    way: list[Pair] = []
    pair: Pair | None = end
    while pair is not None:
        way.append(pair)
        pair = predecessors[pair]
    return way[::-1]
