"""The Repository's file after an accident, and in the hands of another program: what is wrong is said, and nothing is forgotten."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from somrs.errors import UsageError
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import History, ReadHistory, Updated, UpdateMap
from somrs.storage.repository_store import KIND, repository_journal
from tests.support.keeper import Keeper


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "repository.sqlite"


def run_statements(path: Path, *statements: str) -> list[tuple[object, ...]]:
    """Somebody else does something in the file; what the last statement finds."""
    with sqlite3.connect(path) as db:
        results = [db.execute(statement).fetchall() for statement in statements]
    db.close()
    return results[-1]


@pytest.mark.parametrize(
    ("tampered", "problem"),
    [
        ("UPDATE events SET author = 'Anna' WHERE version = 2", "version 2 of the map differs from the result of the same request now"),
        ("UPDATE events SET changes = '[]' WHERE version = 1", "version 1 of the map differs from"),
        ("INSERT INTO events (version, at, author, changes) VALUES (3, 9, 'Anna', '[]')", "version 3 of the map is not reached"),
    ],
)
def test_a_program_that_would_decide_otherwise_does_not_contradict_the_history(path: Path, tampered: str, problem: str) -> None:
    keeper = Keeper(path)
    for number in (1, 2):
        keeper.ask(UpdateMap(changes=(ValueSet("Jar1", "PositionX", 10.0 + number),)), Updated)
    keeper.close()
    run_statements(path, "UPDATE life SET program = 'SO-MRS 0.9'", tampered)
    with pytest.raises(UsageError, match=problem) as refused:
        Keeper(path)
    assert str(path) in str(refused.value)
    assert "SO-MRS 0.9: start that once more and stop it normally" in str(refused.value)
    assert run_statements(path, "SELECT program FROM life") == [("SO-MRS 0.9",)], "the file is as it was"


def test_a_version_that_was_not_on_disk_comes_to_the_history_by_being_made_again(path: Path) -> None:
    keeper = Keeper(path)
    keeper.ask(UpdateMap(situation="Jar1 isOn Table2"), Updated)
    keeper.close()
    run_statements(path, "DELETE FROM touched", "DELETE FROM events")
    keeper = Keeper(path)
    assert [event.version for event in keeper.ask(ReadHistory(object="Jar1"), History).events] == [1]
    keeper.close()


def test_what_another_program_left_is_written_anew_before_anything_is_behind_it(path: Path) -> None:
    keeper = Keeper(path)
    keeper.ask(UpdateMap(situation="Jar1 isOn Table2"), Updated)
    keeper.close()
    run_statements(path, "UPDATE life SET program = 'SO-MRS 0.9'")
    keeper = Keeper(path)
    assert keeper.contents.version == 1
    keeper.close()
    ((program,),) = run_statements(path, "SELECT program FROM life")
    assert program != "SO-MRS 0.9"


def test_a_map_that_cannot_be_read_is_not_forgotten(path: Path) -> None:
    Keeper(path).close()
    run_statements(path, "UPDATE life SET program = 'SO-MRS 9', schema = 9")
    with pytest.raises(UsageError, match=r"written by SO-MRS 9, whose state SO-MRS .* cannot read; .* loses its contents"):
        Keeper(path)


def test_one_process_at_a_time_has_the_file(path: Path) -> None:
    keeper = Keeper(path)
    with pytest.raises(UsageError, match="in use by another process"):
        repository_journal(path)
    keeper.close()


def test_a_file_that_is_no_database_is_refused_and_left_alone(path: Path) -> None:
    path.write_text("objects:\n  Jar1: {type: Jar}\n" * 100)
    content_before = path.read_bytes()
    with pytest.raises(UsageError, match="not a Repository's file"):
        repository_journal(path)
    assert path.read_bytes() == content_before


def test_a_database_of_somebody_else_is_refused_and_left_alone(path: Path) -> None:
    run_statements(path, "CREATE TABLE objects (name TEXT)")
    content_before = path.read_bytes()
    with pytest.raises(UsageError, match="not a Repository's"):
        repository_journal(path)
    assert path.read_bytes() == content_before


def test_a_file_of_another_format_is_refused(path: Path) -> None:
    repository_journal(path).close()
    assert run_statements(path, f"PRAGMA user_version = {KIND.version + 1}", "PRAGMA application_id") == [(KIND.application,)]
    with pytest.raises(UsageError, match=f"has format {KIND.version + 1}"):
        repository_journal(path)


def test_a_damaged_file_is_said_to_be_damaged(path: Path) -> None:
    Keeper(path).close()
    data = bytearray(path.read_bytes())
    data[4096:] = b"\x5a" * (len(data) - 4096)
    path.write_bytes(bytes(data))
    with pytest.raises(UsageError, match="damaged"):
        repository_journal(path)


def test_a_state_that_is_none_is_said_to_be_damaged(path: Path) -> None:
    Keeper(path).close()
    run_statements(path, "UPDATE snapshot SET state = x'80'")
    with pytest.raises(UsageError, match=r"damaged.*restore a backup"):
        Keeper(path)


def test_a_document_that_is_none_is_no_answer(path: Path) -> None:
    keeper = Keeper(path)
    keeper.ask(UpdateMap(situation="Jar1 isOn Table2"), Updated)
    keeper.restart(snapshot=True)
    keeper.close()
    run_statements(path, "UPDATE events SET changes = '{\"name\": 1}'")
    keeper = Keeper(path)
    with pytest.raises(UsageError, match="restore a backup"):
        keeper.ask(ReadHistory(object="Jar1"), Fault)
    keeper.close()


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no folder"):
        repository_journal(tmp_path / "nowhere" / "repository.sqlite")
