"""Roadmaps from lanes: robots drive on them as they lead, leave them for what is beside them, and always get back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec import structs
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Value
from somrs.space.lanes import MapLane, Waypoint
from somrs.traffic.layout import SPEED, OpenBuilding, lay_out
from somrs.traffic.planning.graph import FAR
from somrs.traffic.roadmap import NumberedRoadmap, RobotKind

Point = tuple[float, float]

RADIUS = 0.25
ROBOT = RobotKind(RADIUS, "0")
SQUARE = ((2.0, 2.0), (8.0, 2.0), (8.0, 6.0), (2.0, 6.0))


def box(name: str, type: str, x: float, y: float, width: float, depth: float, height: float = 1.0, z: float = 0.0) -> Object:
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": width, "Shape.Depth": depth, "Shape.Height": height}
    return Object(name=name, type=type, values={"PositionX": x, "PositionY": y, "PositionZ": z, **shape})


def hall(*objects: Object, width: float = 10.0, depth: float = 8.0) -> Map:
    return Map([box("Floor1", "Floor", width / 2, depth / 2, width, depth, 0.1, -0.1), *objects])


def waypoint(point: Point) -> Waypoint:
    return Waypoint(name=f"W{point[0]:g}/{point[1]:g}", x=point[0], y=point[1])


def lane(start: Point, end: Point, **more: object) -> MapLane:
    values = {"name": f"{start}{end}", "start": waypoint(start), "end": waypoint(end), "graph": "0", **more}
    return MapLane(**values)  # type: ignore[arg-type]


def loop(*corners: Point, **more: object) -> list[MapLane]:
    return [lane(start, end, **more) for start, end in zip(corners, (*corners[1:], corners[0]), strict=True)]


@dataclass
class Laid:
    roadmap: NumberedRoadmap

    def place(self, point: Point, kind: RobotKind = ROBOT) -> int:
        kind = self.roadmap.kind_for(kind)
        places = self.roadmap.roadmap.places
        numbers = [number for number, place in enumerate(places) if place.kind == kind]
        return min(numbers, key=lambda number: math.dist((places[number].x, places[number].y), point))

    def metres(self, start: Point, end: Point, kind: RobotKind = ROBOT) -> float:
        return self.roadmap.graph.distances(self.place(end, kind))[self.place(start, kind)] * SPEED

    def way(self, start: Point, end: Point) -> list[Point]:
        numbers = self.roadmap.graph.way(self.place(start), self.place(end), "robot")
        return [(place.x, place.y) for place in (self.roadmap.roadmap.places[number] for number in numbers)]


def laid(map: Map, lanes: Sequence[MapLane], *kinds: RobotKind) -> Laid:
    return Laid(NumberedRoadmap(lay_out(OpenBuilding(map, upper(), (0.0,), lanes), kinds or (ROBOT,))))


def test_robots_drive_round_on_one_way_lanes_and_others_straight() -> None:
    free_kind = RobotKind(RADIUS)
    roads = laid(hall(), loop(*SQUARE), ROBOT, free_kind)
    assert roads.metres(SQUARE[0], SQUARE[1]) == pytest.approx(6)
    assert roads.metres(SQUARE[1], SQUARE[0]) == pytest.approx(14), "the loop is one way"
    assert roads.metres(SQUARE[1], SQUARE[0], free_kind) == pytest.approx(6, rel=0.2), "it uses no lanes"
    assert roads.metres(SQUARE[1], SQUARE[0], RobotKind(RADIUS, "5")) == pytest.approx(6, rel=0.2), "there are none of its graph"


def test_lanes_of_no_graph_are_for_all() -> None:
    roads = laid(hall(), loop(*SQUARE, graph=None), ROBOT, RobotKind(RADIUS))
    assert {place.graph for place in roads.roadmap.roadmap.places} == {None}
    assert roads.metres(SQUARE[1], SQUARE[0], RobotKind(RADIUS)) == pytest.approx(14)


def test_both_ways_and_speed_limits() -> None:
    roads = laid(hall(), [lane(SQUARE[0], SQUARE[1], bidirectional=True, speed_limit=0.2)])
    assert roads.metres(SQUARE[1], SQUARE[0]) == pytest.approx(6 * SPEED / 0.2)
    (limit,) = {rules.speed_limit for rules in roads.roadmap.rules.values()}
    assert limit == 0.2


def test_robots_back_out_where_they_drive_in_forwards() -> None:
    roads = laid(hall(), [lane((2, 2), (8, 2), bidirectional=True, travel="Forward")])
    places = roads.roadmap.roadmap.places
    travel = {(places[end].x > places[start].x): rules.travel for (start, end), rules in roads.roadmap.rules.items()}
    assert travel == {True: "Forward", False: "Backward"}


def test_a_mutex_is_for_one_robot_at_a_time() -> None:
    lanes = [*loop(*SQUARE), lane(SQUARE[1], (9.4, 4), mutex="M"), lane((9.4, 4), SQUARE[2]), lane(SQUARE[3], (0.6, 4), mutex="M")]
    roads = laid(hall(), lanes)
    first, second = roads.place((8.7, 3)), roads.place((1.3, 5))
    assert second in roads.roadmap.graph.exclusions[first]
    assert roads.place((2, 2)) not in roads.roadmap.graph.exclusions[first]


def test_what_is_beside_the_lanes_is_reached_from_them_and_is_no_short_cut() -> None:
    roads = laid(hall(), loop(*SQUARE))
    middle = (5.0, 4.0)
    assert roads.metres(SQUARE[0], middle) < 14 + 6
    assert roads.metres(SQUARE[1], (4.0, 2.0)) == pytest.approx(16, rel=0.1), "not straight back, beside the lane"
    assert roads.metres(middle, SQUARE[3]) < FAR


def test_a_lane_leads_around_what_stands_on_it() -> None:
    roads = laid(hall(box("Table1", "Table", 5, 2, 1, 1)), loop(*SQUARE))
    assert 6 < roads.metres(SQUARE[0], SQUARE[1]) < 8
    assert roads.metres(SQUARE[1], SQUARE[0]) > 13


def test_a_waypoint_without_room_is_moved_or_left_out() -> None:
    roads = laid(hall(box("Table1", "Table", 8, 2, 0.4, 0.4)), loop(*SQUARE))
    assert roads.metres(SQUARE[3], (8, 3)) < 14
    roads = laid(hall(), [lane(SQUARE[0], SQUARE[1], bidirectional=True), lane(SQUARE[1], (30, 30))])
    assert roads.metres(SQUARE[0], SQUARE[1]) == pytest.approx(6)


def test_lanes_that_are_not_connected_are_joined_by_the_space_between_them() -> None:
    lanes = [lane((1, 2), (4, 2), bidirectional=True), lane((7, 2), (9, 2), bidirectional=True)]
    assert laid(hall(), lanes).metres((1, 2), (9, 2)) == pytest.approx(5 + 2 * 3, rel=0.25), "ways beside the lanes count twice"


def test_nobody_is_caught_behind_a_one_way_lane() -> None:
    roads = laid(hall(), [*loop(*SQUARE), lane(SQUARE[2], (9, 7)), lane((9, 7), (9.5, 7.5))])
    assert roads.metres((9.5, 7.5), SQUARE[0]) < FAR
    roads = laid(hall(), [*loop(*SQUARE), lane((9, 7), SQUARE[2])])
    assert roads.metres((9, 7), SQUARE[0]) < FAR


def test_robots_pass_each_other_beside_a_lane_in_both_directions() -> None:
    roads = laid(hall(), [lane(SQUARE[0], SQUARE[1], bidirectional=True)])
    graph, on_lane = roads.roadmap.graph, roads.place((5, 2))
    aside = [place for place in graph.successors[on_lane] if place not in graph.exclusions[on_lane]]
    points = [(roads.roadmap.roadmap.places[place].x, roads.roadmap.roadmap.places[place].y) for place in aside]
    assert {round(y - 2) for _, y in points} == {-1, 0, 1}, "before and behind it, and on both sides"


POINTS = [(x + 0.5, y + 0.5) for x, y in product(range(0, 10, 3), range(0, 8, 3))]
points = st.sampled_from(POINTS)
map_lanes = st.builds(lane, points, points, bidirectional=st.booleans(), graph=st.sampled_from(["0", "0", "1", None]))


@given(lanes=st.lists(map_lanes, min_size=1, max_size=12), table=points)
def test_ways_on_lanes_are_those_of_the_map_and_everywhere_is_reached(lanes: list[MapLane], table: Point) -> None:
    """Compared with shortest ways over the lanes alone, where nothing stands on them."""
    lanes = [structs.replace(lane, name=f"Lane{number}") for number, lane in enumerate(lanes) if lane.start != lane.end]
    assume(any(lane.graph == "0" for lane in lanes))
    own_lanes = [lane for lane in lanes if lane.graph in ("0", None)]
    numbers = {name: number for number, name in enumerate(sorted({end.name for lane in own_lanes for end in (lane.start, lane.end)}))}
    ends = [(numbers[lane.start.name], numbers[lane.end.name], lane.length) for lane in own_lanes]
    ends += [(numbers[lane.end.name], numbers[lane.start.name], lane.length) for lane in own_lanes if lane.bidirectional]
    lengths = np.full((len(numbers), len(numbers)), np.inf)
    for start, end, length in ends:
        lengths[start, end] = min(length, lengths[start, end])
    network = csr_array(np.where(np.isfinite(lengths), lengths, 0))
    count, _ = connected_components(network, connection="strong")
    is_open = all(distance_from_line(table, lane) > 1.2 for lane in own_lanes)
    map = hall(box("Table1", "Table", *table, 0.6, 0.6)) if is_open else hall()
    roads = laid(map, lanes)
    network_of_places, _ = connected_components(network_of(roads.roadmap), connection="strong")
    if count == 1:
        assert network_of_places == 1, "everywhere is reached, and nobody is caught"
        shortest = dijkstra(network)
        stops = {end.name: (end.x, end.y) for lane in own_lanes for end in (lane.start, lane.end)}
        for start_name, end_name in product(numbers, numbers):
            assert roads.metres(stops[start_name], stops[end_name]) == pytest.approx(
                shortest[numbers[start_name], numbers[end_name]], abs=1e-3
            )


def network_of(roadmap: NumberedRoadmap) -> csr_array:
    size, graph = len(roadmap.names), roadmap.graph
    ends = np.array([(start, end) for start in range(size) for end in graph.successors[start]], dtype=int).reshape(-1, 2)
    return csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (size, size))


def distance_from_line(point: Point, lane: MapLane) -> float:
    shares = np.linspace(0, 1, 50)
    x, y = lane.start.x + (lane.end.x - lane.start.x) * shares, lane.start.y + (lane.end.y - lane.start.y) * shares
    return float(np.hypot(x - point[0], y - point[1]).min())


def test_places_at_waypoints_where_robots_are_not_to_stop_are_marked() -> None:
    lanes = loop(*SQUARE)
    lanes[0] = MapLane(
        **{**{f: getattr(lanes[0], f) for f in lanes[0].__struct_fields__}, "end": Waypoint(name="W8/2", x=8, y=2, passthrough=True)}
    )
    (place,) = [place for place in laid(hall(), lanes).roadmap.roadmap.places if place.passthrough]
    assert (place.x, place.y) == (8, 2)
