"""The places and lanes of a roadmap as a graph for the planner: places are numbered, and only their neighbours and distances count."""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Iterator, Sequence
from copy import copy
from functools import cached_property
from itertools import zip_longest

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from somrs.traffic.planning.corridors import NOWHERE, find_corridors
from somrs.traffic.planning.recent import recall

FAR = float("inf")
"""The distance of a place from which a goal cannot be reached."""
MOST_NUMBERS, FEWEST_GOALS = 16_000_000, 256
"""How many distances a graph keeps at most, of 8 bytes each, and of how many goals at least."""
MOST_STARTS = 64
"""From how many places a graph keeps the distances to all others: robots that wait ask for them again and again."""


Lane = tuple[int, int]
"""The places at which a lane begins and ends."""


class PrivatePlace(Struct, frozen=True):
    """A place that only its owner enters, such as the point beside a table at which a robot works.

    `lanes`: the places from which a lane leads there, and back, with their lengths. `exclusions`: see `Graph`.
    """

    owner: Hashable
    lanes: tuple[tuple[int, float], ...]
    exclusions: tuple[int, ...]


class Graph:
    """Places, numbered from 0, the lanes between them, and the places that exclude each other.

    `lanes` are (from, to, length): a robot takes `length` seconds, or as many steps. `conflicts` are pairs of places at which two robots
    would touch each other. A robot can wait at any place.
    """

    def __init__(self, size: int, lanes: Iterable[tuple[int, int, float]], conflicts: Iterable[tuple[int, int]] = ()) -> None:
        lengths: list[dict[int, float]] = [{} for _ in range(size)]
        for start, end, length in lanes:
            lengths[start][end] = min(length, lengths[start].get(end, FAR))
        exclusions: list[dict[int, None]] = [{} for _ in range(size)]
        for first, second in conflicts:
            if first != second:
                exclusions[first][second] = exclusions[second][first] = None
        self._assemble(lengths, [tuple(excluded) for excluded in exclusions], [tuple(ends) for ends in lengths])

    def _assemble(self, lengths: list[dict[int, float]], exclusions: list[tuple[int, ...]], successors: list[tuple[int, ...]]) -> None:
        self.size, self._lengths = len(lengths), lengths
        self.successors = successors
        """By place: those to which a lane leads that any robot may take."""
        self.exclusions = exclusions
        """By place: the others that no robot may be at while one is at this place."""
        self._private_ways: dict[int, list[tuple[Hashable, int]]] = {}
        self._most_goals = max(FEWEST_GOALS, MOST_NUMBERS // max(self.size, 1))
        """Of how many goals the distances are kept."""
        self._distances: dict[int, array[float]] = {}
        self._lane_distances: dict[tuple[tuple[int, float], ...], array[float]] = {}
        self._onward_distances: dict[tuple[tuple[int, float], ...], array[float]] = {}
        self._delays = np.zeros(self.size)
        """By place: how much longer than a lane from there is the way along it."""
        self._without: tuple[tuple[set[int], set[Lane]], Graph] | None = None
        """The places to which lanes were left out last, the lanes that were left out, and the graph without them."""
        self._with_private: _WithPrivatePlaces | None = None
        """The graph with the private places that there were last."""

    def options(self, place: int, robot: Hashable) -> tuple[int, ...]:
        """The places to which the robot may go from this place."""
        private = self._private_ways.get(place)
        if private is None:
            return self.successors[place]
        return (*self.successors[place], *(end for owner, end in private if owner == robot))

    @property
    def public(self) -> Graph:
        """The graph of the places that any robot may enter: the first ones."""
        return self

    @property
    def public_size(self) -> int:
        return self.public.size

    def length(self, start: int, end: int) -> float:
        """The length of a lane."""
        return self._lengths[start][end]

    def is_lane(self, start: int, end: int) -> bool:
        """Whether a lane leads from one place to the other."""
        return end in self._lengths[start]

    @cached_property
    def predecessors(self) -> Sequence[Sequence[int]]:
        """By place: those from which a lane leads there that any robot may take."""
        starts: list[list[int]] = [[] for _ in range(self.size)]
        for start, ends in enumerate(self.successors):
            for end in ends:
                starts[end].append(start)
        return starts

    def without(self, places: Iterable[int]) -> Graph:
        """This graph without the lanes to these places, and to those that they exclude."""
        return self.without_lanes_to({excluded for place in places for excluded in (place, *self.exclusions[place])})

    def without_lanes_to(self, closed: set[int], lanes: Collection[Lane] = ()) -> Graph:
        """This graph without the lanes to these places alone, and without these lanes."""
        left_out = {place for place in closed if place < self.size}, {*lanes}
        if self._without is not None and self._without[0] == left_out:
            return self._without[1]  # with the distances that are known
        lengths = [ends if left_out[0].isdisjoint(ends) else _without_keys(ends, left_out[0]) for ends in self._lengths]
        for start, end in lanes:
            lengths[start] = _without_keys(lengths[start], {end})
        graph = Graph.__new__(Graph)
        graph._assemble(lengths, self.exclusions, [tuple(ends) for ends in lengths])
        self._without = left_out, graph
        return graph

    def delayed(self, places: Collection[int], seconds: float) -> Graph:
        """This graph, on which it takes so much longer to get on from these places. It is for `distances` alone: lanes are as long as
        before."""
        graph = copy(self)
        graph._distances, graph._lane_distances, graph._onward_distances = {}, {}, {}
        graph._delays = self._delays.copy()
        graph._delays[[*places]] += seconds
        graph._backwards = self._backwards.copy()
        graph._backwards.data += (graph._delays - self._delays)[graph._backwards.indices]
        return graph

    def with_private(self, places: Sequence[PrivatePlace | None]) -> Graph:
        """This graph with private places, which get the next numbers. None leaves a number out."""
        if not places:
            return self
        if self._with_private is None or self._with_private._places != [*places]:
            self._with_private = _WithPrivatePlaces(self, places, self._with_private)
        return self._with_private

    def distances(self, goal: int) -> array[float]:
        """By place: the length of the shortest way to the goal; `FAR` if there is none (Dijkstra, backwards).

        No way leads through a private place. The distances from the goals that were asked for last are kept.
        """
        return recall(self._distances, goal, lambda: self._find_distances(goal), self._most_goals)

    def distance(self, start: int, goal: int) -> float:
        """The length of the shortest way from a place to a goal; `FAR` if there is none."""
        return self.distances(goal)[start]

    def distances_from(self, start: int) -> array[float]:
        """By place that any robot may enter: the length of the shortest way there from a place; `FAR` if there is none (Dijkstra)."""
        return self.distances_over(((start, 0.0),))

    def distances_from_lanes(self, lanes: tuple[tuple[int, float], ...]) -> array[float]:
        """By place: the length of the shortest way to a private place with these lanes; `FAR` if there is none."""
        return recall(self._lane_distances, lanes, lambda: self._find_lane_distances(lanes), self._most_goals)

    def _find_lane_distances(self, lanes: tuple[tuple[int, float], ...]) -> array[float]:
        """Dijkstra, backwards, from one more place to which these lanes lead."""
        starts, lengths = [start for start, _ in lanes], [length + self._delays[start] for start, length in lanes]
        public = self._backwards
        numbers = np.append(public.indices, starts), np.append(public.indptr, public.nnz + len(lanes))
        backwards = csr_array((np.append(public.data, lengths), *numbers), shape=(self.size + 1, self.size + 1))
        return array("d", dijkstra(backwards, indices=self.size)[:-1])

    def distances_over(self, lanes: tuple[tuple[int, float], ...]) -> array[float]:
        """By place: the length of the shortest way there from a private place with these lanes; `FAR` if there is none."""
        return recall(self._onward_distances, lanes, lambda: self._find_onward_distances(lanes), MOST_STARTS)

    def _find_onward_distances(self, lanes: tuple[tuple[int, float], ...]) -> array[float]:
        """Dijkstra, from one more place from which these lanes lead."""
        ends, lengths = [end for end, _ in lanes], [length for _, length in lanes]
        public = csr_array(self._backwards.T)
        numbers = np.append(public.indices, ends), np.append(public.indptr, public.nnz + len(lanes))
        forwards = csr_array((np.append(public.data, lengths), *numbers), shape=(self.size + 1, self.size + 1))
        return array("d", dijkstra(forwards, indices=self.size)[:-1])

    def way(self, start: int, goal: int, robot: Hashable) -> Iterator[int]:
        """The places after the start on a shortest way of the robot to the goal; none without a way."""
        distances, place = self.distances(goal), start
        while place != goal and distances[place] < FAR:
            place = min(self.options(place, robot), key=lambda following: self.length(place, following) + distances[following])
            yield place

    @cached_property
    def corridors(self) -> Sequence[int]:
        """By place: the number of the corridor in which it is, or at whose mouth; `NOWHERE` if it is in none."""
        return find_corridors(self.successors, self.exclusions)

    def _find_distances(self, goal: int) -> array[float]:
        return array("d", dijkstra(self._backwards, indices=goal))

    @cached_property
    def _backwards(self) -> csr_array:
        """The lengths of the lanes, from the place at which each ends to that at which it begins."""
        lanes = [(end, start, length) for start, ends in enumerate(self._lengths) for end, length in ends.items()]
        ends, starts, lengths = zip(*lanes, strict=True) if lanes else ((), (), ())
        return csr_array(coo_array((lengths, (ends, starts)), shape=(self.size, self.size), dtype=float))


class _WithPrivatePlaces(Graph):
    """Shares what it can with the graph without private places, because these come and go with each trip."""

    def __init__(self, public: Graph, places: Sequence[PrivatePlace | None], earlier: _WithPrivatePlaces | None = None) -> None:
        """`earlier`: such a graph with the same public places, of which nothing is made again that is the same."""
        self._public, self._places = public, [*places]
        known_places = earlier._places if earlier is not None else []
        source, count = (earlier, len(known_places)) if earlier is not None else (public, 0)
        kept = public.size + min(count, len(places))
        added = range(kept, public.size + len(places))
        self._assemble(
            [*source._lengths[:kept], *({} for _ in added)],
            [*source.exclusions[:kept], *(() for _ in added)],
            [*source.successors[:kept], *(() for _ in added)],
        )
        self._near: dict[int, frozenset[int]] = dict(earlier._near) if earlier is not None else {}
        """By place: the private places and those near it that exclude each other with it."""
        self._private_ways = dict(source._private_ways)
        pairs = enumerate(zip_longest(known_places, self._places), start=public.size)
        self._replace({number: pair for number, pair in pairs if pair[0] != pair[1]})

    def _replace(self, changes: dict[int, tuple[PrivatePlace | None, PrivatePlace | None]]) -> None:
        """By their numbers, use other private places than before."""
        lost: defaultdict[int, set[int]] = defaultdict(set)
        won: defaultdict[int, set[int]] = defaultdict(set)
        for number, (old_place, new_place) in changes.items():
            for place, pairs in ((old_place, lost), (new_place, won)):
                for near_place in place.exclusions if place is not None else ():
                    pairs[number].add(near_place)
                    pairs[near_place].add(number)
            for start, _ in old_place.lanes if old_place is not None else ():
                self._private_ways[start] = [way for way in self._private_ways[start] if way[1] != number]
            for start, _ in new_place.lanes if new_place is not None else ():
                self._private_ways[start] = [*self._private_ways.get(start, ()), (new_place.owner, number)]  # type: ignore[union-attr]
            if number < self.size:
                self._lengths[number] = dict(new_place.lanes) if new_place is not None else {}
                self.successors[number] = tuple(self._lengths[number])
        for number in {*lost, *won}:
            near_places = self._near[number] = (self._near.get(number, frozenset()) - lost[number]) | won[number]
            if number < self.size:
                public = self._public.exclusions[number] if number < self._public.size else ()
                self.exclusions[number] = (*public, *sorted(near_places))

    @property
    def public(self) -> Graph:
        return self._public

    @cached_property
    def corridors(self) -> Sequence[int]:
        return [*self._public.corridors, *([NOWHERE] * len(self._places))]

    def length(self, start: int, end: int) -> float:
        return self._lengths[start][end] if end < self._public.size else self._lengths[end][start]

    def without_lanes_to(self, closed: set[int], lanes: Collection[Lane] = ()) -> Graph:
        kept = (place if number not in closed else None for number, place in enumerate(self._places, start=self._public.size))
        reduced = [replace(place, lanes=tuple(lane for lane in place.lanes if lane[0] not in closed)) if place else None for place in kept]
        return self._public.without_lanes_to(closed, lanes).with_private(reduced)

    def delayed(self, places: Collection[int], seconds: float) -> Graph:
        graph = copy(self)
        graph._distances = {}
        graph._public = self._public.delayed([place for place in places if place < self._public.size], seconds)
        return graph

    def distances_from(self, start: int) -> array[float]:
        if start < self._public.size:
            return self._public.distances_from(start)
        place = self._places[start - self._public.size]
        return self._public.distances_over(place.lanes if place is not None else ())

    def distance(self, start: int, goal: int) -> float:
        if start == goal:
            return 0.0
        distances = self._public_distances(goal)
        if start < self._public.size:
            return distances[start]
        place = self._places[start - self._public.size]
        return min((distances[end] + length for end, length in place.lanes), default=FAR) if place is not None else FAR

    def _public_distances(self, goal: int) -> array[float]:
        if goal < self._public.size:
            return self._public.distances(goal)
        place = self._places[goal - self._public.size]
        return self._public.distances_from_lanes(place.lanes if place is not None else ())

    def _find_distances(self, goal: int) -> array[float]:
        public, private = self._public_distances(goal), np.full(len(self._places), FAR)
        starts, ends, lengths, numbers = self._private_lanes
        if len(numbers):
            private[numbers] = np.minimum.reduceat(np.frombuffer(public)[ends] + lengths, starts)
        if goal >= self._public.size:
            private[goal - self._public.size] = 0.0
        return public + array("d", private.tobytes())

    @cached_property
    def _private_lanes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Where the lanes of each private place begin in the two following arrays; where they lead; their lengths; whose they are."""
        numbers = [number for number, place in enumerate(self._places) if place is not None and place.lanes]
        lanes = [self._places[number].lanes for number in numbers]  # type: ignore[union-attr]
        starts = np.cumsum([0, *(len(own_lanes) for own_lanes in lanes)])[:-1]
        ends = np.array([end for own_lanes in lanes for end, _ in own_lanes], dtype=int)
        lengths = np.array([length for own_lanes in lanes for _, length in own_lanes])
        return starts, ends, lengths, np.array(numbers, dtype=int)


def _without_keys(ends: dict[int, float], closed: set[int]) -> dict[int, float]:
    return {end: length for end, length in ends.items() if end not in closed}
