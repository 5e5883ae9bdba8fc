"""Corridors with niches: wherever a robot in the niche leaves room to pass, the roadmap has a place for it there."""

from __future__ import annotations

import math

import pytest

from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.protocol.messages.traffic import TripResult
from somrs.traffic.layout import MARGIN, OpenBuilding, lay_out
from somrs.traffic.planning.pairs import search_pair
from somrs.traffic.roadmap import GAP, NumberedRoadmap, Roadmap, RobotKind
from tests.support.simulator_room import box
from tests.unit.traffic.test_one_in_the_way import Trips

RADIUS = 0.25
LENGTH = 8.0
"""Of the corridor, in metres."""


def corridor(width: float, niche: tuple[float, float, float] | None) -> Roadmap:
    """The roadmap of a corridor that is shut at both ends. `niche`: where its middle is along the corridor, its width and its depth."""
    middle, niche_width, depth = niche or (LENGTH / 2, 0.0, 0.0)
    left_length, right_length = middle - niche_width / 2, LENGTH - middle - niche_width / 2
    walls = [
        ((LENGTH / 2, -0.05), (LENGTH + 0.2, 0.1)),
        ((-0.05, 2.0), (0.1, 6.0)),
        ((LENGTH + 0.05, 2.0), (0.1, 6.0)),
        ((left_length / 2, width + 1.5), (left_length, 3.0)),
        ((LENGTH - right_length / 2, width + 1.5), (right_length, 3.0)),
    ]
    walls += [((middle, width + (depth + 3.0) / 2), (niche_width, 3.0 - depth))] if niche else []
    solids = [box(f"Wall{number}", "Wall", (*point, 0), (*size, 2.5)) for number, (point, size) in enumerate(walls)]
    map = Map([box("Floor", "Floor", (LENGTH / 2, 2.0, -0.1), (LENGTH + 1, 8.0, 0.1)), *solids])
    return lay_out(OpenBuilding(map, upper(), [0.0]), [RobotKind(RADIUS)])


def nearest(roadmap: Roadmap, x: float) -> str:
    return min(roadmap.places, key=lambda place: math.dist((place.x, place.y), (x, 0.4))).name


def can_pass(roadmap: Roadmap) -> bool:
    """Whether a robot comes from one end to the other past one that stands in the corridor."""
    numbered = NumberedRoadmap(roadmap)
    start, blocker, goal = (numbered.number(nearest(roadmap, x)) for x in (0.4, 2.5, LENGTH - 0.4))
    return search_pair(numbered.graph, (start, blocker), goal, (0, 1), 100_000) is not None


@pytest.mark.parametrize("middle", [3.9, 4.3])
@pytest.mark.parametrize(
    ("width", "niche_width", "depth"), [(0.62, 0.8, 0.7), (0.8, 0.7, 0.7), (0.8, 1.2, 0.6), (1.0, 0.7, 0.5), (0.8, 0.8, 1.3)]
)
def test_robots_pass_each_other_at_a_niche_in_which_one_has_room(middle: float, width: float, niche_width: float, depth: float) -> None:
    assert depth + width > 2 * (RADIUS + MARGIN) + 2 * RADIUS + GAP
    assert can_pass(corridor(width, (middle, niche_width, depth)))


def test_robots_do_not_pass_each_other_without_a_niche_or_in_one_that_is_too_shallow() -> None:
    assert not can_pass(corridor(0.8, None))
    assert not can_pass(corridor(0.8, (4.3, 1.2, 0.2)))


def test_one_robot_drives_into_the_niche_and_the_other_one_passes() -> None:
    roadmap = corridor(0.8, (4.3, 0.8, 0.6))
    left_end, right_end = nearest(roadmap, 0.4), nearest(roadmap, LENGTH - 0.4)
    undisturbed, _ = Trips(roadmap, {"First": (left_end, [right_end])}).first_end(60.0)
    trips = Trips(roadmap, {"First": (left_end, [right_end]), "Second": (right_end, [left_end])})
    seconds, ended = trips.first_end(200.0)
    assert ended.result is TripResult.ARRIVED
    assert seconds < 3 * undisturbed
    assert trips.world.run(2 * undisturbed, lambda: not trips.is_open)


def test_one_that_stands_in_the_corridor_makes_room_in_the_niche() -> None:
    roadmap = corridor(0.8, (4.3, 0.8, 0.6))
    start, standing, goal = (nearest(roadmap, x) for x in (0.4, 6.0, LENGTH - 0.4))
    undisturbed, _ = Trips(roadmap, {"First": (start, [goal])}).first_end(60.0)
    seconds, ended = Trips(roadmap, {"First": (start, [goal]), "Second": (standing, [])}).first_end(200.0)
    assert ended.result is TripResult.ARRIVED
    assert seconds < 2.5 * undisturbed
