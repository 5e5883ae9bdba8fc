"""Berths: robots stand beside the roadmap, keep others away from there, and come back."""

from __future__ import annotations

import math
from itertools import combinations, count, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import UsageError
from somrs.protocol.messages.traffic import Berth
from somrs.space.lines import point_distance
from somrs.traffic.berths import Berths
from somrs.traffic.planning.graph import FAR, Graph, PrivatePlace
from somrs.traffic.roadmap import Lane, NumberedRoadmap, Place, Roadmap
from somrs.traffic.state import Closed
from somrs.traffic.surroundings import GAP
from tests.support.roadmaps import graphs

SPACING = 0.62
RADIUS = 0.25


def floor(columns: int = 5, rows: int = 4) -> NumberedRoadmap:
    """Places in rows as far apart as their spacing, with lanes between neighbours."""
    places = [Place(name=f"P{column}-{row}", x=column * SPACING, y=row * SPACING) for column, row in product(range(columns), range(rows))]
    lanes = [
        Lane(start=a.name, end=b.name, seconds=1.0)
        for a, b in product(places, places)
        if a is not b and math.dist((a.x, a.y), (b.x, b.y)) < SPACING * 1.01
    ]
    return NumberedRoadmap(Roadmap(places=tuple(places), lanes=tuple(lanes), spacing=SPACING))


def berth(name: str, x: float, y: float, *places: str, radius: float = RADIUS) -> Berth:
    return Berth(name=name, x=x, y=y, radius=radius, places=places)


def test_only_its_owner_goes_to_a_berth() -> None:
    berths = Berths(floor(), [])
    berths.add("R1", berth("R1/1", 0.3, 0.1, "P0-0", "P1-0"))
    number = berths.number("R1/1", "R1")
    beside = berths.number("P0-0", "R1")
    assert number in berths.graph.options(beside, "R1")
    assert number not in berths.graph.options(beside, "R2")
    assert berths.name(number) == "R1/1"
    assert set(berths.graph.successors[number]) == {beside, berths.number("P1-0", "R1")}
    with pytest.raises(UsageError, match="there is no place R1/1"):
        berths.number("R1/1", "R2")


def test_the_way_to_a_berth_is_as_long_as_the_shortest_to_a_place_beside_it_and_on() -> None:
    berths = Berths(floor(), [])
    berths.add("R1", berth("R1/1", 0.3, 0.0, "P0-0", "P1-0"))
    number = berths.number("R1/1", "R1")
    distances = berths.graph.distances(number)
    assert distances[berths.number("P2-0", "R1")] == pytest.approx(1.0 + (SPACING - 0.3) / 0.5)
    assert distances[number] == 0.0


def test_what_is_not_used_any_more_is_forgotten_and_its_number_used_again() -> None:
    berths = Berths(floor(), [])
    berths.add("R1", berth("R1/1", 0.3, 0.0, "P0-0"))
    berths.add("R2", berth("R2/1", 2.3, 0.0, "P4-0"))
    first, second = berths.number("R1/1", "R1"), berths.number("R2/1", "R2")
    assert berths.keep({second})
    with pytest.raises(UsageError, match="there is no place R1/1"):
        berths.number("R1/1", "R1")
    assert berths.number("R2/1", "R2") == second
    berths.add("R3", berth("R3/1", 0.3, 0.0, "P0-0"))
    assert berths.number("R3/1", "R3") == first


def test_a_berth_does_not_move_under_a_robot_that_stands_there() -> None:
    berths = Berths(floor(), [])
    berths.add("R1", berth("R1/1", 0.3, 0.0, "P0-0"))
    berths.add("R1", berth("R1/1", 0.3, 0.0, "P0-0"))
    with pytest.raises(UsageError, match="in use for another point"):
        berths.add("R1", berth("R1/1", 0.4, 0.0, "P0-0"))
    assert [used.berth.x for used in berths.slots if used is not None] == [0.3]


def test_robots_and_places_of_any_names_are_told_apart() -> None:
    floor_places = floor().roadmap.places
    renamed = tuple(Place(name=place.name.replace("P", "R1/P"), x=place.x, y=place.y) for place in floor_places)
    roadmap = NumberedRoadmap(Roadmap(places=renamed, lanes=(), spacing=SPACING))
    berths = Berths(roadmap, [])
    assert berths.name(berths.number("R1/P0-0", "R1")) == "R1/P0-0"
    with pytest.raises(UsageError, match="the name of a place"):
        berths.add("R1", berth("R1/P0-0", 0.1, 0.0, "R1/P0-0"))
    berths.add("R1/x", berth("R1/x/1", 0.3, 0.0, "R1/P0-0"))
    with pytest.raises(UsageError, match="there is no place R1/x/1"):
        berths.number("R1/x/1", "R1")


def test_where_nobody_can_go_meanwhile_does_not_shut_in_those_who_stand_there() -> None:
    """Two robots at a table were in each other's only way out, because a third one was to go to a point between them."""
    berths = Berths(floor(), [])
    berths.add("R1", berth("R1/1", 0.62, 0.93, "P1-1", "P1-2"))
    berths.add("R2", berth("R2/1", 1.24, 0.93, "P2-1", "P2-2"))
    first, second = berths.number("R1/1", "R1"), berths.number("R2/1", "R2")
    exclusions = berths.graph.exclusions[first], berths.graph.exclusions[second]
    berths.add("R3", berth("R3/1", 0.93, 0.93, "P1-1", "P1-2", "P2-1", "P2-2"))
    between = berths.number("R3/1", "R3")
    assert (berths.graph.exclusions[first], berths.graph.exclusions[second]) == ((*exclusions[0], between), (*exclusions[1], between))


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (berth("R2/1", 0, 0, "P0-0"), "has to begin with R1/"),
        (berth("R1/1", math.nan, 0, "P0-0"), "numbers in metres"),
        (berth("R1/1", 0, 0, "P0-0", radius=0), "numbers in metres"),
        (berth("R1/1", 0, 0), "needs a place"),
        (berth("R1/1", 0, 0, "Nowhere"), "no place Nowhere"),
        (berth("R1/1", 1.0, 0, "P0-0"), "the spacing of 0.62 m is the most"),
    ],
)
def test_what_cannot_be_used_is_refused(wrong: Berth, text: str) -> None:
    with pytest.raises(UsageError, match=text):
        Berths(floor(), []).add("R1", wrong)


Line = tuple[tuple[float, float], tuple[float, float]]


@given(st.data())
def test_robots_at_and_on_their_ways_to_berths_do_not_touch(data: st.DataObject) -> None:
    """Wherever two robots stand or drive that hold places which do not exclude each other, their outlines are apart."""
    roadmap = floor()
    berths = Berths(roadmap, [])
    coordinate = st.floats(-0.3, 2.8, allow_nan=False).map(lambda value: round(value, 3))
    for number, robot in zip(count(), ("R1", "R1", "R2", "R3"), strict=False):
        x, y = data.draw(coordinate), data.draw(coordinate)
        near = [place.name for place in roadmap.roadmap.places if math.dist((place.x, place.y), (x, y)) <= SPACING]
        if near:
            berths.add(robot, berth(f"{robot}/{number}", x, y, *near))
    graph, points = berths.graph, _points(berths)
    holdings = [
        (robot, {start, end})
        for robot in ("R1", "R2", "R3")
        for start in range(graph.size)
        if _may_be_at(berths, start, robot)
        for end in (start, *graph.options(start, robot))
    ]
    for (robot, held), (near_robot, near_held) in combinations(data.draw(st.permutations(holdings))[:60], 2):
        excluded = {excluded for place in held for excluded in (place, *graph.exclusions[place])}
        if robot != near_robot and excluded.isdisjoint(near_held):
            gap = _least_distance(tuple(points[place] for place in held), tuple(points[place] for place in near_held))
            assert gap >= 2 * RADIUS + GAP - 1e-6, f"{robot} at {held} is {gap} m away from {near_robot} at {near_held}"


def _may_be_at(berths: Berths, number: int, robot: str) -> bool:
    public = berths.graph.public_size
    used = berths.slots[number - public] if number >= public else None
    return used is None or used.robot == robot


def _points(berths: Berths) -> list[tuple[float, float]]:
    names = [berths.name(number) for number in range(berths.graph.size)]
    known = {used.berth.name: (used.berth.x, used.berth.y) for used in berths.slots if used is not None}
    known |= {f"P{column}-{row}": (column * SPACING, row * SPACING) for column, row in product(range(5), range(4))}
    return [known[name] for name in names]


def _least_distance(line: tuple[tuple[float, float], ...], near_line: tuple[tuple[float, float], ...]) -> float:
    """The least distance between points of two lines, tried out."""
    points, near_points = (np.linspace(complex(*ends[0]), complex(*ends[-1]), 21) for ends in (line, near_line))
    return float(np.abs(np.subtract.outer(points, near_points)).min())


# Distances


def slow_distances(graph: Graph, goal: int, robot: object) -> list[float]:
    """The shortest ways by going through all lanes again and again (Bellman and Ford); none leads through a private place."""
    distances = [0.0 if place == goal else FAR for place in range(graph.size)]
    for _ in range(graph.size):
        for place in range(graph.size):
            for end in graph.options(place, robot):
                if end == goal or end < graph.public_size:
                    distances[place] = min(distances[place], graph.length(place, end) + distances[end])
    return distances


@given(st.data())
def test_distances_are_those_of_the_plain_search(data: st.DataObject) -> None:
    graph = data.draw(graphs())
    places = st.integers(0, graph.size - 1)
    lanes = st.lists(st.tuples(places, st.sampled_from((0.5, 2.0))), min_size=1, max_size=3, unique_by=lambda lane: lane[0])
    private = data.draw(st.lists(st.none() | st.builds(PrivatePlace, st.just("R"), lanes.map(tuple), st.just(())), max_size=3))
    whole = graph.with_private(private)
    closed = data.draw(st.lists(st.integers(0, whole.size - 1), max_size=2))
    for case in (whole, whole.without(closed) if closed else whole):
        for goal in range(case.size):
            expected = slow_distances(case, goal, "R")
            found = case.distances(goal)
            own = [number for number in range(graph.size, case.size) if number != goal]
            for place in range(case.size):
                if place not in own:
                    assert found[place] == pytest.approx(expected[place])


@given(st.lists(st.tuples(st.floats(0, 2.4), st.floats(0, 1.8), st.floats(0.1, 0.5)), max_size=12))
def test_berths_keep_away_whoever_would_touch_them(circles: list[tuple[float, float, float]]) -> None:
    berths, used = Berths(floor(), []), list[Berth]()
    for robot, (x, y, radius) in enumerate(circles):
        near = [place.name for place in berths.roadmap.roadmap.places if math.dist((place.x, place.y), (x, y)) < SPACING]
        used.append(berth(f"R{robot}/1", x, y, *near, radius=radius))
        berths.add(f"R{robot}", used[-1])
    for (robot, one), (other_robot, other) in combinations(enumerate(used), 2):
        numbers = berths.number(one.name, f"R{robot}"), berths.number(other.name, f"R{other_robot}")
        touch = math.dist((one.x, one.y), (other.x, other.y)) < one.radius + other.radius + GAP
        assert (numbers[1] in berths.graph.exclusions[numbers[0]]) is touch
        for place_name in other.places:
            place = berths.roadmap.roadmap.places[berths.roadmap.number(place_name)]
            passes = point_distance((one.x, one.y), (place.x, place.y), (other.x, other.y)) < one.radius + other.radius + GAP
            assert not passes or touch or berths.roadmap.number(place_name) in berths.graph.exclusions[numbers[0]]


@given(st.data())
def test_berths_that_come_and_go_leave_what_would_be_found_anew(data: st.DataObject) -> None:
    roadmap = floor()
    berths = Berths(roadmap, [])
    coordinate = st.floats(0.0, 2.4).map(lambda value: round(value, 2))
    for number in range(data.draw(st.integers(1, 12))):
        x, y, robot = data.draw(coordinate), data.draw(coordinate), data.draw(st.sampled_from(("R1", "R2", "R3")))
        near = [place.name for place in roadmap.roadmap.places if math.dist((place.x, place.y), (x, y)) <= SPACING]
        if data.draw(st.booleans()) and near:
            berths.add(robot, berth(f"{robot}/{number}", x, y, *near))
        elif data.draw(st.booleans()):
            berths.close(Closed(places=tuple(data.draw(st.sets(st.integers(0, 19), max_size=3)))))
        else:
            berths.keep(data.draw(st.sets(st.integers(20, 20 + len(berths.slots)))))
        anew = Berths(roadmap, [*berths.slots], berths._closed)
        assert berths.private_places == anew.private_places
        assert len(berths.private_places) == len(berths.slots)
        assert berths.graph.exclusions == anew.graph.exclusions
        assert berths.graph.successors == anew.graph.successors
