"""Ways that robots take around what stands on the map, against a plain search on the raw grid."""

from __future__ import annotations

import heapq
import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.files.loading import upper
from somrs.ontology.objects import Map, Object
from somrs.ontology.types import Value
from somrs.space.clearance import Disc
from somrs.space.navigation import Navigator, edge_targets
from somrs.space.solids import Point, Solid, path_length, solid_of
from tests.support.examples import examples

ONTOLOGY = upper()
RADIUS = 0.25
REACH = (0.36, 0.64)


def box(
    name: str, type: str, x: float, y: float, width: float, depth: float, height: float = 1.0, z: float = 0.0, **attributes: Value
) -> Object:
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": width, "Shape.Depth": depth, "Shape.Height": height}
    return Object(name=name, type=type, values={"PositionX": x, "PositionY": y, "PositionZ": z, **shape, **attributes})


def floor(width: float, depth: float) -> Object:
    return box("Floor1", "Floor", width / 2, depth / 2, width, depth, 0.1, -0.1)


def navigator(*objects: Object) -> Navigator:
    return Navigator(Map(objects), ONTOLOGY)


def samples(path: list[Point]) -> list[Point]:
    counts = [max(1, math.ceil(math.dist(start, end) / 0.02)) for start, end in pairwise(path)]
    return [
        (start[0] + (end[0] - start[0]) * i / n, start[1] + (end[1] - start[1]) * i / n)
        for (start, end), n in zip(pairwise(path), counts, strict=True)
        for i in range(n + 1)
    ]


def plain_distance(solids: list[Solid], size: Point, start: Point, goal: Point, radius: float, cell: float = 0.1) -> float:
    """The twin: Dijkstra over the cells of a rectangular floor in which the robot meets nothing; infinite without a way."""
    columns, rows = round(size[0] / cell), round(size[1] / cell)

    def free(c: int, r: int) -> bool:
        x, y = c * cell, r * cell
        return min(x, y, size[0] - x, size[1] - y) >= radius and all(solid.distance(x, y) >= radius for solid in solids)

    open_cells = {(c, r) for c in range(columns + 1) for r in range(rows + 1) if free(c, r)}
    begin, end = ((round(p[0] / cell), round(p[1] / cell)) for p in (start, goal))
    costs, queue = {begin: 0.0}, [(0.0, begin)]
    while queue:
        cost, (c, r) = heapq.heappop(queue)
        if (c, r) == end:
            return cost * cell
        if cost > costs[c, r]:
            continue
        for dc, dr in ((dc, dr) for dc in (-1, 0, 1) for dr in (-1, 0, 1)):
            neighbour = c + dc, r + dr
            longer = cost + math.hypot(dc, dr)
            if neighbour in open_cells and longer < costs.get(neighbour, math.inf):
                costs[neighbour] = longer
                heapq.heappush(queue, (longer, neighbour))
    return math.inf


obstacles = st.builds(
    lambda i, x, y, w, d, yaw: box(f"Bin{i}", "Bin", x, y, w, d, RotationZ=yaw),
    st.integers(0, 99),
    st.floats(0, 6),
    st.floats(0, 4),
    st.floats(0.1, 3),
    st.floats(0.1, 1),
    st.floats(0, 3),
)


@examples(15)
@given(st.lists(obstacles, max_size=6))
def test_finds_a_way_where_the_plain_search_does_and_a_safe_one(things: list[Object]) -> None:
    size, start, goal = (6.0, 4.0), (0.5, 0.5), (5.5, 3.5)
    plan = navigator(floor(*size), *things)
    solids = list(plan.solids.values())
    path = plan.path(start, goal, RADIUS)
    if not plan.free(goal, RADIUS) or not plan.free(start, RADIUS):
        return
    wide = plain_distance(solids, size, start, goal, RADIUS + 0.1)
    if path is None:
        assert wide == math.inf
        return
    assert path[0] == start
    assert path[-1] == goal
    for x, y in samples(path):
        assert min(x, y, size[0] - x, size[1] - y) > RADIUS - 0.04
        assert all(solid.distance(x, y) > RADIUS - 0.02 for solid in solids)
    if wide < math.inf:
        # The plain way has corners of 45 degrees, at most 8 % longer than straight; ours likes room, and may take a longer way.
        assert path_length(path) <= 1.35 * wide
    narrow = plain_distance(solids, size, start, goal, RADIUS - 0.08)
    assert path_length(path) >= narrow / 1.09 - 0.15


def two_rooms(*extra_objects: Object, gap: float = 0.9) -> Navigator:
    """Two rooms of 4 x 4 m, and a wall between them with a gap in its middle."""
    side = (4 - gap) / 2
    return navigator(
        floor(8.1, 4),
        box("WallA", "Wall", 4.05, side / 2, 0.1, side, 2.5),
        box("WallB", "Wall", 4.05, 4 - side / 2, 0.1, side, 2.5),
        *extra_objects,
    )


def door(open: bool) -> Object:
    return box("Door1", "Door", 4.05, 2, 0.1, 0.9, 2, Open=open)


def test_passes_a_doorway_in_its_middle() -> None:
    path = two_rooms(door(True)).path((1, 0.5), (7, 0.5), RADIUS)
    assert path is not None
    crossing_point = min(samples(path), key=lambda point: abs(point[0] - 4.05))
    assert abs(crossing_point[1] - 2) < 0.15


def test_does_not_pass_a_closed_door_nor_a_gap_that_is_too_narrow() -> None:
    assert two_rooms(door(False)).path((1, 0.5), (7, 0.5), RADIUS) is None
    assert two_rooms(gap=0.45).path((1, 0.5), (7, 0.5), RADIUS) is None
    assert two_rooms(gap=0.45).distance((1, 0.5), (7, 0.5), 0.15) == pytest.approx(7.0, abs=0.7)


def test_another_robot_in_the_doorway_blocks_it_and_one_in_a_room_is_driven_around() -> None:
    plan = two_rooms()
    assert plan.path((1, 2), (7, 2), RADIUS, [Disc(4.05, 2, 0.25)]) is None
    path = plan.path((1, 2), (7, 2), RADIUS, [Disc(2.5, 2, 0.25)])
    assert path is not None
    assert min(math.dist(point, (2.5, 2)) for point in samples(path)) >= 0.49


def test_a_floor_that_ends_at_the_walls_does_not_close_the_door() -> None:
    halves = [box(f"Floor{i}", "Floor", x, 2, 4, 4, 0.1, -0.1) for i, x in enumerate((2, 6.1))]
    assert navigator(*halves).path((1, 2), (7, 2), RADIUS) is None
    assert navigator(*halves, door(True)).path((1, 2), (7, 2), RADIUS) is not None


def test_what_hangs_above_the_robot_does_not_block_and_what_is_carried_is_no_obstacle() -> None:
    def crossing_length(thing: Object) -> float | None:
        return navigator(floor(4, 1), thing).distance((0.5, 0.5), (3.5, 0.5), RADIUS)

    assert crossing_length(box("Cupboard1", "Cupboard", 2, 0.5, 1, 1, 0.5, 1.9)) == pytest.approx(3)
    assert crossing_length(box("Cupboard1", "Cupboard", 2, 0.5, 1, 1, 0.5, 1.2)) is None
    assert crossing_length(Object(name="Jar1", type="Jar", values={"PositionX": 2.0, "PositionY": 0.5, "PositionZ": 0.0})) == pytest.approx(
        3
    )


def test_leaves_a_place_that_is_too_close_to_a_table() -> None:
    plan = navigator(floor(6, 6), box("Table1", "Table", 3, 3, 1, 1))
    path = plan.path((2.3, 3), (5, 3), RADIUS)
    assert path is not None
    assert path_length(path) < 4.5
    assert plan.path((5, 3), (2.3, 3), RADIUS) is None, "but nothing drives there"


def test_the_goal_may_be_anywhere_outside_only_where_there_are_no_floors() -> None:
    bin = box("Bin1", "Bin", 1, 1, 0.3, 0.3)
    assert navigator(bin, floor(2, 2)).path((0.5, 0.5), (3, 3), RADIUS) is None
    assert navigator(bin).path((0.5, 0.5), (3, 3), RADIUS) is not None


def test_reaches_a_jar_on_a_cupboard_at_a_wall_from_the_front() -> None:
    plan = navigator(floor(6, 6), box("Cupboard1", "Cupboard", 0.25, 3, 0.5, 1.2, 0.8), box("Wall1", "Wall", -0.05, 3, 0.1, 6, 2.5))
    poses = plan.approach((5, 5), (0.38, 3.0), RADIUS, REACH, height=0.8)
    assert poses
    for pose in poses:
        assert plan.free((pose.x, pose.y), RADIUS)
        assert plan.path((5, 5), (pose.x, pose.y), RADIUS) is not None
        distance = math.dist((pose.x, pose.y), pose.target)
        assert REACH[0] <= distance <= REACH[1] + 1e-9
        assert pose.x + distance * math.cos(pose.yaw) == pytest.approx(0.38)
        assert pose.y + distance * math.sin(pose.yaw) == pytest.approx(3.0)
    assert abs(poses[0].yaw) > 2.3, "looking west"
    assert plan.approach((5, 5), (0.38, 3.0), RADIUS, REACH, [Disc(0.9, 3, 0.6)], height=0.8) == [], "somebody stands there"


def test_does_not_reach_through_a_wall() -> None:
    objects = floor(6, 4), box("Wall1", "Wall", 3, 2, 0.1, 4, 2.5), box("Table1", "Table", 3.2, 2, 0.3, 0.8, 0.7)
    assert navigator(*objects).approach((1, 1), (3.1, 2), RADIUS, (0.36, 0.8), height=0.7) == []
    assert navigator(*objects).approach((5, 1), (3.2, 2), RADIUS, (0.36, 0.8), height=0.7) != []


def test_reaches_a_jar_on_the_floor_from_any_side() -> None:
    plan = navigator(floor(6, 6))
    poses = plan.approach((3, 3), (2, 2), RADIUS, REACH, [Disc(2, 2, 0.05)])
    assert len(poses) >= 4
    assert math.dist((poses[0].x, poses[0].y), (2, 2)) < math.dist((3, 3), (2, 2))


def test_finds_room_on_a_table_beside_what_stands_there() -> None:
    table = box("Table1", "Table", 3, 3, 1.2, 0.8, 0.7, RotationZ=0.5)
    plan = navigator(floor(6, 6), table)
    solid = plan.solids["Table1"]
    free, *other_targets = [target for target, _ in edge_targets(solid, 0.1)]
    occupied_spots = [Disc(*target, 0.05) for target in other_targets if math.dist(target, free) > 0.15]
    poses = plan.approach_support((5, 5), solid, RADIUS, REACH, occupied_spots=occupied_spots)
    assert poses
    for pose in poses:
        assert solid.distance(*pose.target) <= -0.06
        assert all(disc.distance(pose.target) > 0.05 for disc in occupied_spots)
        assert plan.path((5, 5), (pose.x, pose.y), RADIUS) is not None


@pytest.mark.parametrize("form", ["Box", "Cylinder", "Polygon"])
def test_points_along_the_edge_of_any_form_are_on_it_and_look_outwards(form: str) -> None:
    values: dict[str, Value] = {"PositionX": 1.0, "PositionY": 2.0, "RotationZ": 0.7, "Shape.Form": form, "Shape.Height": 0.5}
    values |= {"Shape.Width": 1.0, "Shape.Depth": 0.1, "Shape.Radius": 0.4, "Shape.Outline": "0,0 0,1 1,1 1,0"}
    solid = solid_of(Object(name="Shelf1", type="Shelf", values=values), ONTOLOGY)
    assert solid is not None
    targets = list(edge_targets(solid, 0.1))
    assert len(targets) >= 4
    for (x, y), (nx, ny) in targets:
        assert solid.distance(x, y) < -0.03
        assert math.hypot(nx, ny) == pytest.approx(1)
        assert solid.distance(x + 0.01 * nx, y + 0.01 * ny) > solid.distance(x, y) or form == "Box"
        assert solid.distance(x + nx, y + ny) > 0


def office() -> Navigator:
    """45 x 25 m: a corridor in the middle, and twelve rooms with desks on either side of it."""
    objects = [floor(45, 25)]
    for row, (low, high) in enumerate(((0, 11), (14, 25))):
        for i in range(12):
            x, wall, inner = 45 / 12 * i, (low + high) / 2, high if row == 0 else low
            objects.append(box(f"Wall{row}{i}", "Wall", x, wall, 0.1, 11, 2.5))
            objects.append(box(f"Front{row}{i}", "Wall", x + 1.4, inner, 2.8, 0.1, 2.5))
            objects += [box(f"Desk{row}{i}{j}", "Table", x + 2, low + 1.5 + 2 * j, 1.6, 0.8, 0.7) for j in range(5)]
    return navigator(*objects)


def test_ways_through_an_office_are_found() -> None:
    plan = office()
    ways = [((1.0, 0.7), (44.5, 24.3)), ((3.2, 5.0), (38.0, 5.5)), ((22.0, 12.5), (44.3, 0.6))]
    paths = [plan.path(start, goal, RADIUS, [Disc(20, 12.5, 0.3)]) for start, goal in ways]
    assert all(paths)


SPOTS = st.tuples(st.sampled_from((1.0, 2.5, 4.0, 5.5, 7.0)), st.sampled_from((1.0, 3.0, 5.0)))
QUERIES = st.tuples(SPOTS, SPOTS, st.sampled_from((0.2, 0.25, 0.3)), st.sampled_from(((), (Disc(4.0, 2.0, 0.3),), (Disc(4.0, 4.0, 0.3),))))
HALL = (
    floor(8, 6),
    box("Wall1", "Wall", 4.0, 1.2, 0.2, 2.4),
    box("Wall2", "Wall", 4.0, 4.8, 0.2, 2.0),
    box("Table1", "Table", 6.0, 4.0, 0.8, 0.8),
)


@given(st.lists(QUERIES, min_size=2, max_size=14))
@examples(15)
def test_what_was_asked_earlier_does_not_change_an_answer(queries: list[tuple[Point, Point, float, tuple[Disc, ...]]]) -> None:
    experienced = navigator(*HALL)
    for start, goal, radius, discs in queries:
        fresh = navigator(*HALL)
        assert experienced.path(start, goal, radius, discs) == fresh.path(start, goal, radius, discs)
        assert experienced.approach(start, goal, radius, REACH, discs) == fresh.approach(start, goal, radius, REACH, discs)
