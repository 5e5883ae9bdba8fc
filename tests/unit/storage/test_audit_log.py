"""The audit log: nothing in it can be changed unnoticed, and names can be erased."""

from __future__ import annotations

import sqlite3
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import UsageError
from somrs.storage.audit_log import ERASURE, FILE, SHORTENING, Actor, AuditLog

ADA, EVE = Actor(name="Ada", address="10.0.0.7"), Actor(name="Eve")

acts = st.tuples(
    st.sampled_from(["map.change", "tasks.submit", "fleet.stop"]),
    st.sampled_from(["done", "denied"]),
    st.builds(Actor, name=st.sampled_from(["Ada", "Eve", "", "Ada Lovelace"]), address=st.sampled_from(["", "10.0.0.7"])),
    st.recursive(
        st.none() | st.booleans() | st.integers(-9, 9) | st.text(max_size=5) | st.sampled_from(["by Ada", "Adapter", "ada"]),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
        max_leaves=5,
    ),
)


def filled(data: Path, count: int = 5) -> AuditLog:
    log = AuditLog(data)
    for number in range(count):
        log.append("map.change", "done", ADA if number % 2 else EVE, {"situation": f"Jar1.Weight = {number}"})
    return log


def alter(data: Path, statement: str, *values: object) -> None:
    with closing(sqlite3.connect(data / FILE)) as db, db:
        db.execute(statement, values)


@given(st.lists(acts, max_size=8))
def test_entries_are_what_was_appended(appended: list[tuple[str, str, Actor, object]]) -> None:
    with TemporaryDirectory() as folder:
        log = AuditLog(Path(folder))
        for act, outcome, actor, details in appended:
            log.append(act, outcome, actor, details)
        assert [(entry.act, entry.outcome, entry.actor, entry.details) for entry in log.entries()] == appended
        assert log.latest(3) == [*log.entries()][::-1][:3]
        assert log.verify().entries == len(appended)


@given(
    number=st.integers(1, 5),
    column=st.sampled_from(["moment", "act", "outcome", "actor", "actor_digest", "details", "details_digest", "digest"]),
    value=st.none() | st.binary(max_size=40) | st.text(max_size=5) | st.integers(-9, 9) | st.floats(allow_nan=False),
)
def test_no_value_can_be_altered(number: int, column: str, value: object) -> None:
    with TemporaryDirectory() as folder:
        log = filled(Path(folder))
        entries = [*log.entries()]
        try:
            alter(Path(folder), f"UPDATE entries SET {column} = ? WHERE number = ?", value, number)
        except sqlite3.IntegrityError:
            return
        with suppress(UsageError):
            log.verify()
            assert [*log.entries()] == entries, "the value is the same as before"


@pytest.mark.parametrize("number", range(1, 5))
def test_no_entry_can_be_removed(tmp_path: Path, number: int) -> None:
    log = filled(tmp_path)
    alter(tmp_path, "DELETE FROM entries WHERE number = ?", number)
    with pytest.raises(UsageError, match=f"entries {number} to {number} of the audit log were removed"):
        log.verify()


def test_entries_cannot_change_places(tmp_path: Path) -> None:
    log = filled(tmp_path)
    alter(tmp_path, "UPDATE entries SET number = CASE number WHEN 2 THEN 3 WHEN 3 THEN -2 ELSE number END WHERE number = 3")
    alter(tmp_path, "UPDATE entries SET number = 3 WHERE number = 2")
    alter(tmp_path, "UPDATE entries SET number = 2 WHERE number = -2")
    with pytest.raises(UsageError, match="entry 2 of the audit log was altered"):
        log.verify()


def test_a_noted_digest_shows_that_the_end_was_removed(tmp_path: Path) -> None:
    log = filled(tmp_path)
    noted = log.verify().digest
    assert log.verify(noted).entries == 5
    alter(tmp_path, "DELETE FROM entries WHERE number = 5")
    assert log.verify().entries == 4
    with pytest.raises(UsageError, match="cut short"):
        log.verify(noted)


def test_the_beginning_cannot_be_removed(tmp_path: Path) -> None:
    log = filled(tmp_path)
    second = [*log.entries()][1]
    alter(tmp_path, "DELETE FROM entries WHERE number <= 2")
    alter(tmp_path, "UPDATE beginning SET number = 2, digest = ?", bytes.fromhex(second.digest))
    with pytest.raises(UsageError, match="up to 2 were removed"):
        log.verify()


@given(st.lists(acts, max_size=8))
def test_a_name_is_erased_and_the_chain_holds(appended: list[tuple[str, str, Actor, object]]) -> None:
    with TemporaryDirectory() as folder:
        log = AuditLog(Path(folder))
        for act, outcome, actor, details in appended:
            log.append(act, outcome, actor, details)
        noted = log.verify().digest
        count = log.erase("Ada", EVE)
        entries = [*log.entries()]
        for entry, (act, outcome, actor, details) in zip(entries, appended, strict=False):
            assert (entry.act, entry.outcome) == (act, outcome)
            assert entry.actor == (None if actor.name == "Ada" else actor)
            assert entry.details is None or entry.details == details
            assert "by ada" not in repr(entry.details).lower()
            assert "adapter" not in repr(details).lower() or entry.details is not None or "ada'" in repr(details).lower()
        assert log.verify(noted).erased == count
        assert len(entries) == len(appended) + (count > 0)
        if count:
            assert (entries[-1].act, entries[-1].actor) == (ERASURE, EVE)


def test_what_was_erased_is_in_no_file(tmp_path: Path) -> None:
    log = filled(tmp_path)
    log.append("access.add_person", "done", EVE, {"name": "Ada"})
    log.erase("Ada", EVE)
    assert all(b"Ada" not in file.read_bytes() for file in tmp_path.iterdir())


def test_erasing_without_an_entry_is_noticed(tmp_path: Path) -> None:
    log = filled(tmp_path)
    log.erase("Ada", EVE)
    log.verify()
    alter(tmp_path, "UPDATE entries SET actor = NULL WHERE number = 3")
    with pytest.raises(UsageError, match="entry 3 of the audit log was altered"):
        log.verify()


def test_too_many_entries_are_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOMRS_LIMIT_AUDIT_ENTRIES", "20")
    log = AuditLog(tmp_path)
    for number in range(100):
        log.append("map.change", "done", ADA, number)
        assert log.verify().entries <= 21
    entries = [*log.entries()]
    verified = log.verify()
    assert verified.entries == len(entries) >= 18
    assert verified.first == entries[0].number > 80
    assert entries[-1].details == 99 or entries[-1].act == SHORTENING


def append_many(data: Path, name: str) -> None:
    log = AuditLog(data)
    for number in range(25):
        log.append("map.change", "done", Actor(name=name), number)


def test_several_programs_write_to_one_chain(tmp_path: Path) -> None:
    names = ["api", "gui", "somrs"]
    with ProcessPoolExecutor(3) as pool:
        list(pool.map(append_many, [tmp_path] * 3, names))
    log = AuditLog(tmp_path)
    assert log.verify().entries == 75
    for name in names:
        assert [entry.details for entry in log.entries() if entry.actor == Actor(name=name)] == [*range(25)]


def test_a_file_that_is_no_audit_log_is_left_alone(tmp_path: Path) -> None:
    for content in (b"not a database, but long enough to be taken for one" * 40, b""):
        (tmp_path / FILE).write_bytes(content)
        log = AuditLog(tmp_path)
        if content:
            with pytest.raises(UsageError, match="cannot be used"):
                log.append("map.change", "done", ADA)
            assert (tmp_path / FILE).read_bytes() == content
        else:
            log.append("map.change", "done", ADA)
            assert log.verify().entries == 1


def test_a_data_folder_without_a_log_has_no_entries(tmp_path: Path) -> None:
    log = AuditLog(tmp_path)
    assert [*log.entries()] == log.latest(5) == []
    assert log.verify().entries == 0
    assert not (tmp_path / FILE).exists()
