"""Maps: what is found on them, what changes make of them, and which changes lead from one to another."""

from __future__ import annotations

import pickle

import pytest
from msgspec import structs

from somrs.ontology.differences import differences
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet, objects_of
from somrs.ontology.types import Value

JAR_A = Object(name="A", type="Jar", values={"Weight": 1.0, "Label": "one"})
JAR_B = Object(name="B", type="Jar", values={"Label": "two"})
ROOM_C = Object(name="C", type="Room")
ON_FACT = Fact("isOn", ("A", "B"))
PART_FACT = Fact("isPartOf", ("A", "C"))
BETWEEN_FACT = Fact("between", ("A", "B", "C"))
SELF_FACT = Fact("isNear", ("A", "A"))
MAP = Map([JAR_A, JAR_B, ROOM_C], [ON_FACT, PART_FACT, BETWEEN_FACT, SELF_FACT])


def indexed(map: Map) -> Map:
    """The map when all has been asked of it once."""
    for path, value in (("Weight", 1.0), ("Label", "one")):
        map.with_value(path, value)
    map.of_type("Jar")
    for relation in ("isOn", "isPartOf", "between", "isNear"):
        for place in range(3):
            map.objects_at(relation, place)
    return map


def index_contents(map: Map) -> object:
    """All that the indexes of a map say."""
    return (
        {type: sorted(map.of_type(type)) for type in ("Jar", "Room")},
        {value: sorted(map.with_value(path, value)) for path, value in VALUES},
        {relation: {place: sorted(map.objects_at(relation, place)) for place in range(3)} for relation in RELATIONS},
        {name: sorted(map.facts_about(name), key=str) for name in "ABCD"},
        {relation: map.count(relation) for relation in RELATIONS},
    )


VALUES: list[tuple[str, Value]] = [("Weight", 1.0), ("Weight", 2.0), ("Label", "one"), ("Label", "two")]
RELATIONS = ("isOn", "isPartOf", "between", "isNear", "isNew")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ([], MAP),
        ([ObjectAdded(structs.replace(JAR_A, name="D"))], Map([JAR_A, JAR_B, ROOM_C, structs.replace(JAR_A, name="D")], MAP.facts())),
        ([ObjectAdded(structs.replace(JAR_A, type="Room", values={}))], Map([Object(name="A", type="Room"), JAR_B, ROOM_C], MAP.facts())),
        ([ObjectRemoved("A")], Map([JAR_B, ROOM_C])),
        ([ObjectRemoved("C")], Map([JAR_A, JAR_B], [ON_FACT, SELF_FACT])),
        ([ObjectRemoved("D")], MAP),
        ([ValueSet("A", "Weight", 2.0)], Map([structs.replace(JAR_A, values={"Weight": 2.0, "Label": "one"}), JAR_B, ROOM_C], MAP.facts())),
        ([ValueSet("B", "Weight", 1.0)], Map([JAR_A, structs.replace(JAR_B, values={"Weight": 1.0, "Label": "two"}), ROOM_C], MAP.facts())),
        ([ValueSet("A", "Weight", None)], Map([structs.replace(JAR_A, values={"Label": "one"}), JAR_B, ROOM_C], MAP.facts())),
        ([ValueSet("C", "Weight", None)], MAP),
        ([ValueSet("A", "Label", "two"), ValueSet("A", "Label", "one")], MAP),
        ([FactAdded(Fact("isOn", ("C", "B")))], Map([JAR_A, JAR_B, ROOM_C], [*MAP.facts(), Fact("isOn", ("C", "B"))])),
        ([FactAdded(Fact("isNew", ("B",)))], Map([JAR_A, JAR_B, ROOM_C], [*MAP.facts(), Fact("isNew", ("B",))])),
        ([FactAdded(ON_FACT), FactRemoved(ON_FACT)], Map([JAR_A, JAR_B, ROOM_C], [PART_FACT, BETWEEN_FACT, SELF_FACT])),
        ([FactRemoved(BETWEEN_FACT), FactRemoved(BETWEEN_FACT)], Map([JAR_A, JAR_B, ROOM_C], [ON_FACT, PART_FACT, SELF_FACT])),
        ([FactRemoved(ON_FACT), FactAdded(ON_FACT)], MAP),
    ],
)
@pytest.mark.parametrize("is_indexed", [False, True], ids=["fresh", "indexed"])
def test_what_changes_make_of_a_map(changes: list[Change], expected: Map, is_indexed: bool) -> None:
    map_before = Map([JAR_A, JAR_B, ROOM_C], MAP.facts())
    if is_indexed:
        indexed(map_before)
        assert index_contents(map_before) == index_contents(MAP)
    map_after = map_before.changed(changes)
    assert map_after == expected
    assert index_contents(map_after) == index_contents(expected)
    assert map_before == MAP
    assert index_contents(map_before) == index_contents(MAP)
    assert map_before.changed(differences(map_before, map_after)) == map_after
    assert map_after.changed(differences(map_after, map_before)) == map_before


def test_what_is_found_on_a_map() -> None:
    assert list(MAP.facts()) == [ON_FACT, PART_FACT, BETWEEN_FACT, SELF_FACT]
    assert list(MAP.facts("isOn")) == [ON_FACT]
    assert list(MAP.facts("isNew")) == []
    assert [MAP.has_fact("isOn", arguments) for arguments in (("A", "B"), ("B", "A"))] == [True, False]
    assert not MAP.has_fact("isNew", ("A",))
    assert [MAP.count(relation) for relation in ("isOn", "isNew")] == [1, 0]
    assert [list(MAP.facts_with("between", place, "B")) for place in (0, 1, 3)] == [[], [("A", "B", "C")], []]
    assert list(MAP.objects_at("between", 2)) == ["C"]
    assert list(MAP.facts_about("A")) == [ON_FACT, PART_FACT, BETWEEN_FACT, SELF_FACT]
    assert list(MAP.facts_about("C")) == [PART_FACT, BETWEEN_FACT]
    assert [list(MAP.parts(name)) for name in ("C", "A")] == [[JAR_A], []]
    assert [MAP.whole(name) for name in ("A", "C")] == ["C", None]
    assert list(Map([ROOM_C], [PART_FACT]).parts("C")) == []
    assert MAP.roots() == ["B", "C"]
    assert [list(MAP.with_value("Label", label)) for label in ("one", "none")] == [["A"], []]


def test_maps_are_the_same_when_they_say_the_same() -> None:
    assert Map([ROOM_C, JAR_B, JAR_A], [SELF_FACT, BETWEEN_FACT, PART_FACT, ON_FACT]) == MAP
    assert Map([JAR_A, JAR_B, ROOM_C], [ON_FACT]) != MAP
    assert Map([JAR_A, JAR_B], MAP.facts()) != MAP
    assert MAP != 3
    unpickled_map = pickle.loads(pickle.dumps(indexed(Map([JAR_A, JAR_B, ROOM_C], MAP.facts()))))
    assert unpickled_map == MAP
    assert index_contents(unpickled_map) == index_contents(MAP)


@pytest.mark.parametrize(
    ("map_before", "map_after", "changes"),
    [
        (Map([JAR_A], [SELF_FACT]), Map([JAR_A], [SELF_FACT]), []),
        (Map([JAR_A]), Map([JAR_A, JAR_B]), [ObjectAdded(JAR_B)]),
        (Map([JAR_A, JAR_B], [ON_FACT]), Map([JAR_A]), [FactRemoved(ON_FACT), ObjectRemoved("B")]),
        (Map([JAR_A, JAR_B]), Map([JAR_A, JAR_B], [ON_FACT]), [FactAdded(ON_FACT)]),
        (Map([JAR_A, JAR_B], [ON_FACT]), Map([JAR_A, JAR_B]), [FactRemoved(ON_FACT)]),
        (Map([JAR_B]), Map([structs.replace(JAR_B, values={"Label": "three"})]), [ValueSet("B", "Label", "three")]),
        (Map([JAR_B]), Map([structs.replace(JAR_B, values={})]), [ValueSet("B", "Label", None)]),
        (Map([JAR_B]), Map([structs.replace(JAR_B, type="Room")]), [ObjectAdded(structs.replace(JAR_B, type="Room"))]),
        (Map([Object(name="A", type="T", values={"Open": 1.0})]), Map([Object(name="A", type="T", values={"Open": True})]),
         [ValueSet("A", "Open", True)]),
    ],
)  # fmt: skip
def test_which_changes_lead_from_one_map_to_another(map_before: Map, map_after: Map, changes: list[Change]) -> None:
    assert list(differences(map_before, map_after)) == changes


def test_facts_of_what_went_and_came_again_are_said_again() -> None:
    map_before = Map([JAR_A, JAR_B, ROOM_C], [ON_FACT, PART_FACT])
    map_after = map_before.changed([ObjectRemoved("A"), FactAdded(Fact("isPartOf", ("B", "C")))])
    assert set(differences(map_before, map_after)) == {
        FactRemoved(ON_FACT),
        FactRemoved(PART_FACT),
        ObjectRemoved("A"),
        FactAdded(Fact("isPartOf", ("B", "C"))),
    }


@pytest.mark.parametrize(
    ("change", "names"),
    [
        (ObjectAdded(JAR_A), ("A",)),
        (ObjectRemoved("A"), ("A",)),
        (ValueSet("A", "Weight", 1.0), ("A",)),
        (FactAdded(BETWEEN_FACT), ("A", "B", "C")),
        (FactRemoved(ON_FACT), ("A", "B")),
    ],
)
def test_the_objects_of_a_change(change: Change, names: tuple[str, ...]) -> None:
    assert objects_of(change) == names


def test_facts_are_written_as_in_formulas() -> None:
    assert [str(fact) for fact in (ON_FACT, BETWEEN_FACT, Fact("isNew", ("A",)))] == ["A isOn B", "between(A, B, C)", "isNew(A)"]
