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
LAST_RESORT = 1e9
"""What a move of the other one counts beside the way that is left, in seconds, so that it is made only where there is no other way."""


def search_pair(
    graph: Graph,
    start: Pair,
    goal: int,
    robots: tuple[Hashable, Hashable],
    limit: int,
    *,
    fixed: bool = False,
    fewest_moves: bool = True,
) -> list[Pair] | None:
    """The pairs of places from `start` to one with the first robot at its goal; None if there are no ways.

    One robot moves at a time. `robots`: who they are in the graph. `fixed`: the other one cannot move. `fewest_moves`: the other one moves
    as little as possible; without, any ways are found, and much sooner where there are many places. Raises SearchLimit after `limit` pairs.
    """
    distances, weight = graph.distances(goal), LAST_RESORT if fewest_moves else 1.0
    predecessors: dict[Pair, Pair | None] = {start: None}
    waiting: list[tuple[float, int, Pair]] = [(0.0, 0, start)]
    while waiting:
        _, moves, pair = heappop(waiting)
        place, blocker = pair
        if place == goal:
            return _way(predecessors, pair)
        for following in graph.options(place, robots[0]):
            if following != blocker and following not in graph.exclusions[blocker] and distances[following] < FAR:
                _reach(predecessors, waiting, pair, (following, blocker), moves, distances[following] + weight * moves)
        for following in graph.options(blocker, robots[1]) if not fixed else ():
            if following != place and following not in graph.exclusions[place]:
                _reach(predecessors, waiting, pair, (place, following), moves + 1, distances[place] + weight * (moves + 1))
        if len(predecessors) > limit:
            raise SearchLimit
    return None


def _reach(
    predecessors: dict[Pair, Pair | None],
    waiting: list[tuple[float, int, Pair]],
    pair: Pair,
    following: Pair,
    moves: int,
    cost: float,
) -> None:
    if following not in predecessors:
        predecessors[following] = pair
        heappush(waiting, (cost, moves, following))


def _way(predecessors: dict[Pair, Pair | None], end: Pair) -> list[Pair]:
    way: list[Pair] = []
    pair: Pair | None = end
    while pair is not None:
        way.append(pair)
        pair = predecessors[pair]
    return way[::-1]
