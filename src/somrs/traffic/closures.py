"""Ways that are closed: robots that cannot move stand in them."""

from __future__ import annotations

from collections.abc import Iterator

from somrs.traffic.planning.graph import FAR, Graph
from somrs.traffic.schedule import Schedule
from somrs.traffic.state import TrafficState, Trip


class Closures:
    """Which places nobody can get past for now, and which trips that ends."""

    def __init__(self, state: TrafficState, schedule: Schedule) -> None:
        self._state, self._schedule = state, schedule
        self._open: tuple[frozenset[int], Graph, Graph] | None = None
        """The closed places, the graph, and the graph without the lanes to them."""
        self._passable: dict[str, tuple[str, int, Graph, frozenset[int]]] = {}
        """By robot: its trip, from where there was a way when it was looked for last, on which public graph, and what was closed then."""

    @property
    def places(self) -> frozenset[int]:
        """The places that are held by robots that cannot move."""
        fixed = (name for name, robot in self._state.robots.items() if robot.is_fixed)
        return frozenset(place for name in fixed for place in self._schedule.held(name))

    @property
    def open_graph(self) -> Graph:
        """The graph without the lanes to where robots that cannot move are in the way."""
        return self._open_graph(closed) if (closed := self.places) else self._schedule.graph

    def blockers(self, name: str, trip: Trip, closed: frozenset[int]) -> tuple[str, ...] | None:
        """The robots that cannot move and stand in the shortest way, if all ways are closed; None if there is a way.

        There are no such robots if the ways are closed by what stands there. `closed`: the `places`.
        """
        start = self._schedule.last(name)
        circumstances = trip.id, start, self._schedule.graph.public, closed
        if self._passable.get(name) == circumstances:
            return None  # the berths of others are in nobody's way
        if self._schedule.graph.distance(start, trip.destination) == FAR:
            return ()
        if not closed or self._open_graph(closed).distance(start, trip.destination) < FAR:
            self._passable[name] = circumstances
            return None
        return tuple(dict.fromkeys(self._in_the_way(name, start, trip.destination, closed))) or None

    def _open_graph(self, closed: frozenset[int]) -> Graph:
        graph = self._schedule.graph
        if self._open is None or self._open[:2] != (closed, graph):
            self._open = closed, graph, graph.without(closed)
        return self._open[2]

    def _in_the_way(self, name: str, start: int, destination: int, closed: frozenset[int]) -> Iterator[str]:
        graph = self._schedule.graph
        for place in graph.way(start, destination, name):
            holder = self._schedule.holder(place, besides=name)
            if holder is not None and not closed.isdisjoint((place, *graph.exclusions[place])):
                yield holder
