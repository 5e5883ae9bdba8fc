"""The Repository's files of before: everything in them is gone on with, or they stay as they are."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from somrs.errors import UsageError
from somrs.kernel.component import Started
from somrs.ontology.naming import DefinitionKey, Section
from somrs.ontology.objects import Fact, Object, ValueSet
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Events,
    History,
    MapSubscribed,
    ReadEvents,
    ReadHistory,
    ReadMap,
    Rejected,
    Undo,
    Updated,
    UpdateMap,
)
from somrs.repository.state import DefinitionChange
from somrs.storage.repository_formats import MIGRATIONS
from somrs.storage.repository_store import KIND
from tests.support.keeper import Keeper, definitions
from tests.support.lab import REPOSITORY, lab, sent_bodies
from tests.support.paths import ROOT

THIRD = (ROOT / "tests/data/repository-format-3.sql").read_text()
"""A file that SO-MRS wrote in the third format: seven versions, rejected requests, two who follow."""

SECOND = """
UPDATE definitions SET document = replace(document, 'somrs.devices.person.device:', 'somrs.devices.person:');
UPDATE definitions SET document = replace(document, 'somrs.devices.simulator.drivers.', 'somrs.devices.simulator.');
PRAGMA user_version = 2;
"""
"""What makes one of the second format of it, with the drivers where they were."""

FIRST = """
DROP TABLE revised; DROP TABLE renamed; DROP INDEX revisions;
ALTER TABLE events DROP COLUMN before; ALTER TABLE events DROP COLUMN renamed; ALTER TABLE events DROP COLUMN undoes;
ALTER TABLE events ADD COLUMN definitions TEXT;
UPDATE events SET definitions = json_extract(revision, '$.after');
ALTER TABLE events DROP COLUMN revision;
PRAGMA user_version = 1;
"""
"""What makes one of the first format of that, in which events were kept without what was before them."""


def create_file(path: Path, *scripts: str) -> Path:
    db = sqlite3.connect(path)
    for script in scripts:
        db.executescript(script)
    db.close()
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "repository.sqlite"


def id_of(number: int) -> str:
    return f"urn:uuid:00000000-0000-0000-0000-{number:012}"


def test_everything_in_a_file_of_the_third_format_is_gone_on_with(path: Path) -> None:
    keeper = Keeper(create_file(path, THIRD))
    contents, (ontology, map) = keeper.contents, lab()
    assert (contents.version, contents.since) == (7, 0)
    jar = Object(name="Krug", type="Jar", values={"PositionX": 1.0, "PositionY": 1.1, "PositionZ": 0.7, "Label": "Krug „Ö“; \n"})
    assert contents.map.objects == {**map.objects, "Krug": jar}
    assert {*contents.map.facts()} - {*map.facts()} == {Fact("isOn", ("Jar1", "Table2")), Fact("isOn", ("Krug", "Table1"))}
    assert {*map.facts()} - {*contents.map.facts()} == {Fact("isOn", ("Jar1", "Table1"))}
    assert definitions(contents.ontology).keys() - definitions(ontology).keys() == {("ObjectType", "Plate")}
    assert contents.changed_at == {"Jar1": 1, "Jar2": 6, "Jar9": 4, "Krug": 4, "Table1": 6, "Table2": 1}
    assert contents.last_change(DefinitionKey(section=Section.TYPES, name="Plate")) == DefinitionChange(version=7, author="Ben")
    assert contents.last_change(DefinitionKey(section=Section.TYPES, name="Tray")) == DefinitionChange(version=7, author="Ben")
    assert [*contents.answered] == [id_of(number) for number in (1, 3, 4, 5, 6, 7, 8, 9, 11)]
    assert isinstance(keeper.ask(UpdateMap(situation="Jar7 isOn Table2"), Rejected, identity=id_of(5)), Rejected)
    assert keeper.ask(UpdateMap(situation="Jar1 isOn Table2"), Updated, identity=id_of(1)) == Updated(version=1)
    assert {
        address: subscription.until for address, subscription in contents.subscriptions.items() if address != "http://here/follower"
    } == {
        "http://follower": 1602.0,
        "http://other": 1040.0,
    }
    greetings = sent_bodies(list(keeper.effects(Started(REPOSITORY))), MapSubscribed)
    assert MapSubscribed(version=7, until=1602.0) in greetings
    keeper.close()


def test_a_file_of_the_third_format_has_its_history_and_gets_more(path: Path) -> None:
    keeper = Keeper(create_file(path, THIRD))
    assert [event.version for event in keeper.events()] == [7, 6, 5, 4, 3, 2, 1]
    assert [event.version for event in keeper.ask(ReadHistory(object="Krug"), History).events] == [4, 2]
    assert keeper.read_version(0)[1] == lab()[1]
    keeper.ask(Undo(version=7), object)
    assert ("ObjectType", "Tray") in definitions(keeper.contents.ontology)
    keeper.restart()
    assert keeper.contents.version == 8
    assert keeper.read_version(7)[0].types["Plate"].parent == "Support"
    keeper.restart(snapshot=True)
    assert [event.version for event in keeper.events(ReadEvents(limit=2))] == [8, 7]
    keeper.close()


def test_a_new_file_has_the_tables_that_an_old_one_gets(path: Path, tmp_path: Path) -> None:
    Keeper(create_file(path, THIRD)).close()
    Keeper(new := tmp_path / "new.sqlite").close()
    assert tables(path) == tables(new)
    assert versions(path) == versions(new) == (KIND.application, KIND.version)


def tables(path: Path) -> set[str]:
    with sqlite3.connect(path) as db:
        table_names = {name for (name,) in db.execute("SELECT name FROM sqlite_schema WHERE name NOT LIKE 'sqlite_%'")}
    db.close()
    return table_names


def versions(path: Path) -> tuple[int, int]:
    with sqlite3.connect(path) as db:
        ((application,), (version,)) = (db.execute(f"PRAGMA {name}").fetchone() for name in ("application_id", "user_version"))
    db.close()
    return application, version


def test_a_file_in_which_there_was_nothing_yet_begins_with_what_is_given(path: Path) -> None:
    empty = "".join(f"DELETE FROM {name};" for name in ("definitions", "objects", "facts", "events", "touched", "renamed", "answered"))
    keeper = Keeper(create_file(path, THIRD, empty))
    assert (keeper.contents.version, keeper.contents.map) == (0, lab()[1])
    keeper.close()


@pytest.mark.parametrize("scripts", [(THIRD,), (THIRD, SECOND), (THIRD, SECOND, FIRST)], ids=["third", "second", "first"])
def test_a_file_that_cannot_be_brought_up_to_date_stays_as_it_was(path: Path, scripts: tuple[str, ...]) -> None:
    broken = "UPDATE objects SET document = '{\"name\": 1}' WHERE name = 'Jar2';"
    create_file(path, *scripts, broken)
    dump_before = dump(path)
    with pytest.raises(UsageError, match="restore a backup"):
        Keeper(path)
    assert dump(path) == dump_before


def dump(path: Path) -> list[object]:
    with sqlite3.connect(path) as db:
        lines = [*versions(path), *db.iterdump()]
    db.close()
    return lines


def test_a_file_of_the_second_format_knows_where_the_drivers_are(path: Path) -> None:
    keeper, third = Keeper(create_file(path, THIRD, SECOND)), Keeper(create_file(path.with_name("third.sqlite"), THIRD))
    assert [*keeper.contents.ontology] == [*third.contents.ontology]
    assert "somrs.devices.simulator.drivers" in str([*keeper.contents.ontology])
    keeper.close()
    third.close()


def test_a_file_of_the_first_format_is_gone_on_with(path: Path) -> None:
    third = Keeper(create_file(path.with_name("third.sqlite"), THIRD))
    third_contents = third.contents
    third.close()
    keeper = Keeper(create_file(path, THIRD, SECOND, FIRST))
    contents = keeper.contents
    assert ([*contents.ontology], contents.map, contents.version) == ([*third_contents.ontology], third_contents.map, 7)
    assert contents.since == 7
    plate = DefinitionKey(section=Section.TYPES, name="Plate")
    assert contents.last_change(plate) == third_contents.last_change(plate)
    event, *_, first = keeper.events()
    assert event.revision is not None
    assert event.revision.after.types[0].name == "Plate"
    assert len(first.changes) == 2
    assert keeper.ask(ReadEvents(), Events).since == 7

    keeper.ask(UpdateMap(changes=(ValueSet("Jar1", "Color", "Blue"),)), Updated)
    assert keeper.read_version(7)[1] == third_contents.map
    assert "from version 7 on" in keeper.ask(ReadMap(at_version=1), Fault).text
    keeper.ask(Undo(version=8), Updated)
    assert "history is stored only from version" in keeper.broken(Undo(version=1))[0].message
    keeper.restart()
    assert keeper.contents.since == 7
    keeper.close()


def test_there_is_a_way_from_every_format() -> None:
    assert [*MIGRATIONS] == [*range(1, KIND.version)]
