"""The file of a journal: its tables, and how a journal is begun, read, and written in them. `journal.py` says when."""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Iterator

import msgspec
from msgspec import Struct

from somrs.kernel.durability import JournalCodec, JournaledComponent
from somrs.kernel.parts import CHUNK, PartChanges, Parts, PartsWriter, chunk_document, part_changes
from somrs.storage import archive
from somrs.storage.disk import Kind
from somrs.version import __version__

PROGRAM = f"SO-MRS {__version__}"
"""Who writes: a later program converts what an earlier one has written."""

WITH_PARTS = """
    CREATE TABLE IF NOT EXISTS parts (component TEXT NOT NULL, part TEXT NOT NULL, key BLOB NOT NULL, value BLOB NOT NULL,
      PRIMARY KEY (component, part, key)) WITHOUT ROWID;
"""
"""The large parts of the snapshots (`kernel.parts`)."""

TABLES = (
    """
    CREATE TABLE life (component TEXT PRIMARY KEY, program TEXT NOT NULL, setting TEXT NOT NULL, address TEXT NOT NULL, open TEXT NOT NULL,
      schema INTEGER NOT NULL);
    CREATE TABLE snapshot (component TEXT PRIMARY KEY, number INTEGER NOT NULL, at REAL NOT NULL, sum INTEGER NOT NULL,
      state BLOB NOT NULL);
    CREATE TABLE entries (component TEXT NOT NULL, last INTEGER NOT NULL, batch BLOB NOT NULL);
"""
    + WITH_PARTS
)
"""Entries have no index.

Every commit adds entries, and with an index would write a page for each component; entries are looked up only when a component starts and
after a snapshot.
"""

WITHOUT_INDEX = """
    ALTER TABLE entries RENAME TO old_entries;
    CREATE TABLE entries (component TEXT NOT NULL, last INTEGER NOT NULL, batch BLOB NOT NULL);
    INSERT INTO entries SELECT component, last, batch FROM old_entries ORDER BY component, last;
    DROP TABLE old_entries;
"""

WITH_SUMS = "SELECT 0;"
"""From the next format on, batches have checksums. Those of earlier formats stay as they are."""

_SUM_MARK, _SUM_SIZE = b"\xc1SUM", 4
"""What is between a batch and its checksum, and the size of the latter in bytes. 0xC1 is never used in msgpack."""

KIND = Kind(
    owner="a journal's",
    content="input, record or state",
    rival="another process",
    application=0x534F4D4A,  # `SOMJ` in ASCII
    version=6,
    tables=TABLES + archive.TABLES,
    # Devices and Registries had files of other kinds. Their earlier contracts are not known then, and are reported as unknown.
    replaces={
        0x534F4D44: "DROP TABLE kept;" + TABLES + archive.TABLES,
        0x534F4D53: "DROP TABLE listed;" + TABLES + archive.TABLES,
    },
    migrations={
        # Only the program that wrote it can read the state in a file of the first format: version 0. The records stay.
        1: "ALTER TABLE life ADD COLUMN schema INTEGER NOT NULL DEFAULT 0;",
        # The second format had one component in each file.
        2: "ALTER TABLE life RENAME TO old_life; ALTER TABLE snapshot RENAME TO old_snapshot; ALTER TABLE entries RENAME TO old_entries;"
        + TABLES
        + """
        INSERT INTO life SELECT '', program, setting, address, open, schema FROM old_life;
        INSERT INTO snapshot SELECT '', number, at, sum, state FROM old_snapshot;
        INSERT INTO entries SELECT '', last, batch FROM old_entries;
        DROP TABLE old_life; DROP TABLE old_snapshot; DROP TABLE old_entries;
        """,
        3: WITHOUT_INDEX,
        4: WITH_PARTS,
        5: WITH_SUMS,
    },
)


class StoredJournal(Struct):
    """The contents of a file: who wrote it, for which address, what was open, the number of the last entry, the snapshot with its parts,
    and the entries after it."""

    program: str
    setting: str
    address: str
    open: list[str]
    schema: int
    number: int
    state: bytes
    sum: int
    parts: dict[str, list[bytes]]
    entries: list[bytes]


def begin_with(
    db: sqlite3.Connection, journaled: JournaledComponent, written: JournalCodec, component: str = "", setting: str = "", address: str = ""
) -> Parts:
    """Begin a journal with the present component, and delete its earlier contents. Return the parts of the snapshot."""
    db.execute("DELETE FROM entries WHERE component = ?", (component,))
    db.execute("DELETE FROM parts WHERE component = ?", (component,))
    is_open = msgspec.json.encode(tuple(journaled.component.open)).decode()
    life = (component, PROGRAM, setting, address, is_open, written.schema.version)
    db.execute("INSERT OR REPLACE INTO life VALUES (?, ?, ?, ?, ?, ?)", life)
    parts = PartsWriter()
    state = written.encode_snapshot(journaled, parts)
    write_snapshot(db, component, journaled.number, journaled.time, state, part_changes({}, parts.parts))
    return parts.parts


def read_stored_journal(db: sqlite3.Connection, component: str) -> StoredJournal | None:
    """What the file has of a component; None if it has nothing. Raises KeyError or msgspec's errors if it is damaged."""
    life = db.execute("SELECT program, setting, address, open, schema FROM life WHERE component = ?", (component,)).fetchone()
    if life is None:
        return None
    program, setting, address, open, schema = life
    snapshot = db.execute("SELECT state, sum, number FROM snapshot WHERE component = ?", (component,)).fetchone()
    if snapshot is None:
        raise KeyError("there is no state")
    (last_number,) = db.execute("SELECT coalesce(max(last), 0) FROM entries WHERE component = ?", (component,)).fetchone()
    return StoredJournal(
        program=program,
        setting=setting,
        address=address,
        open=msgspec.json.decode(open, type=list[str]),
        schema=schema,
        number=max(snapshot[2], last_number),
        state=snapshot[0],
        sum=snapshot[1],
        parts={part: [*_read_part(db, component, part)] for part in _part_names(db, component)},
        entries=[
            _without_sum(batch, last)
            for batch, last in db.execute("SELECT batch, last FROM entries WHERE component = ? ORDER BY last", (component,))
        ],
    )


def _part_names(db: sqlite3.Connection, component: str) -> list[str]:
    return [part for (part,) in db.execute("SELECT DISTINCT part FROM parts WHERE component = ?", (component,))]


def _read_part(db: sqlite3.Connection, component: str, part: str) -> Iterator[bytes]:
    """Read the documents of a part, each with some entries."""
    rows = db.execute("SELECT iif(length(value), value, key) FROM parts WHERE component = ? AND part = ? ORDER BY key", (component, part))
    while chunk := rows.fetchmany(CHUNK):
        yield chunk_document([entry for (entry,) in chunk])


def write_snapshot(db: sqlite3.Connection, component: str, number: int, timestamp: float, state: bytes, changes: PartChanges) -> None:
    """Write the state after the entry with this number, and delete the entries up to it."""
    db.executemany("DELETE FROM parts WHERE component = ? AND part = ? AND key = ?", ((component, *entry) for entry in changes.removed))
    db.executemany("INSERT OR REPLACE INTO parts VALUES (?, ?, ?, ?)", ((component, *entry) for entry in changes.written))
    db.execute("INSERT OR REPLACE INTO snapshot VALUES (?, ?, ?, ?, ?)", (component, number, timestamp, zlib.crc32(state), state))
    db.execute("DELETE FROM entries WHERE component = ? AND last <= ?", (component, number))


def write_batch(db: sqlite3.Connection, component: str, last: int, batch: bytes) -> None:
    """Write a batch of entries, the last of which has this number."""
    db.execute("INSERT INTO entries VALUES (?, ?, ?)", (component, last, batch + _SUM_MARK + _sum_of(batch)))


def _sum_of(batch: bytes) -> bytes:
    return zlib.crc32(batch).to_bytes(_SUM_SIZE, "big")


def _without_sum(stored: bytes, last: int) -> bytes:
    """The batch, whose last entry has this number. Raises KeyError if it was altered. Those of earlier formats have no checksum."""
    end = len(stored) - _SUM_SIZE - len(_SUM_MARK)
    if stored[max(end, 0) : -_SUM_SIZE] != _SUM_MARK:
        return stored
    if stored[-_SUM_SIZE:] != _sum_of(stored[:end]):
        raise KeyError(f"the inputs up to number {last} are not those that were written")
    return stored[:end]


def write_open(db: sqlite3.Connection, component: str, open: tuple[str, ...]) -> None:
    """Write what the component has not finished."""
    db.execute("UPDATE life SET open = ? WHERE component = ?", (msgspec.json.encode(open).decode(), component))
