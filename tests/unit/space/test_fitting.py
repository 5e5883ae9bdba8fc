"""What is put on the map fits: compared with a search for a point that is in both."""

from __future__ import annotations

import itertools
import math

from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.space.findings import find_mistakes
from somrs.space.fitting import misfits, overlap
from somrs.space.solids import Solid, solid_of
from tests.support.simulator_room import ONTOLOGY, box, room

coordinates = st.floats(-1.5, 1.5).map(lambda metres: round(metres, 2))


def table(x: float, y: float, width: float = 1.2, depth: float = 0.6) -> Solid:
    solid = solid_of(box("Table9", "Table", (x, y, 0), (width, depth, 0.7)), ONTOLOGY)
    assert solid is not None
    return solid


def have_common_point(first: Solid, second: Solid, margin: float) -> bool:
    """The slow twin: whether a point of a fine grid is deeper than the margin in both."""
    steps = range(-80, 81)
    points = ((first.x + i / 40, first.y + j / 40) for i, j in itertools.product(steps, steps))
    return any(first.distance(*point) < -margin and second.distance(*point) < -margin for point in points)


@given(x=coordinates, y=coordinates, width=st.sampled_from((0.2, 0.6, 1.2)))
def test_what_has_a_point_in_common_overlaps(x: float, y: float, width: float) -> None:
    first, second = table(0, 0), table(x, y, width, 0.1)
    depth = overlap(first, second)
    assert depth == overlap(second, first)
    if have_common_point(first, second, 0.03):
        assert depth > 0.02
    if depth == 0.0:
        assert not have_common_point(first, second, 0.0)


def test_what_is_beside_the_outline_of_a_polygon_fits_where_its_position_is() -> None:
    corner_desk = Object(
        name="Desk9",
        type="Table",
        values={
            "PositionX": 3.0,
            "PositionY": 2.0,
            "Shape.Form": "Polygon",
            "Shape.Height": 0.7,
            "Shape.Outline": "-2,-2 2,-2 2,-1 -1,-1 -1,2 -2,2",
        },
    )
    desk = solid_of(corner_desk, ONTOLOGY)
    assert desk is not None
    assert overlap(desk, table(3, 2)) == 0.0
    assert overlap(desk, table(2, 0.5)) > 0.05


def test_a_robot_fits_in_a_lift_and_not_in_another_robot() -> None:
    lift = box("Lift9", "Lift", (4, 3, 0), (2, 2, 2.4))
    map = room((4, 3, 0), (4.3, 3, 0))
    put = Map([*map.objects.values(), lift], map.facts())
    assert [(name, obstacle) for name, obstacle, _ in misfits(put, ONTOLOGY, ["Robot1", "Lift9"])] == [("Robot1", "Robot2")]
    (finding,) = {mistake.subject: mistake for mistake in find_mistakes(put, ONTOLOGY) if mistake.subject == "Robot2"}.values()
    assert (finding.rule, "deep in Robot1; move it away" in finding.message) == ("in-wall", True)


def test_a_table_fits_neither_in_a_wall_nor_on_a_robot() -> None:
    map = room((2, 2, 0), (6, 2, math.pi))
    for (x, y), expected in (((2.1, 2.1), "Robot1"), ((4, 2), None)):
        put = Map([*map.objects.values(), box("Table9", "Table", (x, y, 0), (1.2, 0.6, 0.7))], map.facts())
        obstacles = [obstacle for name, obstacle, _ in misfits(put, ONTOLOGY, ["Table9"])]
        assert obstacles == ([expected] if expected else [])
    wall = next(solid for object in map.objects.values() if object.type == "Wall" and (solid := solid_of(object, ONTOLOGY)))
    put = Map([*map.objects.values(), box("Table9", "Table", (wall.x, wall.y, 0), (1.2, 0.6, 0.7))], map.facts())
    assert wall.name in [obstacle for _, obstacle, _ in misfits(put, ONTOLOGY, ["Table9"])]
