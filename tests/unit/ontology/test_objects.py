"""Maps: what is found on them, what changes make of them, and which changes lead from one to another."""

from __future__ import annotations

import pickle

import pytest
from msgspec import structs

from somrs.ontology.objects import (
    Change,
    Fact,
    FactAdded,
    FactRemoved,
    Map,
    Object,
    ObjectAdded,
    ObjectRemoved,
    ValueSet,
    differences,
    objects_of,
)
from somrs.ontology.types import Value

A = Object(name="A", type="Jar", values={"Weight": 1.0, "Label": "one"})
B = Object(name="B", type="Jar", values={"Label": "two"})
C = Object(name="C", type="Room")
ON = Fact("isOn", ("A", "B"))
IN_C = Fact("isPartOf", ("A", "C"))
BETWEEN = Fact("between", ("A", "B", "C"))
SELF = Fact("isNear", ("A", "A"))
MAP = Map([A, B, C], [ON, IN_C, BETWEEN, SELF])


def indexed(map: Map) -> Map:
    """The map when all has been asked of it once."""
    for path, value in (("Weight", 1.0), ("Label", "one")):
        map.with_value(path, value)
    map.of_type("Jar")
    for relation in ("isOn", "isPartOf", "between", "isNear"):
        for place in range(3):
            map.objects_at(relation, place)
    return map


def told(map: Map) -> object:
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
        ([ObjectAdded(structs.replace(A, name="D"))], Map([A, B, C, structs.replace(A, name="D")], MAP.facts())),
        ([ObjectAdded(structs.replace(A, type="Room", values={}))], Map([Object(name="A", type="Room"), B, C], MAP.facts())),
        ([ObjectRemoved("A")], Map([B, C])),
        ([ObjectRemoved("C")], Map([A, B], [ON, SELF])),
        ([ObjectRemoved("D")], MAP),
        ([ValueSet("A", "Weight", 2.0)], Map([structs.replace(A, values={"Weight": 2.0, "Label": "one"}), B, C], MAP.facts())),
        ([ValueSet("B", "Weight", 1.0)], Map([A, structs.replace(B, values={"Weight": 1.0, "Label": "two"}), C], MAP.facts())),
        ([ValueSet("A", "Weight", None)], Map([structs.replace(A, values={"Label": "one"}), B, C], MAP.facts())),
        ([ValueSet("C", "Weight", None)], MAP),
        ([ValueSet("A", "Label", "two"), ValueSet("A", "Label", "one")], MAP),
        ([FactAdded(Fact("isOn", ("C", "B")))], Map([A, B, C], [*MAP.facts(), Fact("isOn", ("C", "B"))])),
        ([FactAdded(Fact("isNew", ("B",)))], Map([A, B, C], [*MAP.facts(), Fact("isNew", ("B",))])),
        ([FactAdded(ON), FactRemoved(ON)], Map([A, B, C], [IN_C, BETWEEN, SELF])),
        ([FactRemoved(BETWEEN), FactRemoved(BETWEEN)], Map([A, B, C], [ON, IN_C, SELF])),
        ([FactRemoved(ON), FactAdded(ON)], MAP),
    ],
)
@pytest.mark.parametrize("asked", [False, True], ids=["fresh", "indexed"])
def test_what_changes_make_of_a_map(changes: list[Change], expected: Map, asked: bool) -> None:
    before = Map([A, B, C], MAP.facts())
    if asked:
        indexed(before)
        assert told(before) == told(MAP)
    after = before.changed(changes)
    assert after == expected
    assert told(after) == told(expected)
    assert before == MAP
    assert told(before) == told(MAP)
    assert before.changed(differences(before, after)) == after
    assert after.changed(differences(after, before)) == before


def test_what_is_found_on_a_map() -> None:
    assert list(MAP.facts()) == [ON, IN_C, BETWEEN, SELF]
    assert list(MAP.facts("isOn")) == [ON]
    assert list(MAP.facts("isNew")) == []
    assert [MAP.has_fact("isOn", arguments) for arguments in (("A", "B"), ("B", "A"))] == [True, False]
    assert not MAP.has_fact("isNew", ("A",))
    assert [MAP.count(relation) for relation in ("isOn", "isNew")] == [1, 0]
    assert [list(MAP.facts_with("between", place, "B")) for place in (0, 1, 3)] == [[], [("A", "B", "C")], []]
    assert list(MAP.objects_at("between", 2)) == ["C"]
    assert list(MAP.facts_about("A")) == [ON, IN_C, BETWEEN, SELF]
    assert list(MAP.facts_about("C")) == [IN_C, BETWEEN]
    assert [list(MAP.parts(name)) for name in ("C", "A")] == [[A], []]
    assert [MAP.whole(name) for name in ("A", "C")] == ["C", None]
    assert list(Map([C], [IN_C]).parts("C")) == []
    assert MAP.roots() == ["B", "C"]
    assert [list(MAP.with_value("Label", label)) for label in ("one", "none")] == [["A"], []]


def test_maps_are_the_same_when_they_say_the_same() -> None:
    assert Map([C, B, A], [SELF, BETWEEN, IN_C, ON]) == MAP
    assert Map([A, B, C], [ON]) != MAP
    assert Map([A, B], MAP.facts()) != MAP
    assert MAP != 3
    again = pickle.loads(pickle.dumps(indexed(Map([A, B, C], MAP.facts()))))
    assert again == MAP
    assert told(again) == told(MAP)


@pytest.mark.parametrize(
    ("before", "after", "changes"),
    [
        (Map([A], [SELF]), Map([A], [SELF]), []),
        (Map([A]), Map([A, B]), [ObjectAdded(B)]),
        (Map([A, B], [ON]), Map([A]), [FactRemoved(ON), ObjectRemoved("B")]),
        (Map([A, B]), Map([A, B], [ON]), [FactAdded(ON)]),
        (Map([A, B], [ON]), Map([A, B]), [FactRemoved(ON)]),
        (Map([B]), Map([structs.replace(B, values={"Label": "three"})]), [ValueSet("B", "Label", "three")]),
        (Map([B]), Map([structs.replace(B, values={})]), [ValueSet("B", "Label", None)]),
        (Map([B]), Map([structs.replace(B, type="Room")]), [ObjectAdded(structs.replace(B, type="Room"))]),
        (Map([Object(name="A", type="T", values={"Open": 1.0})]), Map([Object(name="A", type="T", values={"Open": True})]),
         [ValueSet("A", "Open", True)]),
    ],
)  # fmt: skip
def test_which_changes_lead_from_one_map_to_another(before: Map, after: Map, changes: list[Change]) -> None:
    assert list(differences(before, after)) == changes


def test_facts_of_what_went_and_came_again_are_said_again() -> None:
    before = Map([A, B, C], [ON, IN_C])
    after = before.changed([ObjectRemoved("A"), FactAdded(Fact("isPartOf", ("B", "C")))])
    assert set(differences(before, after)) == {
        FactRemoved(ON),
        FactRemoved(IN_C),
        ObjectRemoved("A"),
        FactAdded(Fact("isPartOf", ("B", "C"))),
    }


@pytest.mark.parametrize(
    ("change", "names"),
    [
        (ObjectAdded(A), ("A",)),
        (ObjectRemoved("A"), ("A",)),
        (ValueSet("A", "Weight", 1.0), ("A",)),
        (FactAdded(BETWEEN), ("A", "B", "C")),
        (FactRemoved(ON), ("A", "B")),
    ],
)
def test_the_objects_of_a_change(change: Change, names: tuple[str, ...]) -> None:
    assert objects_of(change) == names


def test_facts_are_written_as_in_formulas() -> None:
    assert [str(fact) for fact in (ON, BETWEEN, Fact("isNew", ("A",)))] == ["A isOn B", "between(A, B, C)", "isNew(A)"]
