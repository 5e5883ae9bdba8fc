"""Roadmaps from the lanes of a building: what of the free space of a storey robots use that keep to lanes.

Places lie on the lanes, as far apart as the spacing, and lead on only as the lanes do. All other places are for what is not on a lane:
the last metres to a goal, and stepping aside for others. Each of them belongs to the nearest place of a lane, its root, and leads only to
where its root, or one of the next places of the lane, is the root, too: so no way beside the lanes is a short cut, or leads against their
direction. Lanes that are not connected are joined by the free space between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array
from scipy.sparse.csgraph import connected_components, dijkstra

from somrs.space.lanes import BACKWARD, FORWARD, MapLane, Waypoint
from somrs.space.solids import Point
from somrs.traffic.coverage import Mask, Points

Pair = tuple[int, int]
Snap = Callable[[Point], Point | None]
"""The nearest point at which a robot has room; None if there is none near."""
AreClear = Callable[[Points, Points], Mask]
"""Whether a robot can drive in a straight line, for each pair of points (n, 2)."""

OPPOSITE = {FORWARD: BACKWARD, BACKWARD: FORWARD}
AHEAD = 2
"""Over how many lanes robots may pass beside them, before they are back on one."""
DETOUR = 2.0
"""How many times as long as a lane on which something stands a way around that may be."""


@dataclass(frozen=True, slots=True)
class Rule:
    """What holds on a lane; see `MapLane`. `is_aside`: it leads beside the lanes of the map."""

    speed_limit: float | None = None
    travel: str | None = None
    is_aside: bool = False


@dataclass(slots=True)
class LaneLayout:
    """The lanes of a storey for one layer of the roadmap. `spacing`: that of the places, in metres."""

    lanes: Sequence[MapLane]
    spacing: float
    snap: Snap
    are_clear: AreClear
    points: list[Point] = field(init=False, default_factory=list)
    """Of the places on lanes, which come first."""
    mutexes: dict[int, set[str]] = field(init=False, default_factory=dict)
    passthrough: set[int] = field(init=False, default_factory=set)
    """The places at waypoints where robots are not to stop."""
    _numbers: dict[str, int | None] = field(init=False, default_factory=dict)
    """By waypoint: its place; None if there is no room for the robot."""
    _chains: dict[Pair, tuple[int, ...]] = field(init=False, default_factory=dict)
    """By the places of two waypoints, the lower number first: all places on the straight way between them."""
    _blocked: list[MapLane] = field(init=False, default_factory=list)
    """The lanes on which something stands."""
    _directed: dict[Pair, Rule] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        for lane in self.lanes:
            start, end = self._place_at(lane.start), self._place_at(lane.end)
            if start is not None and end is not None and start != end:
                chain = self._chain(start, end)
                if chain is None:
                    self._blocked.append(lane)
                else:
                    self._lay(lane, chain)

    def _place_at(self, waypoint: Waypoint) -> int | None:
        if waypoint.name not in self._numbers:
            point = self.snap((waypoint.x, waypoint.y))
            number = self._numbers[waypoint.name] = self._add(point) if point is not None else None
            if number is not None and waypoint.passthrough:
                self.passthrough.add(number)
            if number is not None and waypoint.mutex is not None:
                self.mutexes.setdefault(number, set()).add(waypoint.mutex)
        return self._numbers[waypoint.name]

    def _add(self, point: Point) -> int:
        self.points.append(point)
        return len(self.points) - 1

    def _chain(self, start: int, end: int) -> tuple[int, ...] | None:
        """The places from one waypoint straight to another one, with new ones between them; None if the robot has no room on the way."""
        low, high = min(start, end), max(start, end)
        if (low, high) not in self._chains:
            origin, target = np.array(self.points[low]), np.array(self.points[high])
            length = float(np.hypot(*(target - origin)))
            count = max(math.ceil(length / self.spacing - 1e-6), 2)  # one between them, for what holds on the lane alone
            step = self.spacing if length > self.spacing else length / 2
            stops = [origin + (target - origin) * min(step * number / length, 1.0) for number in range(count)] + [target] if length else []
            if not stops or not self.are_clear(np.array(stops[:-1]), np.array(stops[1:])).all():
                return None
            self._chains[low, high] = (low, *(self._add((float(x), float(y))) for x, y in stops[1:-1]), high)
        chain = self._chains[low, high]
        return chain if start == low else chain[::-1]

    def _lay(self, lane: MapLane, chain: Sequence[int]) -> None:
        rule = Rule(lane.speed_limit, lane.travel)
        self._directed |= dict.fromkeys(pairwise(chain), rule)
        if lane.bidirectional:  # back, the robot faces as it did on the way there
            reverse_rule = Rule(lane.speed_limit, OPPOSITE.get(lane.travel or ""))
            for pair in pairwise(reversed(chain)):
                self._directed.setdefault(pair, reverse_rule)
        if lane.mutex is not None:
            for place in chain[1:-1]:
                self.mutexes.setdefault(place, set()).add(lane.mutex)

    def sidings(self) -> Iterator[Point]:
        """Points beside the lanes, where a robot that stands does not keep others from passing."""
        for chain in self._chains.values():
            (x, y), (end_x, end_y) = self.points[chain[0]], self.points[chain[-1]]
            length, offset = math.dist((x, y), (end_x, end_y)), self.spacing * (1 + 1e-7)
            across = (-(end_y - y) / length * offset, (end_x - x) / length * offset)
            for place in chain:
                for side in (1, -1):
                    yield self.points[place][0] + side * across[0], self.points[place][1] + side * across[1]

    def ways(self, points: Points, pairs: Sequence[Pair]) -> dict[Pair, Rule]:
        """What leads from place to place, with its rule. `points`: of all places; `pairs`: those between which a robot drives
        straight."""
        ends = np.array(pairs, dtype=int).reshape(-1, 2)
        lengths = np.hypot(*(points[ends[:, 0]] - points[ends[:, 1]]).T)
        network = csr_array((np.maximum(lengths, 1e-9), (ends[:, 0], ends[:, 1])), (len(points), len(points)))
        self._lay_around(network, points)
        places = sorted({place for pair in self._directed for place in pair})
        directed = np.array([*self._directed], dtype=int).reshape(-1, 2)
        roots = _roots(network, places)
        joined = csr_array((np.ones(len(directed), dtype=bool), (directed[:, 0], directed[:, 1])), (len(points), len(points)))
        _, islands = connected_components(joined, directed=False)
        on_lane = np.zeros(len(points), dtype=bool)
        on_lane[places] = True
        starts, ends = np.concatenate([ends, ends[:, ::-1]]).T
        near_lane = (roots[starts] >= 0) & (roots[ends] >= 0)
        joins_islands = near_lane & (islands[roots[starts]] != islands[roots[ends]])
        follows = near_lane & np.asarray(_leading(joined)[roots[starts], roots[ends]]).ravel()
        is_aside = ((roots[starts] == roots[ends]) | follows) & ~(on_lane[starts] & on_lane[ends])
        is_open = is_aside | joins_islands
        opened = zip(starts[is_open].tolist(), ends[is_open].tolist(), roots[starts[is_open]].tolist(), strict=True)
        limits = self._speed_limits()
        return {**{(start, end): Rule(limits.get(root), is_aside=bool(places)) for start, end, root in opened}, **self._directed}

    def _speed_limits(self) -> dict[int, float]:
        """By place of a lane: the lowest speed limit of the lanes there, which holds beside them, too."""
        limits: dict[int, float] = {}
        for pair, rule in self._directed.items():
            for place in pair if rule.speed_limit is not None else ():
                limits[place] = min(rule.speed_limit or math.inf, limits.get(place, math.inf))
        return limits

    def _lay_around(self, network: csr_array, points: Points) -> None:
        """Lay the lanes on which something stands around that, over other places."""
        for lane in self._blocked:
            start, end = self._numbers[lane.start.name], self._numbers[lane.end.name]
            if start is None or end is None:
                continue
            limit = DETOUR * (math.dist(points[start], points[end]) + self.spacing)
            lengths, predecessors = dijkstra(network, directed=False, indices=start, return_predecessors=True, limit=limit)
            if math.isfinite(lengths[end]):
                chain = [end]
                while chain[-1] != start:
                    chain.append(int(predecessors[chain[-1]]))
                self._lay(lane, chain[::-1])


def _leading(lanes: csr_array) -> csr_array:
    """By place: those to which it leads over at most `AHEAD` lanes."""
    single = lanes + eye_array(lanes.shape[0], dtype=bool, format="csr")
    reached = single
    for _ in range(AHEAD - 1):
        reached = reached @ single
    return csr_array(reached)


def _roots(network: csr_array, places: Sequence[int]) -> NDArray[np.int64]:
    """By place: the nearest one on a lane, over places beside the lanes; -1 if there is none."""
    if not places:
        return np.full(network.shape[0], -1)
    _, _, roots = dijkstra(network, directed=False, indices=places, min_only=True, return_predecessors=True)
    return np.where(roots < 0, -1, roots).astype(np.int64)
