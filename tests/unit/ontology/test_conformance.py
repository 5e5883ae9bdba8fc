"""Maps that break the rules of their ontology, and that an update is checked as thoroughly as a whole map."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.conformance import Violation, touched_objects, violations, violations_of
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files.loading import load, load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import PART_OF, ObjectType, Ontology
from tests.support.examples import examples

DEMO = Path(str(resources.files("somrs.demo").joinpath("data/scenario-1.yaml")))


@pytest.fixture(scope="module")
def demo() -> Map:
    map = load([DEMO]).map
    assert map is not None
    return map


def part(name: str, whole: str) -> FactAdded:
    return FactAdded(Fact(PART_OF, (name, whole)))


# Each update of the demo site, and the rules that it breaks, by subject.
UPDATES: list[tuple[list[Change], set[tuple[str, str]]]] = [
    ([ValueSet("Jar002", "Weight", 0.4)], set()),
    ([FactRemoved(Fact("isOn", ("Jar002", "Cupboard001"))), FactAdded(Fact("isOn", ("Jar002", "Platform001")))], set()),
    ([FactAdded(Fact("isOn", ("Jar002", "Entrance"))), FactRemoved(Fact("isOn", ("Jar002", "Cupboard001")))], set()),
    ([ObjectRemoved("Jar002")], set()),
    ([ValueSet("Jar002", "Weight", 7.0)], {("Jar002", "constraint")}),
    ([ValueSet("Jar002", "Weight", "heavy")], {("Jar002", "value")}),
    ([ValueSet("Jar002", "Weight", True)], {("Jar002", "value")}),
    ([ValueSet("Jar002", "Weight", float("nan"))], {("Jar002", "value")}),
    ([ValueSet("Robot1", "Charge", 120.0)], {("Robot1", "value")}),
    ([ValueSet("Robot1", "Color", "Pink")], {("Robot1", "value")}),
    ([ValueSet("Robot1", "Elevation", 1.0)], {("Robot1", "unknown-attribute")}),
    ([ValueSet("Door001", "Open", "yes")], {("Door001", "value")}),
    ([ValueSet("Jar002", "PositionX", None)], {("Jar002", "required")}),
    ([ValueSet("Table001", "Shape.Width", None)], {("Table001", "constraint")}),
    ([ObjectRemoved("WallWest"), ObjectRemoved("WallNorth")], {("Room001", "parts")}),
    ([ObjectRemoved("Floor001")], {("Room001", "parts")}),
    ([ObjectRemoved("Storey001")], {("Building001", "parts"), ("Room001", "root"), ("Room002", "root")}),
    ([ObjectAdded(Object(name="X", type="Jra"))], {("X", "unknown-type")}),
    ([ObjectAdded(Object(name="X", type="Room"))], {("X", "root")}),
    ([ObjectAdded(Object(name="X", type="Room")), part("X", "Storey001")], set()),
    (  # of both wholes
        [FactAdded(Fact(PART_OF, ("Floor001", "Building001"))), ObjectAdded(Object(name="Floor001", type="Place"))],
        {("Floor001 isPartOf Building001", "functional"), ("Floor001", "required"), ("Room001", "parts")},
    ),
    ([FactAdded(Fact("isIn", ("Jar002", "Cupboard001")))], {("Jar002 isIn Cupboard001", "exclusive")}),
    ([FactAdded(Fact("isOn", ("Jar002", "Table001")))], {("Jar002 isOn Table001", "functional")}),
    ([FactAdded(Fact("isAt", ("Jar003", "Entrance")))], {("Jar003 isAt Entrance", "relation-types")}),
    ([FactAdded(Fact("isOn", ("Robot1", "Nowhere")))], {("Robot1 isOn Nowhere", "unknown-object")}),
    ([FactAdded(Fact("likes", ("Robot1", "Robot2")))], {("Robot1 likes Robot2", "unknown-relation")}),
    ([FactAdded(Fact("connects", ("Door001", "Room001")))], {("Door001 connects Room001", "relation-types")}),
    ([part("Building001", "Room001")], {("Building001", "cycle"), ("Room001", "parts")}),  # all floors are below all
]


def subjects_and_rules(found_violations: list[Violation]) -> set[tuple[str, str]]:
    return {(violation.subject, violation.rule) for violation in found_violations}


@pytest.mark.parametrize(("changes", "expected"), UPDATES, ids=lambda value: str(sorted(value) if isinstance(value, set) else value)[:60])
def test_update_breaks_just_these_rules(demo: Map, changes: list[Change], expected: set[tuple[str, str]]) -> None:
    map_after = demo.changed(changes)
    assert subjects_and_rules(violations_of(map_after, upper(2), touched_objects(demo, changes))) == expected
    assert subjects_and_rules(violations(map_after, upper(2))) - {("map", "root")} == expected


def some_changes(map: Map) -> st.SearchStrategy[list[Change]]:
    names = st.sampled_from([*map.objects, "Ghost"])
    known_names = st.sampled_from([*map.objects])
    facts = st.builds(
        lambda relation, first_name, second_name: Fact(relation, (first_name, second_name)),
        st.sampled_from(["isOn", "isIn", PART_OF, "isAdjacentTo"]),
        names,
        names,
    )
    values = st.sampled_from([0.1, 9.0, -1.0, "Red", True, None])
    paths = st.sampled_from(["Weight", "PositionX", "Color", "Shape.Width", "Shape.Form", "Speed", "Nonsense"])
    return st.lists(
        st.one_of(
            st.builds(ValueSet, known_names, paths, values),
            facts.map(FactAdded),
            st.sampled_from([*map.facts()]).map(FactRemoved),
            st.builds(
                lambda name, type: ObjectAdded(Object(name=name, type=type)), names, st.sampled_from(["Jar", "Room", "Place", "Jra"])
            ),
        ),
        min_size=1,
        max_size=3,
    )


@given(st.data())
@examples(40)
def test_checking_what_an_update_touched_finds_what_checking_all_finds(demo: Map, data: st.DataObject) -> None:
    changes = data.draw(some_changes(demo))
    if data.draw(st.booleans()):
        changes = [*changes, ObjectRemoved(data.draw(st.sampled_from([*demo.objects])))]
    map_after = demo.changed(changes)
    # That the map lacks a root at all is said of the map, not of an object.
    expected = subjects_and_rules(violations(map_after, upper(2))) - {("map", "root")}
    assert subjects_and_rules(violations_of(map_after, upper(2), touched_objects(demo, changes))) == expected
    assert subjects_and_rules(violations_of(map_after, upper(2), touched_objects(demo, changes), demo)) == expected, (
        "what did not change is in order"
    )


def test_constraint_speaks_of_sub_objects(demo: Map) -> None:
    ontology = load_text(
        "upper: 2\ntypes:\n  LowRoom:\n    parent: Room\n    constraints:\n"
        '      - {formula: "?Wall: Wall isPartOf ?Self AND ?Wall.Shape.Height < 2", doc: A low room has a low wall}\n'
    ).ontology
    low = demo.changed([ObjectAdded(Object(name="Cellar", type="LowRoom")), part("Cellar", "Storey001")])
    assert [str(v) for v in violations(low, ontology)] == ["Cellar: A low room has a low wall; this one does not [constraint]"]
    wall = Object(
        name="LowWall",
        type="Wall",
        values={
            "PositionX": 0.0,
            "PositionY": 0.0,
            "PositionZ": 0.0,
            "Shape.Form": "Box",
            "Shape.Width": 1.0,
            "Shape.Depth": 0.1,
            "Shape.Height": 1.5,
        },
    )
    changes: list[Change] = [ObjectAdded(wall), part("LowWall", "Cellar")]
    mended = low.changed(changes)
    assert violations(mended, ontology) == []
    raised = mended.changed([ValueSet("LowWall", "Shape.Height", 2.5)])
    assert subjects_and_rules(violations_of(raised, ontology, ["LowWall"])) == {("Cellar", "constraint")}
    assert subjects_and_rules(violations_of(raised, ontology, ["LowWall"], mended)) == {("Cellar", "constraint")}


def test_ontology_made_by_a_program_is_checked_too() -> None:
    broken = upper().extended([ObjectType(name="Vase", parent="Pot", required=("Glaze",))])
    found_problems = [(v.section, v.subject, v.path, v.message) for v in ontology_violations(broken)]
    assert [item[:3] for item in found_problems] == [("types", "Vase", "parent"), ("types", "Vase", "required.0")]
    assert "no type is called Pot" in found_problems[0][3]
    assert "no attribute is called Glaze" in found_problems[1][3]
    assert ontology_violations(Ontology()) == []
