"""The audit log: who did what, and what was denied to whom. Each entry has a digest over all before it, so that none can be altered,
removed or put in between unnoticed.

What is about a person is kept apart from the chain, which has only a salted digest of it. So it can be erased, and the chain still holds.
All programs of a system write to the same file, `audit.sqlite` in the data folder. It has no write-ahead log: a program that opens such a
file while another one closes it may find it locked, however long it would wait.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
import secrets
import sqlite3
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from somrs.errors import UsageError
from somrs.limits import limits

FILE = "audit.sqlite"
"""The file in the data folder."""

BEGINNING = b"\0" * 32
"""What the first entry follows, in place of a digest."""

ERASURE, SHORTENING = "audit.erase", "audit.shorten"
"""The acts of the entries that say what was erased, and which of the first entries were removed because there were too many."""

PROGRAM = "SO-MRS"
"""Who removes the first entries."""

BUSY_TIME = 30.0
"""Seconds for which another program may write before this one gives up."""

_APPLICATION = 0x534F4D41
"""SQLite's application_id: `SOMA` in ASCII."""

_TABLES = """
    CREATE TABLE entries (number INTEGER PRIMARY KEY, moment REAL NOT NULL, act TEXT NOT NULL, outcome TEXT NOT NULL,
      actor BLOB, actor_digest BLOB NOT NULL, details BLOB, details_digest BLOB NOT NULL, digest BLOB NOT NULL);
    CREATE TABLE beginning (number INTEGER NOT NULL, digest BLOB NOT NULL);
"""
"""`beginning` has one row: the last entry that was removed because there were too many, or 0 and `BEGINNING`."""

_COLUMNS = "number, moment, act, outcome, actor, actor_digest, details, details_digest, digest"


class _Row(Struct, frozen=True, kw_only=True, array_like=True):
    """An entry as it is stored, in the order of the columns."""

    number: int
    moment: float
    act: str
    outcome: str
    actor: bytes | None
    actor_digest: bytes
    details: bytes | None
    details_digest: bytes
    digest: bytes

    def chained_to(self, previous_digest: bytes) -> bytes:
        """The digest that it has to have after an entry with this one."""
        return _chained(previous_digest, self.number, self.moment, self.act, self.outcome, self.actor_digest, self.details_digest)


class Actor(Struct, frozen=True, kw_only=True):
    """Who did or tried something. `name`: as proven; empty if nothing was proven. `address`: the address from which it came, if any."""

    name: str
    address: str = ""


class AuditEntry(Struct, frozen=True, kw_only=True):
    """An entry. `moment`: seconds since 1970. `actor`, `details`: None after they were erased. `digest`: of it and all before it."""

    number: int
    moment: float
    act: str
    outcome: str
    actor: Actor | None
    details: Any
    digest: str


class _Erased(Struct, frozen=True, kw_only=True):
    """The details of an erasure: the numbers of the entries."""

    entries: list[int]


class _Shortened(Struct, frozen=True, kw_only=True):
    """The details of the removal of the first entries: the number of the last of them."""

    last_number: int


class Verified(Struct, frozen=True, kw_only=True):
    """What is true of a log whose chain holds: the number of its entries, of those in which something was erased, and its last digest.
    `first`: the number of the first entry; earlier ones were removed because there were too many."""

    first: int
    entries: int
    erased: int
    digest: str


def audit_files(data: Path) -> list[Path]:
    """The files of the log in a data folder."""
    return [data / FILE, data / f"{FILE}-journal"]


class AuditLog:
    """The log in a data folder. Methods may be called by several threads. They raise UsageError if the file cannot be used."""

    def __init__(self, data: Path) -> None:
        self._path, self._limit = data / FILE, limits().audit_entries

    def append(self, act: str, outcome: str, actor: Actor, details: object = None, moment: float | None = None) -> None:
        """Add an entry. `details`: what JSON can express."""
        with self._open(writes=True) as db:
            number = _add(db, act, outcome, actor, details, time.time() if moment is None else moment)
            if number - _beginning(db)[0] > self._limit:
                _shorten(db, number - self._limit + self._limit // 10)

    def latest(self, count: int, before: int | None = None) -> list[AuditEntry]:
        """The last entries, newest first; only those with smaller numbers than `before`."""
        bound = before if before is not None else 2**62
        return [_entry(row) for row in self._read("WHERE number < ? ORDER BY number DESC LIMIT ?", (bound, count))]

    def entries(self) -> Iterator[AuditEntry]:
        """All entries, oldest first."""
        for row in self._rows():
            yield _entry(row)

    def verify(self, noted_digest: str | None = None) -> Verified:
        """Check the chain. `noted_digest`: a digest that was noted earlier, and that an entry has to have.

        Raises UsageError, which names the first entry that does not fit. That the last entries were removed can be told only by a digest
        that was noted somewhere else.
        """
        start, digest = self._start()
        walk = _Walk(start, digest)
        for row in self._rows():
            walk.add(row)
        walk.check_end()
        if noted_digest is not None and noted_digest not in walk.digests:
            raise UsageError(
                f"{self._path}: no entry has the digest {noted_digest}; since it was noted, the log was cut short or begun anew, or that "
                "entry was removed because there were too many"
            )
        return Verified(first=start + 1, entries=walk.number - start, erased=len(walk.erased), digest=walk.digest.hex())

    def erase(self, name: str, actor: Actor) -> int:
        """Erase a person's name: who it was in the entries of that person, and all details that contain the name. Returns how many entries
        were changed, which are named in a new entry, with `actor` erased them. The chain holds as before."""
        pattern = re.compile(rf"(?<!\w){re.escape(name)}(?!\w)", re.IGNORECASE)
        with self._open(writes=True) as db:
            db.execute("PRAGMA secure_delete = ON")
            changed = [row.number for row in _rows_of(db, "") if _erase(db, row, pattern)]
            if changed:
                _add(db, ERASURE, "done", actor, _Erased(entries=changed), time.time())
        if changed:
            with self._open(writes=False) as db:
                db.execute("VACUUM")  # so that the file does not contain what was erased any more
        return len(changed)

    def _start(self) -> tuple[int, bytes]:
        if not self._path.exists():
            return 0, BEGINNING
        with self._open(writes=False) as db:
            return _beginning(db)

    def _rows(self) -> Iterator[_Row]:
        number = 0
        while rows := self._read("WHERE number > ? ORDER BY number LIMIT 1000", (number,)):
            yield from rows
            number = rows[-1].number

    def _read(self, condition: str, values: tuple[float, ...]) -> list[_Row]:
        if not self._path.exists():
            return []
        with self._open(writes=False) as db:
            return _rows_of(db, condition, values)

    @contextlib.contextmanager
    def _open(self, *, writes: bool) -> Iterator[sqlite3.Connection]:
        """The open file; with a transaction that nobody else can write in meanwhile."""
        try:
            with contextlib.closing(sqlite3.connect(self._path, timeout=BUSY_TIME, isolation_level=None)) as db:
                if not db.execute("PRAGMA user_version").fetchone()[0]:
                    _prepare(db)
                elif db.execute("PRAGMA application_id").fetchone()[0] != _APPLICATION:
                    raise sqlite3.DatabaseError("it is not an audit log")
                if not writes:
                    yield db
                    return
                db.execute("BEGIN IMMEDIATE")
                try:
                    yield db
                except BaseException:  # whatever it is: half of an act is never kept
                    db.execute("ROLLBACK")
                    raise
                db.execute("COMMIT")
        except sqlite3.Error as error:
            hint = "see that the disk has room, or restore it from a backup; a new one is begun if you move it away"
            raise UsageError(f"{self._path} cannot be used: {error}; {hint}") from error


class _Walk:
    """A walk along the chain from its first entry. It raises UsageError at the first one that does not fit."""

    def __init__(self, start: int, digest: bytes) -> None:
        self._start, self.number, self.digest = start, start, digest
        self.digests = {digest.hex()}
        self.erased: set[int] = set()
        self._erasures: set[int] = set()
        self._removed_until = 0

    def add(self, row: _Row) -> None:
        if row.number != self.number + 1:
            raise UsageError(f"entries {self.number + 1} to {row.number - 1} of the audit log were removed")
        for part, part_digest in ((row.actor, row.actor_digest), (row.details, row.details_digest)):
            if part is None:
                self.erased.add(row.number)
            elif _digest(part) != part_digest:
                raise _altered(row.number)
        if row.chained_to(self.digest) != row.digest:
            raise _altered(row.number)
        if row.act == ERASURE and row.details is not None:
            self._erasures.update(_content(row.details, _Erased).entries)
        if row.act == SHORTENING and row.details is not None:
            self._removed_until = _content(row.details, _Shortened).last_number
        self.number, self.digest = row.number, row.digest
        self.digests.add(row.digest.hex())

    def check_end(self) -> None:
        if self._removed_until != self._start:
            raise UsageError(f"the entries of the audit log up to {self._start} were removed, and not because there were too many")
        if blanked := sorted(self.erased - self._erasures):
            raise _altered(blanked[0])


def _altered(number: int) -> UsageError:
    return UsageError(f"entry {number} of the audit log was altered, or one before it; compare the log with a backup or an export of it")


def _prepare(db: sqlite3.Connection) -> None:
    db.execute("BEGIN IMMEDIATE")
    if not db.execute("PRAGMA user_version").fetchone()[0]:  # nobody else was faster
        for statement in _TABLES.strip().rstrip(";").split(";"):
            db.execute(statement)
        db.execute("INSERT INTO beginning VALUES (0, ?)", (BEGINNING,))
        db.execute(f"PRAGMA application_id = {_APPLICATION}")
        db.execute("PRAGMA user_version = 1")
    db.execute("COMMIT")


def _rows_of(db: sqlite3.Connection, condition: str, values: tuple[float, ...] = ()) -> list[_Row]:
    """The entries that meet a condition. Raises UsageError for what is no entry."""
    rows = []
    for row in db.execute(f"SELECT {_COLUMNS} FROM entries {condition}", values):
        try:
            rows.append(msgspec.convert(row, _Row, builtin_types=(bytes,)))
        except msgspec.ValidationError:
            raise _altered(row[0]) from None
    return rows


def _beginning(db: sqlite3.Connection) -> tuple[int, bytes]:
    number, digest = db.execute("SELECT number, digest FROM beginning").fetchone()
    return number, digest


def _add(db: sqlite3.Connection, act: str, outcome: str, actor: Actor, details: object, moment: float) -> int:
    """Add an entry, and return its number."""
    number, previous_digest = db.execute("SELECT number, digest FROM entries ORDER BY number DESC LIMIT 1").fetchone() or _beginning(db)
    actor_part, details_part = _part(actor), _part(details)
    actor_digest, details_digest = _digest(actor_part), _digest(details_part)
    digest = _chained(previous_digest, number + 1, moment, act, outcome, actor_digest, details_digest)
    row = (number + 1, moment, act, outcome, actor_part, actor_digest, details_part, details_digest, digest)
    db.execute(f"INSERT INTO entries ({_COLUMNS}) VALUES ({', '.join('?' * len(row))})", row)
    return number + 1


def _shorten(db: sqlite3.Connection, number: int) -> None:
    """Remove the entries up to a number, and add one that says so."""
    (digest,) = db.execute("SELECT digest FROM entries WHERE number = ?", (number,)).fetchone()
    db.execute("DELETE FROM entries WHERE number <= ?", (number,))
    db.execute("UPDATE beginning SET number = ?, digest = ?", (number, digest))
    _add(db, SHORTENING, "done", Actor(name=PROGRAM), _Shortened(last_number=number), time.time())


def _erase(db: sqlite3.Connection, row: _Row, pattern: re.Pattern[str]) -> bool:
    """Erase a name in an entry, and return whether the entry contained it."""
    actor, details = row.actor, row.details
    if actor is not None and pattern.fullmatch(_content(actor, Actor).name):
        actor = None
    if details is not None and row.act not in (ERASURE, SHORTENING) and any(map(pattern.search, _texts(_content(details, Any)))):
        details = None
    if (actor, details) == (row.actor, row.details):
        return False
    db.execute("UPDATE entries SET actor = ?, details = ? WHERE number = ?", (actor, details, row.number))
    return True


def _part(content: object) -> bytes:
    """What can be erased, with a salt: without it, nobody can try out which name a digest is of."""
    return secrets.token_bytes(16) + msgspec.json.encode(content)


def _content(part: bytes, kind: Any) -> Any:
    """Raises UsageError if it was altered."""
    try:
        return msgspec.json.decode(part[16:], type=kind)
    except msgspec.MsgspecError:
        raise UsageError("an entry of the audit log was altered; `somrs audit verify` says which") from None


def _digest(part: bytes) -> bytes:
    return hashlib.sha256(part).digest()


def _chained(previous_digest: bytes, number: int, moment: float, act: str, outcome: str, actor: bytes, details: bytes) -> bytes:
    return hashlib.sha256(previous_digest + msgspec.json.encode([number, moment, act, outcome]) + actor + details).digest()


def _entry(row: _Row) -> AuditEntry:
    return AuditEntry(
        number=row.number,
        moment=row.moment,
        act=row.act,
        outcome=row.outcome,
        actor=_content(row.actor, Actor) if row.actor is not None else None,
        details=_content(row.details, Any) if row.details is not None else None,
        digest=row.digest.hex(),
    )


def _texts(content: Any) -> Iterator[str]:
    """All texts in what JSON can express."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for key, value in content.items():
            yield key
            yield from _texts(value)
    elif isinstance(content, list):
        for value in content:
            yield from _texts(value)
