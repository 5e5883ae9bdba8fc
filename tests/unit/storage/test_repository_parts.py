"""The Repository's file with a large map: what a snapshot writes, and what a restart reads."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from somrs.errors import UsageError
from somrs.kernel.component import Received
from somrs.kernel.durability import JournaledComponent
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.storage.journal import Journal
from somrs.storage.repository_store import repository_journal
from tests.support.lab import request
from tests.support.small_pages import small_pages

ADDRESS = "http://here/repository"
JARS = 200


def store() -> Map:
    jars = [
        Object(name=f"Jar{number}", type="Jar", values={"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 1.0}) for number in range(JARS)
    ]
    return Map(
        [Object(name="Room1", type="Room"), *jars], [Fact("isOn", (f"Jar{number}", f"Jar{number - 1}")) for number in range(1, JARS)]
    )


def begin(path: Path) -> tuple[Journal, JournaledComponent]:
    journal = repository_journal(path)
    journaled, _ = journal.begin(ADDRESS, lambda address: Repository(address, Contents(ontology=upper(), map=store())))
    return journal, journaled


def update(journal: Journal, journaled: JournaledComponent, situation: str) -> None:
    entry = journaled.make_entry(Received(request(UpdateMap(situation=situation))), 1.0)
    journal.append(entry)
    journaled.handle(entry)


def written_rows(journal: Journal) -> int:
    return journal.disk.write_and_wait(lambda db: db.total_changes)


def test_a_snapshot_of_a_large_map_writes_what_changed_since_the_last_one(tmp_path: Path) -> None:
    with small_pages():
        path = tmp_path / "repository.sqlite"
        journal, journaled = begin(path)
        for number in (50, 60):
            update(journal, journaled, f"Jar{number}.Color = Red")
            rows_before = written_rows(journal)
            journal.snapshot(journaled)
            assert written_rows(journal) - rows_before < 10, "the object, the document, and the input, which is deleted"
        update(journal, journaled, "Jar70.Color = Blue")
        journal.close()
        journal, again = begin(path)
        assert isinstance(again.component, Repository)
        assert isinstance(journaled.component, Repository)
        contents = again.component.contents
        assert (contents.map, contents.version) == (journaled.component.contents.map, 3)
        assert [contents.map.objects[name].values.get("Color") for name in ("Jar50", "Jar60", "Jar70")] == ["Red", "Red", "Blue"]
        rows_before = written_rows(journal)
        journal.snapshot(again)
        assert written_rows(journal) - rows_before < 10, "it continues the parts of the snapshot that was read"
        journal.close()


def test_a_file_that_lacks_an_object_is_not_continued(tmp_path: Path) -> None:
    with small_pages():
        path = tmp_path / "repository.sqlite"
        begin(path)[0].close()
        with closing(sqlite3.connect(path)) as db:
            db.execute("DELETE FROM parts WHERE part = '0 ' AND key IN (SELECT key FROM parts WHERE part = '0 ' LIMIT 1)")
            db.commit()
        journal = repository_journal(path)
        with pytest.raises(UsageError, match="the objects of the map are 200, and not 201"):
            journal.begin(ADDRESS, lambda address: Repository(address, Contents(ontology=upper(), map=Map())))
        journal.close()
