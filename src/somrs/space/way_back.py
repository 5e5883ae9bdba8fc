"""Lanes from which no lane leads back: a robot that drives on one would be caught behind it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.space.lanes import MapLane, Waypoint, lanes_for, lanes_of


@dataclass(frozen=True, slots=True, kw_only=True)
class OneWayLane:
    """A lane from whose end no way leads back to its start. `behind`: where a robot gets to by it, waypoints or lifts, its end first."""

    lane: str
    start: str
    behind: tuple[str, ...]


def lanes_without_way_back(map: Map, ontology: Ontology) -> list[OneWayLane]:
    """The lanes that lead out of the largest part of a network within which a robot gets from everywhere to everywhere.

    The lanes of a graph, with those of no graph, are a network of their own. A lift connects all waypoints in its cabin.
    """
    lanes = lanes_of(map, ontology)
    graphs = sorted({lane.graph for lane in lanes if lane.graph is not None})
    networks = [lanes_for(graph, lanes) for graph in graphs] or [[*lanes]]
    caught = {lane.lane: lane for network in networks for lane in _leading_out(network)}
    return [caught[name] for name in sorted(caught)]


def _leading_out(lanes: Sequence[MapLane]) -> Iterator[OneWayLane]:
    if not lanes:
        return
    names = sorted({_node(end) for lane in lanes for end in (lane.start, lane.end)})
    numbers = {name: number for number, name in enumerate(names)}
    network = _network(lanes, numbers)
    _, regions = connected_components(network, connection="strong")
    _, islands = connected_components(network, directed=False)
    for island in range(int(islands.max()) + 1):
        home = _largest(network, regions, np.nonzero(islands == island)[0])
        for lane in lanes:
            start, end = numbers[_node(lane.start)], numbers[_node(lane.end)]
            if regions[start] == home != regions[end]:
                behind = breadth_first_order(network, end, return_predecessors=False)
                yield OneWayLane(lane=lane.name, start=_node(lane.start), behind=tuple(names[number] for number in behind.tolist()))


def _node(waypoint: Waypoint) -> str:
    """The lift in whose cabin the waypoint is, which connects all that are there; or else the waypoint."""
    return waypoint.lift or waypoint.name


def _network(lanes: Sequence[MapLane], numbers: Mapping[str, int]) -> Any:
    ways = [(numbers[_node(lane.start)], numbers[_node(lane.end)]) for lane in lanes]
    ways += [(numbers[_node(lane.end)], numbers[_node(lane.start)]) for lane in lanes if lane.bidirectional]
    rows, columns = zip(*ways, strict=True)
    return csr_array((np.ones(len(ways), dtype=np.int32), (rows, columns)), shape=(len(numbers), len(numbers)))


def _largest(network: Any, regions: Any, members: Any) -> int:
    """The region with the most of the members; of those with equally many, the one from which the most waypoints are reached."""
    sizes = np.bincount(regions[members])
    candidates: list[int] = np.nonzero(sizes == sizes.max())[0].tolist()
    entries = {region: int(members[regions[members] == region][0]) for region in candidates}
    return max(candidates, key=lambda region: len(breadth_first_order(network, entries[region], return_predecessors=False)))
