"""Roadmaps from free space: lanes lead through no wall, robots can get wherever there is room, and do not touch each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import ndimage

from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import Value
from somrs.space.free_space import FreeSpace
from somrs.space.lines import segment_distance
from somrs.space.solids import solid_of
from somrs.traffic.layout import DOOR_ROOM, MARGIN, OpenBuilding, lay_out, sizes
from somrs.traffic.planning.graph import FAR
from somrs.traffic.roadmap import GAP, NumberedRoadmap, Roadmap, RobotKind, least_distance, spacing_for
from somrs.traffic.storey_layout import PLACES

ONTOLOGY = upper()
RADIUS = 0.25


def box(name: str, type: str, x: float, y: float, width: float, depth: float, height: float = 1.0, z: float = 0.0, **more: Value) -> Object:
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": width, "Shape.Depth": depth, "Shape.Height": height}
    return Object(name=name, type=type, values={"PositionX": x, "PositionY": y, "PositionZ": z, **shape, **more})


def room(width: float, depth: float, *objects: Object) -> Map:
    return Map([box("Floor1", "Floor", width / 2, depth / 2, width, depth, 0.1, -0.1), *objects])


def laid_out(map: Map, *levels: float) -> NumberedRoadmap:
    return NumberedRoadmap(lay_out(OpenBuilding(map, ONTOLOGY, levels or (0.0,)), (RobotKind(RADIUS),)))


def nearest(roadmap: Roadmap, x: float, y: float) -> str:
    return min(roadmap.places, key=lambda place: math.dist((place.x, place.y), (x, y))).name


def distance(numbered: NumberedRoadmap, start: tuple[float, float], end: tuple[float, float]) -> float:
    numbers = [numbered.numbers[nearest(numbered.roadmap, *point)] for point in (start, end)]
    return numbered.graph.distances(numbers[1])[numbers[0]]


def test_an_open_floor_is_covered_by_places_that_do_not_exclude_each_other() -> None:
    numbered = laid_out(room(6, 5))
    assert 50 < len(numbered.names) < 80
    inner = [number for number, place in enumerate(numbered.roadmap.places) if 1 < place.x < 5 and 1 < place.y < 4]
    assert all(len(numbered.graph.successors[number]) == 6 and not numbered.graph.exclusions[number] for number in inner)


@pytest.mark.parametrize(("x", "y"), [(0.238, 0.157), (0.195, 0.2)])
def test_parts_that_meet_only_between_the_corners_of_two_walls_stay_apart(x: float, y: float) -> None:
    """The free space is one part there by the cells of its grid, but no robot drives from the one cell to the next."""
    width, depth = 1.5 - x, 1.25 - y
    walls = [box("Wall1", "Wall", width / 2, depth / 2, width, depth), box("Wall2", "Wall", 3 - width / 2, 2.5 - depth / 2, width, depth)]
    numbered = laid_out(room(3, 2.5, *walls))
    assert distance(numbered, (0.4, 2.1), (2.6, 0.4)) == FAR


def test_a_shut_door_has_a_place_in_its_middle() -> None:
    wall = [box(f"Wall{side}", "Wall", 3, 2.5 + side * 1.5, 0.2, 2.0) for side in (-1, 1)]
    numbered = laid_out(room(6, 5, *wall, box("Door1", "Door", 3, 2.5, 0.2, 1.0, 2.0, Open=False)))
    assert any(math.dist((place.x, place.y), (3, 2.5)) < 0.01 for place in numbered.roadmap.places)
    assert distance(numbered, (1, 1), (5, 1)) < FAR


def test_each_of_two_doors_between_two_rooms_has_lanes() -> None:
    walls = [box(f"Wall{i}", "Wall", 4.05, y, 0.1, depth, 2.5) for i, (y, depth) in enumerate(((0.25, 0.5), (2.0, 1.2), (3.75, 0.5)))]
    numbered = laid_out(room(8.1, 4, *walls))
    for y in (0.95, 3.05):
        through = box("Bin1", "Bin", 4.05, 4 - y, 0.1, 0.9, 0.5)
        assert distance(laid_out(room(8.1, 4, *walls, through)), (1, 2), (7, 2)) < FAR, "the other one is shut"
        assert distance(numbered, (3.2, y), (4.9, y)) < 2 * 1.7 / 0.8, "not through the other one"


def test_a_large_floor_has_no_more_places_than_can_be_handled() -> None:
    numbered = laid_out(room(150, 60, *(box(f"Wall{i}", "Wall", 10.0 * i, 28, 0.2, 56, 2.5) for i in range(1, 15))))
    assert len(numbered.names) < 1.3 * PLACES
    assert distance(numbered, (5, 2), (145, 2)) < FAR
    assert numbered.spacing(0) > spacing_for(RADIUS)
    assert max(math.dist(*((numbered.roadmap.places[n].x, numbered.roadmap.places[n].y) for n in lane)) for lane in lanes(numbered)) <= (
        numbered.spacing(0) * 1.001
    )


@given(st.floats(-0.4, 0.4), st.floats(0.0, 0.3))
def test_a_robot_that_waits_for_a_lift_is_not_in_the_way_of_its_doors(shift: float, inset: float) -> None:
    objects = [
        Object(name="Storey1", type="Storey", values={"Elevation": 0.0}),
        box("Floor1", "Floor", 2 - inset / 2, 2, 4 - inset, 4, 0.1, -0.1),
        box("Lift1", "Lift", 5.0 - inset, 2.0 + shift, 1.8, 1.8, 2.3),
        box("Gate1", "LiftDoor", 4.05 - inset, 2.0 + shift, 0.1, 1.2, 2.1, Open=False),
    ]
    map = Map(objects, [Fact("stopsAt", ("Lift1", "Storey1")), Fact("leadsInto", ("Gate1", "Lift1"))])
    numbered, gate = laid_out(map), solid_of(objects[-1], ONTOLOGY)
    assert gate is not None
    assert any(place.zone == "Lift1" for place in numbered.roadmap.places)
    for place in numbered.roadmap.places:
        assert place.zone == "Lift1" or gate.distance(place.x, place.y) >= RADIUS + DOOR_ROOM


def lanes(numbered: NumberedRoadmap) -> list[tuple[int, int]]:
    return [(numbered.numbers[lane.start], numbered.numbers[lane.end]) for lane in numbered.roadmap.lanes]


def test_a_corridor_as_wide_as_a_robot_and_a_little_is_passed() -> None:
    walls = [box(f"Wall{side}", "Wall", 5, 2.5 + side * 1.4, 6, 2.1) for side in (-1, 1)]
    numbered = laid_out(room(10, 5, *walls))
    assert distance(numbered, (0.8, 2.5), (9.2, 2.5)) < 2 * 8.4 / 0.8


def test_floors_of_several_levels_are_not_joined() -> None:
    upper_floor = box("Floor2", "Floor", 2, 2, 4, 4, 0.1, 2.9)
    numbered = laid_out(room(4, 4, upper_floor), 0.0, 3.0)
    assert {place.level for place in numbered.roadmap.places} == {0.0, 3.0}
    levels = {place.name: place.level for place in numbered.roadmap.places}
    assert all(levels[lane.start] == levels[lane.end] for lane in numbered.roadmap.lanes)


@given(st.data())
def test_there_are_lanes_where_there_is_a_path_and_none_through_what_stands_there(data: st.DataObject) -> None:
    coordinate = st.integers(2, 28).map(lambda tenths: tenths / 5)
    sizes = st.sampled_from(((0.4, 2.0), (2.5, 0.2), (1.0, 1.0)))
    furniture = [
        box(f"Table{number}", "Table", data.draw(coordinate), data.draw(coordinate), *data.draw(sizes))
        for number in range(data.draw(st.integers(0, 5)))
    ]
    map = room(6, 6, *furniture)
    free_space, numbered = FreeSpace(map, ONTOLOGY), laid_out(map)
    points = {place.name: (place.x, place.y) for place in numbered.roadmap.places}
    for lane in numbered.roadmap.lanes:
        start_point, end_point = points[lane.start], points[lane.end]
        assert math.dist(start_point, end_point) <= spacing_for(RADIUS) * 1.001
        assert free_space.clearances(np.linspace(start_point, end_point, 41)).min() > RADIUS - 0.02
    free = st.tuples(coordinate, coordinate).filter(lambda point: free_space.free(point, RADIUS + MARGIN + 0.02))
    assume(np.count_nonzero(free_space.field >= RADIUS + MARGIN + 0.05) > 400)
    start, end = data.draw(free), data.draw(free)
    seen = [sees(free_space, numbered.roadmap, point) for point in (start, end)]
    assert all(seen), "every free point sees a place"
    if region(free_space, start) == region(free_space, end):
        graph = numbered.graph
        assert min(graph.distances(numbered.numbers[b])[numbered.numbers[a]] for a in seen[0] for b in seen[1]) < FAR


def region(free_space: FreeSpace, point: tuple[float, float]) -> int:
    """The number of the part of the free space in which a point is."""
    labels = ndimage.label(free_space.field >= RADIUS + MARGIN, structure=np.ones((3, 3)))[0]
    return int(labels[free_space.grid.clipped(point)])


def sees(free_space: FreeSpace, roadmap: Roadmap, point: tuple[float, float]) -> list[str]:
    """The places to which a robot can drive from the point in a straight line, as it does to and from a berth."""
    near = (place for place in roadmap.places if math.dist((place.x, place.y), point) <= spacing_for(RADIUS))
    return [place.name for place in near if free_space.is_clear(point, (place.x, place.y), RADIUS + MARGIN - 0.02)]


@pytest.mark.parametrize("stretch", [0.6, 0.8, 1.0])
@given(st.data())
def test_robots_on_lanes_between_places_that_do_not_exclude_each_other_do_not_touch(stretch: float, data: st.DataObject) -> None:
    """The geometry that the spacing follows from, with lanes anywhere."""
    spacing = (2 * RADIUS + GAP) * 2 / math.sqrt(3)
    coordinate = st.floats(0, 2)
    start, near_start = ((data.draw(coordinate), data.draw(coordinate)) for _ in range(2))
    end, near_end = (
        (x + spacing * stretch * math.cos(angle), y + spacing * stretch * math.sin(angle))
        for (x, y), angle in ((point, data.draw(st.floats(0, math.tau))) for point in (start, near_start))
    )
    ends = [math.dist(a, b) for a in (start, end) for b in (near_start, near_end)]
    assume(min(ends) >= spacing)
    assert segment_distance(start, end, near_start, near_end) >= 2 * RADIUS + GAP - 1e-9


def test_large_robots_have_places_where_they_fit_and_small_ones_go_everywhere() -> None:
    wall = [box(f"Wall{side}", "Wall", 4, 3 + side * 1.8, 0.2, 2.6) for side in (-1, 1)]  # with a gap of 1 m
    small, large = 0.25, 0.7
    numbered = NumberedRoadmap(lay_out(OpenBuilding(room(8, 6, *wall), ONTOLOGY, (0.0,)), [*map(RobotKind, (large, 0.22, small))]))
    assert numbered.kinds == [RobotKind(small), RobotKind(large)]
    for radius, passes in ((small, True), (large, False)):
        own = [number for number, place in enumerate(numbered.roadmap.places) if place.radius == radius]
        start, end = (min(own, key=lambda number: abs(numbered.roadmap.places[number].x - x)) for x in (1.0, 7.0))
        assert (numbered.graph.distances(end)[start] < FAR) == passes
        others = {end for number in own for end in numbered.graph.successors[number]}
        assert all(numbered.roadmap.places[number].radius == radius for number in others)


def test_sizes_that_are_about_the_same_are_one() -> None:
    assert sizes([0.27, 0.75, 0.25, 0.22, 0.3]) == [0.22, 0.3, 0.75]
    assert sizes([]) == []


radii = st.floats(0.1, 1.0)
turns = st.floats(-math.pi, math.pi)


@given(small=radii, large=radii, length=st.floats(0, 1), near_length=st.floats(0, 1), x=st.floats(-3, 3), y=st.floats(-3, 3), turn=turns)
def test_robots_of_two_sizes_do_not_touch_on_their_lanes(
    small: float, large: float, length: float, near_length: float, x: float, y: float, turn: float
) -> None:
    spacings = spacing_for(small), spacing_for(large)
    way, near_way = length * spacings[0], near_length * spacings[1]
    lane = (0.0, 0.0), (way, 0.0)
    near_lane = (x, y), (x + near_way * math.cos(turn), y + near_way * math.sin(turn))
    assume(all(math.dist(end, near_end) >= least_distance(*spacings) for end in lane for near_end in near_lane))
    assert segment_distance(*lane, *near_lane) >= small + large + GAP - 1e-9
