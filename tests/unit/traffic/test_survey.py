"""Surveys of a building that changes: each gives the same as one by somebody who has never seen the building."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.traffic.obstructions import discs_along
from somrs.traffic.state import Position
from somrs.traffic.survey import Survey, Surveyor
from tests.support.examples import examples
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import ONTOLOGY, box, thing

BUILDING = tower((2, 2, 0), (5, 4, 0)).changed(
    [
        ObjectAdded(box("Screen1", "Wall", (4, 4.7, 0), (0.1, 2.6, 2.5))),
        ObjectAdded(box("Door1", "Door", (4, 2.8, 0), (0.1, 1.2, 2.1), Open=True)),
        ObjectAdded(box("Screen2", "Wall", (4, 1.1, 0), (0.1, 2.2, 2.5))),
        ObjectAdded(thing("Jar1", "Jar", 2, 4, 0.0)),
    ]
)
CHANGES: tuple[Change, ...] = (
    ValueSet("Door1", "Open", False),
    ValueSet("Door1", "Open", True),
    ValueSet("Door1", "Mode", "OutOfOrder"),
    ValueSet("Lift1", "Mode", "OutOfOrder"),
    ValueSet("Jar1", "PositionX", 3.0),
    ValueSet("Robot1", "PositionX", 3.0),
    ValueSet("Robot1", "PositionZ", HEIGHT),
    ObjectAdded(box("Shelf1", "Cupboard", (6, 1, 0), (0.6, 0.6, 0.8))),
    ObjectAdded(Object(name="Robot3", type="MobileRobot", values={"PositionX": 6.5, "PositionY": 4.5, "Shape.Radius": 0.4})),
)


def survey_of(map: Map, present: tuple[str, ...] = ()) -> Survey:
    return Survey(map=map, ontology=ONTOLOGY, present=present)


def test_a_surveyor_that_knows_the_building_finds_what_a_new_one_finds() -> None:
    surveyor = Surveyor()

    @examples(8)
    @given(st.lists(st.sampled_from(CHANGES), max_size=3), st.sampled_from([(), ("Robot1",), ("Robot1", "Robot2")]))
    def same(changes: list[Change], present: tuple[str, ...]) -> None:
        map = BUILDING
        for change in changes:
            map = map.changed([change])
        assert surveyor.survey(survey_of(map, present)) == Surveyor().survey(survey_of(map, present))

    same()


def test_the_roadmap_stays_while_nothing_is_built() -> None:
    surveyor = Surveyor()
    first = surveyor.survey(survey_of(BUILDING, ("Robot1", "Robot2")))
    shut = surveyor.survey(survey_of(BUILDING.changed([ValueSet("Door1", "Open", False)]), ("Robot1", "Robot2")))
    assert shut.roadmap is first.roadmap
    assert {*shut.closing.lanes, *shut.closing.places} > {*first.closing.lanes, *first.closing.places}
    assert surveyor.survey(survey_of(BUILDING.changed([ObjectRemoved("Screen1")]))).roadmap != first.roadmap


def test_robots_that_do_not_take_part_stand_in_the_way() -> None:
    surveyor = Surveyor()
    absent = surveyor.survey(survey_of(BUILDING, ("Robot1",)))
    near = {place.name for place in absent.roadmap.places if place.level == 0.0 and math.dist((place.x, place.y), (5, 4)) < 0.4}
    assert near
    assert near <= {*absent.closing.places}
    assert near.isdisjoint(surveyor.survey(survey_of(BUILDING, ("Robot1", "Robot2"))).closing.places)


@given(
    st.lists(
        st.builds(Position, x=st.floats(-5, 5), y=st.floats(-5, 5), level=st.sampled_from([0.0, HEIGHT]), radius=st.floats(0.1, 0.6)),
        min_size=1,
        max_size=4,
    )
)
def test_discs_cover_wherever_a_robot_may_be(positions: list[Position]) -> None:
    discs = [*discs_along(positions)]
    for start, end in zip(positions, positions[1:] or positions, strict=False):
        for share in (0.0, 0.3, 0.5, 0.9, 1.0) if start.level == end.level else (0.0, 1.0):
            x, y = start.x + (end.x - start.x) * share, start.y + (end.y - start.y) * share
            level = start.level if share < 1 else end.level
            assert any(height == level and math.dist((disc.x, disc.y), (x, y)) <= disc.radius / 2 + 1e-9 for height, disc in discs)
