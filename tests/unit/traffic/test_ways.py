"""How far robots drive on a roadmap, through which doors and lifts, against a plain search on a raw grid."""

from __future__ import annotations

import heapq
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Value
from somrs.space.clearance import Disc
from somrs.space.solids import Point, Solid, solid_of
from somrs.traffic.layout import MARGIN, OpenBuilding, lay_out
from somrs.traffic.roadmap import NumberedRoadmap, RobotKind, spacing_for
from somrs.traffic.ways import Closed, Goal, Stands, Way, Ways
from tests.support.examples import examples

ONTOLOGY = upper()
RADIUS = 0.25


def box(name: str, type: str, x: float, y: float, width: float, depth: float, height: float = 1.0, z: float = 0.0, **more: Value) -> Object:
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": width, "Shape.Depth": depth, "Shape.Height": height}
    return Object(name=name, type=type, values={"PositionX": x, "PositionY": y, "PositionZ": z, **shape, **more})


def floor(width: float, depth: float) -> Object:
    return box("Floor1", "Floor", width / 2, depth / 2, width, depth, 0.1, -0.1)


def ways_of(*objects: Object) -> Ways:
    building = OpenBuilding(Map(objects), ONTOLOGY, (0.0,))
    return Ways(NumberedRoadmap(lay_out(building, (RobotKind(RADIUS),))), building.spaces, building.doors)


def two_rooms(*more: Object) -> Ways:
    """Two rooms of 4 m by 4 m with a wall between them, in which there are two doors."""
    walls = [box(f"Wall{i}", "Wall", 4.05, y, 0.1, depth, 2.5) for i, (y, depth) in enumerate(((0.25, 0.5), (2.0, 1.2), (3.75, 0.5)))]
    doors = [box(f"Door{i}", "Door", 4.05, y, 0.1, 0.9, 2.0, Open=False) for i, y in ((1, 0.95), (2, 3.05))]
    return ways_of(floor(8.1, 4), *walls, *doors, *more)


def goal(ways: Ways, *points: Point, costs: tuple[float, ...] = ()) -> Goal:
    found = ways.goal(
        (points, costs), 0.0, RobotKind(RADIUS), lambda _: Stands(np.array(points, dtype=float), np.array(costs or (0.0,) * len(points)))
    )
    assert found is not None
    return found


def way(ways: Ways, start: Point, *points: Point, closed: Closed = Closed()) -> Way | None:
    return ways.way(start, 0.0, goal(ways, *points), closed, 0.8)


def without_memory(ways: Ways) -> Ways:
    """The same ways, of which nothing is kept yet."""
    return Ways(ways._roadmap, ways._spaces, ways.doors)


def shut(*doors: str) -> Closed:
    return Closed(doors=frozenset(doors))


def test_a_way_leads_through_the_nearer_door_or_through_the_other_one_if_that_is_shut() -> None:
    ways = two_rooms()
    near, far = way(ways, (1, 1), (7, 1)), way(ways, (1, 1), (7, 1), closed=shut("Door1"))
    assert near is not None
    assert far is not None
    assert [{*near.doors}, {*far.doors}] == [{"Door1"}, {"Door2"}]
    assert 6 <= near.length < 6.5
    assert far.length > near.length + 1
    assert way(ways, (1, 1), (7, 1), closed=shut("Door1", "Door2")) is None
    inside = way(ways, (1, 1), (3, 3), closed=shut("Door1", "Door2"))
    assert inside is not None
    assert inside.doors == frozenset()


def test_a_robot_beside_a_shut_door_does_not_drive_through_it_on_its_first_or_last_metre() -> None:
    ways = two_rooms()
    start, end = (3.7, 0.95), (4.4, 0.95)
    straight = way(ways, start, end)
    assert straight is not None
    assert straight.doors == {"Door1"}
    assert straight.length < 0.8
    around = way(ways, start, end, closed=shut("Door1"))
    assert around is not None
    assert around.doors == {"Door2"}
    assert around.length > 4


def test_a_robot_that_cannot_move_closes_a_doorway_and_is_driven_around_in_a_room() -> None:
    ways = two_rooms()
    standing = Closed(doors=frozenset({"Door2"}), standing=((0.0, Disc(4.05, 0.95, 0.25)),))
    assert way(ways, (1, 1), (7, 1), closed=standing) is None
    standing = Closed(standing=((0.0, Disc(2.0, 1.0, 0.25)),))
    free, around = way(ways, (1, 1), (3, 1)), way(ways, (1, 1), (3, 1), closed=standing)
    assert free is not None
    assert around is not None
    assert free.length + 0.2 < around.length < free.length + 2
    assert way(ways, (1, 1), (3, 1), closed=Closed(standing=((3.0, Disc(2.0, 1.0, 0.25)),))) == free, "on another floor"


def test_of_several_stands_the_one_is_chosen_that_costs_least_with_the_way_to_it() -> None:
    ways = two_rooms()
    best = ways.way((1, 1), 0.0, goal(ways, (2, 3), (3, 1), costs=(0.0, 1.5)), Closed(), 0.8)
    near = ways.way((3.2, 1), 0.0, goal(ways, (2, 3), (3, 1), costs=(0.0, 1.5)), Closed(), 0.8)
    assert best is not None
    assert near is not None
    assert (best.end, near.end) == ((2, 3), (3, 1))
    assert near.length < 0.3, "what a stand costs is no part of the way"


def test_there_is_no_way_to_a_point_where_no_robot_can_be() -> None:
    ways = two_rooms(box("Table1", "Table", 7, 2, 1, 1))
    assert way(ways, (1, 1), (30, 30)) is None
    assert ways.goal("", 5.0, RobotKind(RADIUS), lambda _: Stands(np.zeros((0, 2)), np.zeros(0))) is None, "there is no such floor"
    assert ways.way((1, 1), 5.0, goal(ways, (3, 1)), Closed(), 0.8) is None


def plain_distance(solids: list[Solid], size: Point, start: Point, end: Point, radius: float, cell: float = 0.1) -> float:
    """The twin: Dijkstra over the cells of a rectangular floor in which the robot meets nothing; infinite without a way."""
    columns, rows = round(size[0] / cell), round(size[1] / cell)

    def free(c: int, r: int) -> bool:
        x, y = c * cell, r * cell
        return min(x, y, size[0] - x, size[1] - y) >= radius and all(solid.distance(x, y) >= radius for solid in solids)

    open_cells = {(c, r) for c in range(columns + 1) for r in range(rows + 1) if free(c, r)}
    begin, goal = ((round(p[0] / cell), round(p[1] / cell)) for p in (start, end))
    costs, queue = {begin: 0.0}, [(0.0, begin)]
    while queue:
        cost, (c, r) = heapq.heappop(queue)
        if (c, r) == goal:
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


@examples(20)
@given(st.lists(obstacles, max_size=6, unique_by=lambda object: object.name))
def test_finds_a_way_where_the_plain_search_does_and_not_much_longer(things: list[Object]) -> None:
    size, start, end = (6.0, 4.0), (0.5, 0.5), (5.5, 3.5)
    ways = ways_of(floor(*size), *things)
    space = ways.space(0.0)
    assert space is not None
    if not (space.free(start, RADIUS + MARGIN) and space.free(end, RADIUS + MARGIN)):
        return
    solids = [solid for thing in things if (solid := solid_of(thing, ONTOLOGY)) is not None]
    found = way(ways, start, end)
    wide = plain_distance(solids, size, start, end, RADIUS + 0.1)
    if found is None:
        assert wide == math.inf
        return
    assert found.end == end
    # Lanes lead in six directions, at most 15 % longer than straight, and the plain way is up to 8 % longer itself. Where there is no room
    # for the lattice, a lane may lead aside by its length.
    if wide < math.inf:
        assert found.length <= 1.16 * wide + 4 * spacing_for(RADIUS)
    narrow = plain_distance(solids, size, start, end, RADIUS - 0.08)
    assert found.length >= narrow / 1.09 - 0.15


SPOTS = st.tuples(st.sampled_from((1.0, 2.5, 4.4, 5.5, 7.0)), st.sampled_from((1.0, 2.0, 3.0)))
CLOSED = st.sampled_from((Closed(), shut("Door1"), shut("Door2"), Closed(standing=((0.0, Disc(2.5, 1.5, 0.3)),))))


@given(st.lists(st.tuples(SPOTS, SPOTS, CLOSED), min_size=2, max_size=14))
@examples(15)
def test_what_was_asked_earlier_does_not_change_an_answer(queries: list[tuple[Point, Point, Closed]]) -> None:
    experienced = two_rooms()
    for start, end, closed in queries:
        assert way(experienced, start, end, closed=closed) == way(two_rooms(), start, end, closed=closed)


STARTS = ((1.0, 1.0), (3.0, 3.0), (7.0, 2.0))
GOALS = ((1.5, 3.0), (6.0, 1.0))
CLOSURES = (shut(), shut("Door1"), shut("Door2"), shut("Door1", "Door2"), Closed(standing=((0.0, Disc(2.0, 2.0, 0.3)),)))
QUESTIONS = st.tuples(st.sampled_from(STARTS), st.sampled_from(GOALS), st.sampled_from(CLOSURES))


@examples(30)
@given(st.lists(QUESTIONS, min_size=2, max_size=12))
def test_ways_that_are_kept_are_those_of_a_new_search(questions: list[tuple[Point, Point, Closed]]) -> None:
    kept = two_rooms()
    for start, end, closed in questions:
        assert way(kept, start, end, closed=closed) == way(without_memory(kept), start, end, closed=closed)
