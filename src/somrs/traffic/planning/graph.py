"""The places and lanes of a roadmap as a graph for the planner: places are numbered, and only their neighbours and distances count."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from functools import cached_property
from heapq import heappop, heappush

FAR = float("inf")
"""The distance of a place from which a goal cannot be reached."""


class Graph:
    """Places, numbered from 0, the lanes between them, and the places that exclude each other.

    `lanes` are (from, to, length): a robot takes `length` seconds, or as many steps. `conflicts` are pairs of places at which two robots
    would touch each other. A robot can wait at any place.
    """

    def __init__(self, size: int, lanes: Iterable[tuple[int, int, float]], conflicts: Iterable[tuple[int, int]] = ()) -> None:
        self.size = size
        self.lengths: list[dict[int, float]] = [{} for _ in range(size)]
        for start, end, length in lanes:
            self.lengths[start][end] = min(length, self.lengths[start].get(end, FAR))
        self.successors: list[tuple[int, ...]] = [tuple(ends) for ends in self.lengths]
        exclusions: list[dict[int, None]] = [{} for _ in range(size)]
        for first, second in conflicts:
            if first != second:
                exclusions[first][second] = exclusions[second][first] = None
        self.exclusions: list[tuple[int, ...]] = [tuple(others) for others in exclusions]
        """By place: the others that no robot may be at while one is at this place."""
        self._distances: dict[int, Sequence[float]] = {}

    def without(self, places: Iterable[int]) -> Graph:
        """This graph without the lanes to these places, and to those that they exclude."""
        closed = {other for place in places for other in (place, *self.exclusions[place])}
        lanes = ((start, end, length) for start, ends in enumerate(self.lengths) for end, length in ends.items() if end not in closed)
        return Graph(self.size, lanes, ((place, other) for place, others in enumerate(self.exclusions) for other in others))

    @cached_property
    def predecessors(self) -> list[tuple[int, ...]]:
        """By place: the places from which a lane leads to it."""
        starts: list[list[int]] = [[] for _ in range(self.size)]
        for start, ends in enumerate(self.successors):
            for end in ends:
                starts[end].append(start)
        return [tuple(places) for places in starts]

    def distances(self, goal: int) -> Sequence[float]:
        """By place: the length of the shortest way to the goal; `FAR` if there is none (Dijkstra, backwards, once for each goal)."""
        if (known := self._distances.get(goal)) is not None:
            return known
        distances = array("d", [FAR]) * self.size
        distances[goal] = 0.0
        waiting = [(0.0, goal)]
        while waiting:
            distance, place = heappop(waiting)
            if distance > distances[place]:
                continue
            for start in self.predecessors[place]:
                longer = distance + self.lengths[start][place]
                if longer < distances[start]:
                    distances[start] = longer
                    heappush(waiting, (longer, start))
        return self._distances.setdefault(goal, distances)
