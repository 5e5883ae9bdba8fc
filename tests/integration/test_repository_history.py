"""Looking back: what happened and how the map was; undoing changes of the map; objects that got other names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from somrs.ontology.naming import Renaming, Section
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import FunctionType, ObjectType, Value
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Define,
    Defined,
    Definitions,
    Events,
    History,
    MapPage,
    MergeObject,
    ReadEvents,
    ReadHistory,
    ReadMap,
    ReadOntology,
    RenameObject,
    Revision,
    Undo,
    Updated,
    UpdateMap,
)
from tests.support.keeper import Keeper, definitions
from tests.support.lab import lab

JAR: dict[str, Value] = {"PositionX": 1.0, "PositionY": 1.1, "PositionZ": 0.7}


@pytest.fixture
def keeper(tmp_path: Path) -> Iterator[Keeper]:
    keeper = Keeper(tmp_path / "repository.sqlite")
    yield keeper
    keeper.settle()
    assert keeper.replica.map == keeper.contents.map
    contents = keeper.contents
    keeper.restart()
    assert (keeper.contents.map, keeper.contents.changed_at) == (contents.map, contents.changed_at)
    keeper.close()


def update(keeper: Keeper, *changes: Change, situation: str | None = None, author: str = "Anna") -> int:
    return keeper.ask(UpdateMap(changes=changes, situation=situation, author=author), Updated).version


# The map at a version


def test_the_map_is_told_as_it_was(keeper: Keeper) -> None:
    past_maps = [keeper.contents.map]
    for body in (
        UpdateMap(situation="Jar1 isOn Table2"),
        UpdateMap(changes=(ObjectAdded(Object(name="Jar9", type="Jar", values=JAR)), FactAdded(Fact("isOn", ("Jar9", "Table1"))))),
        UpdateMap(changes=(ObjectRemoved("Table2"), FactAdded(Fact("isOn", ("Jar1", "Table1"))))),
        UpdateMap(changes=(ValueSet("Jar9", "Color", "Red"), ValueSet("Jar2", "Color", None))),
        UpdateMap(changes=(ObjectRemoved("Jar2"), ObjectAdded(Object(name="Jar2", type="Can", values=JAR)))),
    ):
        keeper.ask(body, Updated)
        past_maps.append(keeper.contents.map)
    for version, map in enumerate(past_maps):
        assert keeper.read_version(version)[1] == map
    keeper.restart()
    assert keeper.read_version(2)[1] == past_maps[2]


def test_the_ontology_is_told_as_it_was_with_the_map(keeper: Keeper) -> None:
    definitions_before = definitions(keeper.contents.ontology)
    keeper.ask(Define(renamed=(Renaming(section=Section.TYPES, name="Jar", to="Pot"),)), Defined)
    update(keeper, ValueSet("Jar1", "Color", "Red"))
    ontology, map = keeper.read_version(0)
    assert definitions(ontology) == definitions_before
    assert map.objects["Jar1"].type == "Jar"
    assert keeper.read_version(2)[1].objects["Jar1"].type == "Pot"


def test_a_large_map_of_the_past_comes_in_pages_of_one_version(tmp_path: Path) -> None:
    ontology, map = lab()
    jars = [Object(name=f"Jar-{n}", type="Jar", values={**JAR, "Label": "x" * (n % 300)}) for n in range(1000)]
    keeper = Keeper(tmp_path / "repository.sqlite", ontology, map.changed(ObjectAdded(jar) for jar in jars))
    map_before = keeper.contents.map
    update(keeper, ObjectRemoved("Jar-500"))
    assert keeper.read_version(0)[1] == map_before
    first = keeper.ask(ReadMap(at_version=0), MapPage)
    update(keeper, ValueSet("Jar-501", "Color", "Red"))
    second = keeper.ask(ReadMap(at_version=0, after=first.objects[-1].name), MapPage)
    assert (first.version, second.version) == (0, 0)
    assert len(first.objects) <= 200
    keeper.close()


@pytest.mark.parametrize("question", [ReadMap(at_version=7), ReadMap(at_version=-1), ReadOntology(at_version=7)])
def test_a_version_that_never_was_is_a_fault(keeper: Keeper, question: ReadMap | ReadOntology) -> None:
    assert "up to version 0" in keeper.ask(question, Fault).text


# What happened


def test_what_happened_is_told_from_either_end(keeper: Keeper) -> None:
    for n in range(5):
        update(keeper, ValueSet("Jar1", "PositionX", float(n + 10)), author=f"Robot{n}")
    keeper.ask(Define(definitions=Definitions(types=(ObjectType(name="Tray", parent="Support"),))), Defined)
    latest = keeper.ask(ReadEvents(limit=2), Events)
    assert [event.version for event in latest.events] == [6, 5]
    assert latest.more
    assert [event.version for event in keeper.events(ReadEvents(before=3))] == [2, 1]
    page = keeper.ask(ReadEvents(after=3, limit=2), Events)
    assert ([event.version for event in page.events], page.more) == ([4, 5], True)
    event = keeper.events(ReadEvents(before=4, limit=1))[0]
    assert (event.version, event.author, event.changes) == (3, "Robot2", (ValueSet("Jar1", "PositionX", 12.0),))
    assert event.before == (ValueSet("Jar1", "PositionX", 11.0),)
    assert keeper.ask(ReadEvents(after=3, before=5), Fault).text


def test_a_brief_account_counts_the_changes(keeper: Keeper) -> None:
    update(keeper, situation="Jar1 isOn Table2")
    keeper.ask(Define(definitions=Definitions(types=(ObjectType(name="Tray", parent="Support"),))), Defined)
    defined, moved = keeper.events(ReadEvents(brief=True))
    assert (moved.changes, moved.before, moved.all_changes, moved.revision) == ((), (), 2, None)
    assert (defined.all_changes, defined.revision) == (0, Revision())
    assert [event.version for event in keeper.events(ReadEvents(ontology=True))] == [2]


def test_an_event_that_is_too_long_for_a_message_is_told_in_part(keeper: Keeper) -> None:
    jars = tuple(ObjectAdded(Object(name=f"Jar-{n}", type="Jar", values={**JAR, "Label": "x" * 100})) for n in range(500))
    update(keeper, *jars)
    (event,) = keeper.events()
    assert event.all_changes == 500
    assert 50 < len(event.changes) < 250
    assert event.before == ()
    assert keeper.ask(ReadHistory(object="Jar-7"), History).events[0].all_changes == 500
    assert keeper.ask(Undo(version=1), Updated) == Updated(version=2)
    assert keeper.contents.map == lab()[1]


# Undoing


@pytest.mark.parametrize(
    "body",
    [
        UpdateMap(situation="Jar1 isOn Table2"),
        UpdateMap(changes=(ObjectAdded(Object(name="Jar9", type="Jar", values=JAR)), FactAdded(Fact("isOn", ("Jar9", "Table1"))))),
        UpdateMap(changes=(ObjectRemoved("Table1"),)),
        UpdateMap(changes=(ValueSet("Jar1", "Color", "Red"), ValueSet("Jar2", "Color", None))),
        UpdateMap(changes=(ObjectRemoved("Jar2"), ObjectAdded(Object(name="Jar2", type="Can", values=JAR)))),
        UpdateMap(changes=(FactRemoved(Fact("isAdjacentTo", ("Room2", "Room1"))),)),
        RenameObject(name="Jar1", to="Krug"),
        RenameObject(name="Storey1", to="Ground"),
        MergeObject(name="Jar1", into="Jar2"),
        MergeObject(name="Table2", into="Table1"),
    ],
)
def test_undoing_brings_back_what_was_and_undoing_that_what_came(keeper: Keeper, body: UpdateMap | RenameObject | MergeObject) -> None:
    map_before = keeper.contents.map
    keeper.ask(body, Updated)
    map_after = keeper.contents.map
    assert map_after != map_before
    assert keeper.ask(Undo(version=1, author="Ben"), Updated) == Updated(version=2)
    assert keeper.contents.map == map_before
    event = keeper.events()[0]
    assert (event.undoes, event.author) == (1, "Ben")
    assert keeper.ask(Undo(version=2), Updated) == Updated(version=3)
    assert keeper.contents.map == map_after


def test_what_has_nothing_to_do_with_it_does_not_stand_in_the_way(keeper: Keeper) -> None:
    update(keeper, ValueSet("Jar1", "Color", "Red"))
    update(keeper, situation="Jar1 isOn Table2 AND Jar1.PositionX = 8 AND Jar1.PositionY = 8")
    keeper.ask(Undo(version=1), Updated)
    assert "Color" not in keeper.contents.map.objects["Jar1"].values
    assert keeper.contents.map.has_fact("isOn", ("Jar1", "Table2"))


@pytest.mark.parametrize(
    ("first_changes", "second_changes", "expected_text"),
    [
        ([ValueSet("Jar1", "Color", "Red")], [ValueSet("Jar1", "Color", "Blue")], "Color was Red after it, and is Blue now"),
        ([ValueSet("Jar1", "Color", "Red")], [ValueSet("Jar1", "Color", None)], "is not given now; Jar1 changed in version 2"),
        ([ValueSet("Jar1", "Color", "Red")], [ObjectRemoved("Jar1")], "Jar1 is not on the map any more"),
        ([ObjectRemoved("Jar1")], [ObjectAdded(Object(name="Jar1", type="Can", values=JAR))], "there is a Jar1 on the map again"),
        ([FactRemoved(Fact("isOn", ("Jar1", "Table1")))], [FactAdded(Fact("isOn", ("Jar1", "Table1")))], "holds again"),
        (
            [ObjectAdded(Object(name="Jar9", type="Jar", values=JAR))],
            [FactAdded(Fact("isOn", ("Jar9", "Table1")))],
            "Jar9 isOn Table1 was added since",
        ),
        ([ObjectAdded(Object(name="Jar9", type="Jar", values=JAR))], [ValueSet("Jar9", "Color", "Red")], "Jar9 was changed since"),
    ],
)
def test_what_was_changed_since_stands_in_the_way(
    keeper: Keeper, first_changes: list[Change], second_changes: list[Change], expected_text: str
) -> None:
    update(keeper, *first_changes)
    update(keeper, *second_changes)
    broken_rules = keeper.broken(Undo(version=1))
    assert any(expected_text in rule.message for rule in broken_rules), broken_rules
    assert all("version 1 cannot be undone" in rule.message for rule in broken_rules)
    keeper.ask(Undo(version=2), Updated)
    keeper.ask(Undo(version=1), Updated)
    assert keeper.contents.map == lab()[1]


def test_what_would_break_a_rule_is_not_undone(keeper: Keeper) -> None:
    update(keeper, FactRemoved(Fact("isOn", ("Jar1", "Table1"))))
    update(keeper, FactAdded(Fact("isIn", ("Jar1", "Table2"))))
    assert [rule.rule for rule in keeper.broken(Undo(version=1))] == ["exclusive"]


# Other names


def test_an_object_is_renamed_with_everything_that_is_said_of_it(keeper: Keeper) -> None:
    assert keeper.ask(RenameObject(name="Table1", to="Bench", author="Anna"), Updated) == Updated(version=1)
    map = keeper.contents.map
    assert "Table1" not in map.objects
    assert map.objects["Bench"].values == lab()[1].objects["Table1"].values
    assert map.has_fact("isOn", ("Jar1", "Bench"))
    assert keeper.events()[0].renamed == (Renaming(section=Section.OBJECTS, name="Table1", to="Bench"),)


def test_the_ontology_goes_on_speaking_of_what_was_renamed(keeper: Keeper) -> None:
    way = FunctionType(name="way", parameters=("Table", "Table"), values={"Table1 Table2": 3.0, "Table2 Table1": 4.0})
    near_type = ObjectType(name="NearJar", parent="Jar")
    keeper.ask(Define(definitions=Definitions(functions=(way,), types=(near_type,))), Defined)
    keeper.ask(RenameObject(name="Table1", to="Bench"), Updated)
    assert keeper.contents.ontology.functions["way"].values == {"Bench Table2": 3.0, "Table2 Bench": 4.0}
    assert keeper.replica.ontology.functions["way"].values == {"Bench Table2": 3.0, "Table2 Bench": 4.0}
    keeper.ask(Undo(version=2), Updated)
    assert keeper.contents.ontology.functions["way"] == way
    assert keeper.contents.map == lab()[1]


def test_nothing_gets_a_name_of_which_the_ontology_says_something(keeper: Keeper) -> None:
    way = FunctionType(name="way", parameters=("Table", "Table"), values={"Table1 Table2": 3.0})
    keeper.ask(Define(definitions=Definitions(functions=(way,))), Defined)
    update(keeper, ObjectRemoved("Table2"))
    assert "the function way refers to another Table2" in keeper.broken(RenameObject(name="Jar2", to="Table2"))[0].message


def test_history_stays_with_what_was_renamed_and_not_with_the_name(keeper: Keeper) -> None:
    update(keeper, ValueSet("Jar1", "Color", "Red"))
    keeper.ask(RenameObject(name="Jar1", to="Krug"), Updated)
    update(keeper, ObjectAdded(Object(name="Jar1", type="Can", values=JAR)))
    update(keeper, ValueSet("Krug", "Color", "Blue"))
    keeper.ask(RenameObject(name="Krug", to="Kanne"), Updated)
    history = keeper.ask(ReadHistory(object="Kanne"), History)
    assert [event.version for event in history.events] == [5, 4, 2, 1]
    assert [event.version for event in keeper.ask(ReadHistory(object="Kanne", limit=3), History).events] == [5, 4, 2]
    assert 3 in [event.version for event in keeper.ask(ReadHistory(object="Jar1"), History).events]


def versions(keeper: Keeper, name: str, limit: int = 100, before: int | None = None) -> list[int]:
    return [event.version for event in keeper.ask(ReadHistory(object=name, limit=limit, before=before), History).events]


def test_history_has_what_happened_to_an_object_under_both_names(keeper: Keeper) -> None:
    update(keeper, ValueSet("Jar1", "Color", "Red"))
    update(keeper, ObjectAdded(Object(name="Jar3", type="Jar", values=JAR)))
    keeper.ask(RenameObject(name="Jar3", to="Jar4"), Updated)
    update(keeper, ValueSet("Jar2", "Color", "Red"))
    keeper.ask(MergeObject(name="Jar4", into="Jar1"), Updated)
    update(keeper, ObjectAdded(Object(name="Jar4", type="Jar", values=JAR)))
    update(keeper, ValueSet("Jar1", "Color", "Blue"))
    assert versions(keeper, "Jar1") == [7, 5, 3, 2, 1], "the new Jar4 is another jar"
    assert versions(keeper, "Jar1", limit=2, before=5) == [3, 2]
    assert versions(keeper, "Jar4", before=6) == [5, 3, 2]
    keeper.ask(RenameObject(name="Jar1", to="Krug"), Updated)
    assert versions(keeper, "Krug", limit=4) == [8, 7, 5, 3]
    keeper.restart(snapshot=True)
    assert versions(keeper, "Krug", limit=4) == [8, 7, 5, 3]


def test_history_forgets_a_merge_that_was_undone(keeper: Keeper) -> None:
    update(keeper, ObjectAdded(Object(name="Jar3", type="Jar", values=JAR)))
    keeper.ask(MergeObject(name="Jar3", into="Jar1"), Updated)
    assert versions(keeper, "Jar1") == [2, 1]
    keeper.ask(Undo(version=2), Updated)
    assert (versions(keeper, "Jar1"), versions(keeper, "Jar3")) == ([2], [3, 2, 1])


def test_a_history_that_is_too_long_for_a_message_is_read_by_pages(keeper: Keeper) -> None:
    for number in range(12):
        update(keeper, ValueSet("Jar1", "Label", str(number) * 20_000))
    pages = [keeper.ask(ReadHistory(object="Jar1"), History)]
    while pages[-1].more:
        pages.append(keeper.ask(ReadHistory(object="Jar1", before=pages[-1].events[-1].version), History))
    assert len(pages) > 1
    assert [event.version for page in pages for event in page.events] == [*range(12, 0, -1)]
    assert not keeper.ask(ReadHistory(object="Jar1", before=1), History).events


def test_undoing_a_new_name_takes_along_what_came_since(keeper: Keeper) -> None:
    keeper.ask(RenameObject(name="Jar1", to="Krug"), Updated)
    update(keeper, situation="Krug isOn Table2")
    keeper.ask(Undo(version=1), Updated)
    assert keeper.contents.map.has_fact("isOn", ("Jar1", "Table2"))


@pytest.mark.parametrize(
    ("rename", "expected_text"),
    [
        (RenameObject(name="Jar7", to="Krug"), "there is no object Jar7"),
        (RenameObject(name="Jar1", to="Jar2"), "an object of this name is on the map already"),
        (RenameObject(name="Jar1", to="a b"), "not a name that formulas can use"),
        (RenameObject(name="Robot1", to="Rob"), "is a device"),
    ],
)
def test_what_cannot_be_renamed(keeper: Keeper, rename: RenameObject, expected_text: str) -> None:
    assert expected_text in keeper.broken(rename)[0].message


def test_a_renaming_minds_what_was_changed_meanwhile(keeper: Keeper) -> None:
    update(keeper, ValueSet("Jar1", "Color", "Red"))
    (rule,) = keeper.broken(RenameObject(name="Jar1", to="Krug", expected_version=0))
    assert rule.rule == "overtaken"
    keeper.ask(RenameObject(name="Jar1", to="Krug", expected_version=1), Updated)
