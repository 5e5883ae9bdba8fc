"""Lanes behind which robots would be caught are found; ways back on other lanes and through lifts count."""

from __future__ import annotations

from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.files.loading import load_text
from somrs.space.way_back import OneWayLane, lanes_without_way_back

LOOP = ["A > B : 0", "B > C : 0", "C > A"]


def caught(lanes: Sequence[str], *in_lift: str) -> list[OneWayLane]:
    """`A > B : 0` is a one-way lane of graph 0, `A = B` one in both directions. `in_lift`: the waypoints in the cabin of a lift."""
    objects: dict[str, str] = {}
    facts = [f"{name} isIn Lift1" for name in in_lift]
    for number, text in enumerate(lanes):
        ends, _, graph = text.partition(" : ")
        start, arrow, end = ends.split()
        objects |= {start: "{type: Waypoint, at: [1, 1, 0]}", end: "{type: Waypoint, at: [1, 1, 0]}"}
        values = (", Bidirectional: true" if arrow == "=" else "") + (f", NavigationGraph: '{graph}'" if graph else "")
        objects[f"Lane{number}"] = f"{{type: Lane{values}}}"
        facts += [f"Lane{number} startsAt {start}", f"Lane{number} endsAt {end}"]
    lift = ["    Lift1: {type: Lift, at: [1, 1, 0], Shape: {Form: Box, Width: 2, Depth: 2, Height: 2}}"] if in_lift else []
    parts = [f"    {name}: {text}" for name, text in objects.items()]
    text = "\n".join(
        ["map: M", "objects:", "  M:", "   type: Site", "   parts:", *parts, *lift, "facts:", *(f"  - {fact}" for fact in facts)]
    )
    loaded = load_text(text + "\n")
    assert loaded.map is not None
    return lanes_without_way_back(loaded.map, loaded.ontology)


def test_dead_end_of_a_one_way_lane() -> None:
    (lane,) = caught([*LOOP, "C > D", "D = E"])
    assert (lane.start, lane.behind) == ("C", ("D", "E"))


def test_way_in_needs_no_way_back() -> None:
    assert caught([*LOOP, "Start > A"]) == []


def test_way_back_may_be_another_one() -> None:
    assert caught([*LOOP, "C > D", "D > E", "E > B"]) == []


def test_lanes_of_another_graph_are_no_way_back() -> None:
    assert caught([*LOOP, "C > D : 0", "D > C : 0"]) == []
    assert ("C", ("D",)) in [(lane.start, lane.behind) for lane in caught([*LOOP, "C > D : 0", "D > C : 1"])]


def test_lift_connects_what_is_in_its_cabin() -> None:
    storeys = ["Hall = Below", "Above > Room", "Room > Up"]
    assert [lane.start for lane in caught(storeys, "Below", "Above")] == ["Lift1"]
    assert caught(storeys, "Below", "Above", "Up") == []


@given(lanes=st.lists(st.tuples(st.sampled_from("ABCDEF"), st.sampled_from(">="), st.sampled_from("ABCDEF")), min_size=1, max_size=9))
def test_lane_is_found_where_a_plain_search_finds_no_way_back(lanes: list[tuple[str, str, str]]) -> None:
    found = caught([" ".join(lane) for lane in lanes])
    ways = {(start, end) for start, _, end in lanes} | {(end, start) for start, arrow, end in lanes if arrow == "="}
    names = {name for way in ways for name in way}
    reached = {name: _reached(name, ways) for name in names}
    for lane in found:
        assert {*lane.behind} == reached[lane.behind[0]]
        assert lane.start not in lane.behind
    if not found:  # in each part there is a waypoint from which robots always get back
        homes = {name for name in names if all(name in reached[end] for end in reached[name])}
        assert all(reached[name] & homes for name in names)


def _reached(start: str, ways: set[tuple[str, str]]) -> set[str]:
    waiting, reached = [start], {start}
    while waiting:
        name = waiting.pop()
        ends = {end for first, end in ways if first == name} - reached
        reached |= ends
        waiting += ends
    return reached
