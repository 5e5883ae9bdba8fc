"""Who stands in the way of a robot, and whether that can let it pass."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from somrs.traffic.planning import turns
from somrs.traffic.planning.exhaustive import search_all
from somrs.traffic.planning.graph import Graph
from somrs.traffic.planning.lacam import SearchLimit
from somrs.traffic.planning.pairs import Pair, search_pair
from somrs.traffic.planning.pibt import Configuration

MOST_PAIRS = 300_000
"""The pairs of places that are looked at until it is left open whether two robots can pass each other. Where they can, few are needed: one
of them goes a little way. Where they cannot, one of them is shut in."""


class Traveller(turns.Traveller, Protocol):
    """A robot; see `window.Traveller`."""

    @property
    def busy(self) -> bool: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Barrier:
    """What keeps a robot from its goal. `robots`: those that stand in its way and have no room to let it pass, by number; `places`: those
    held by robots that cannot move, if there would be room without them."""

    robots: tuple[int, ...]
    places: tuple[int, ...] = ()


class Barriers:
    """Looks at each robot with those that stand in its way. `blocked`: the places held by robots that cannot move; `graph`: without the
    lanes to these; `whole_graph`: with them."""

    def __init__(self, whole_graph: Graph, graph: Graph, blocked: Collection[int], robots: Sequence[Traveller]) -> None:
        self._whole_graph, self._graph, self._blocked, self._robots = whole_graph, graph, blocked, robots

    def shut_off(self, number: int) -> Barrier | None:
        """What keeps a robot from its goal even if it were alone with one that stands in its way; None if there is no such thing, or it is
        not known."""
        for blocker in self._standing(number):
            if self._is_barred(number, blocker, fixed=self._is_fixed(blocker)):
                return Barrier(robots=(blocker,), places=self._blocked_on(lambda: self._search(self._whole_graph, number, blocker)))  # noqa: B023
        return None

    def by_all(self, number: int, limit: int) -> Barrier:
        """What keeps a robot from its goal for which all others together have no room, as is known."""
        movers = [mover for mover in range(len(self._robots)) if mover == number or not self._is_fixed(mover)]
        start = tuple(self._robots[mover].place for mover in movers)
        goals = [self._robots[mover].goal if mover == number else None for mover in movers]
        places = self._blocked_on(lambda: search_all(self._whole_graph, start, goals, limit, (), movers))
        return Barrier(robots=tuple(self._in_the_way(number)), places=places)

    def waits_for_work(self, number: int) -> bool:
        """Whether one that works stands in the only way of a robot, so that there is nothing to do until it comes free."""
        standing = (blocker for blocker in self._standing(number) if self._robots[blocker].busy)
        return any(self._is_barred(number, blocker, fixed=True) for blocker in standing)

    def ways_past(self, number: int) -> list[Configuration] | None:
        """Ways for a robot past the first one that stands in its way, which goes out of it, while the others stay; None if there are
        none, or they are not known."""
        robots = self._robots
        for blocker in self._standing(number):
            if not robots[blocker].movable:
                return None
            obstacles = [robot.place for bystander, robot in enumerate(robots) if bystander not in (number, blocker)]
            pairs = self._pairs(self._graph.without(obstacles), number, blocker)
            return [self._configuration(number, blocker, pair) for pair in pairs] if pairs is not None else None
        return None

    def _configuration(self, number: int, blocker: int, pair: Pair) -> Configuration:
        places = {number: pair[0], blocker: pair[1]}
        return tuple(places.get(mover, robot.place) for mover, robot in enumerate(self._robots))

    def _is_barred(self, number: int, blocker: int, *, fixed: bool) -> bool:
        try:
            return self._search(self._graph, number, blocker, fixed=fixed, fewest_moves=False) is None
        except SearchLimit:
            return False

    def _pairs(self, graph: Graph, number: int, blocker: int) -> list[Pair] | None:
        try:
            return self._search(graph, number, blocker)
        except SearchLimit:
            return None

    def _search(self, graph: Graph, number: int, blocker: int, *, fixed: bool = False, fewest_moves: bool = True) -> list[Pair] | None:
        robot = self._robots[number]
        assert robot.goal is not None, "it is on its way"
        start, movers = (robot.place, self._robots[blocker].place), (number, blocker)
        return search_pair(graph, start, robot.goal, movers, MOST_PAIRS, fixed=fixed, fewest_moves=fewest_moves)

    def _blocked_on(self, search: Callable[[], Sequence[Configuration] | None]) -> tuple[int, ...]:
        """The blocked places on the ways that there would be without those that cannot move; all of them if it is not known."""
        if not self._blocked:
            return ()
        try:
            ways = search()
        except SearchLimit:
            return tuple(self._blocked)
        driven = {taken_place for places in ways or () for place in places for taken_place in self._taken(place)}
        return tuple(place for place in self._blocked if place in driven)

    def _standing(self, number: int) -> Iterator[int]:
        """Those in the way of a robot that do not get on."""
        for blocker in self._in_the_way(number):
            robot = self._robots[blocker]
            if robot.goal in (None, robot.place) or robot.held_up or not robot.movable:
                yield blocker

    def _in_the_way(self, number: int) -> Iterable[int]:
        """The robots on the shortest way of a robot to its goal, the nearest first."""
        robot = self._robots[number]
        way = self._graph.way(robot.place, robot.goal, number) if robot.goal is not None else ()
        return dict.fromkeys(holder for place in way for holder in self._holders.get(place, ()) if holder != number)

    @cached_property
    def _holders(self) -> dict[int, list[int]]:
        """By place: the robots because of which no other one can be there."""
        holders: dict[int, list[int]] = {}
        for number, robot in enumerate(self._robots):
            for place in self._taken(robot.place):
                holders.setdefault(place, []).append(number)
        return holders

    def _taken(self, place: int) -> tuple[int, ...]:
        return (place, *self._graph.exclusions[place])

    def _is_fixed(self, number: int) -> bool:
        return not self._robots[number].movable and not self._robots[number].busy
