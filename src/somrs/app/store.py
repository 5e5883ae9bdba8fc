"""The Repository's file: one SQLite database with the ontology, the map, and all that ever happened to them.

Write-ahead log with `synchronous=FULL`: when `record` returns, the entry survives a kill and a power cut. One process at a time
has the file open. Documents in it are JSON, for whoever looks with other tools.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import msgspec

from somrs.errors import UsageError
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
    objects_of,
)
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, Ontology, RelationType
from somrs.protocol.knowledge import Definitions, Event
from somrs.repository.entries import REMEMBERED, Answer, Contents, Entry, Handled, HistoryOf, Subscription

APPLICATION = 0x534F4D52
"""`SOMR` in ASCII: SQLite's application_id, by which the file is known as a Repository's."""

FORMAT = 1
"""The version of the tables below."""

TABLES = """
CREATE TABLE definitions (kind TEXT NOT NULL, name TEXT NOT NULL, document TEXT NOT NULL, UNIQUE (kind, name));
CREATE TABLE objects (name TEXT NOT NULL UNIQUE, document TEXT NOT NULL);
CREATE TABLE facts (relation TEXT NOT NULL, arguments TEXT NOT NULL, UNIQUE (relation, arguments));
CREATE TABLE events (version INTEGER PRIMARY KEY, at REAL NOT NULL, author TEXT NOT NULL, changes TEXT NOT NULL, definitions TEXT);
CREATE TABLE touched (object TEXT NOT NULL, version INTEGER NOT NULL, PRIMARY KEY (object, version)) WITHOUT ROWID;
CREATE TABLE answered (number INTEGER PRIMARY KEY AUTOINCREMENT, request TEXT NOT NULL UNIQUE, answer TEXT NOT NULL);
CREATE TABLE subscriptions (address TEXT PRIMARY KEY, until REAL NOT NULL);
"""

KINDS: dict[str, type[Definition]] = {kind.__name__: kind for kind in (AttributeType, RelationType, FunctionType, ObjectType, ServiceType)}

_CHANGES = msgspec.json.Decoder(tuple[Change, ...])
_OBJECT = msgspec.json.Decoder(Object)
_ARGUMENTS = msgspec.json.Decoder(tuple[str, ...])
_ANSWER: msgspec.json.Decoder[Answer] = msgspec.json.Decoder(Answer)


def _json(value: object) -> str:
    return msgspec.json.encode(value).decode()


class RepositoryStore:
    """An open file. Its methods raise UsageError for a file that is damaged, is somebody else's, or cannot be written."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._db = connection

    @classmethod
    def open(cls, path: Path) -> RepositoryStore:
        """Open the file, or make it; its folder must be there."""
        if not path.parent.is_dir():
            raise UsageError(f"{path}: there is no folder {path.parent}; make it first")
        with _explained(path):
            connection = sqlite3.connect(path, isolation_level=None, timeout=1.0)
        store = cls(path, connection)
        try:
            with _explained(path):
                store._prepare()
        except UsageError:
            connection.close()
            raise
        return store

    def _prepare(self) -> None:
        (application,) = self._db.execute("PRAGMA application_id").fetchone()
        (format,) = self._db.execute("PRAGMA user_version").fetchone()
        (tables,) = self._db.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        new = application == 0 and tables == 0
        if not new and application != APPLICATION:
            raise UsageError(f"{self.path}: is a database, but not a Repository's; give the Repository a file of its own")
        if not new and format != FORMAT:
            raise UsageError(f"{self.path}: has format {format}, this program reads {FORMAT}; run the SO-MRS that wrote it")
        # Exclusive: two Repositories that write the same map would both be wrong.
        for pragma in ("locking_mode=EXCLUSIVE", "journal_mode=WAL", "synchronous=FULL"):
            self._db.execute(f"PRAGMA {pragma}")
        self._db.execute("BEGIN IMMEDIATE")  # takes the lock now, not at the first update
        self._db.execute("COMMIT")
        if new:
            self._db.executescript(f"BEGIN; {TABLES} PRAGMA application_id={APPLICATION}; PRAGMA user_version={FORMAT}; COMMIT;")

    def close(self) -> None:
        self._db.close()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with _explained(self.path):
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield self._db
                self._db.execute("COMMIT")
            except BaseException:
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")
                raise

    def initialise(self, ontology: Ontology, map: Map) -> None:
        """Begin with this ontology and this map, as version 0. What was in the file before must be nothing."""
        if self.load() is not None:
            raise UsageError(f"{self.path}: holds a map already; change that one, or take a new file")
        with self._transaction() as db:
            for definition in ontology:
                self._define(definition)
            db.executemany("INSERT INTO objects VALUES (?, ?)", ((o.name, _json(o)) for o in map.objects.values()))
            db.executemany("INSERT INTO facts VALUES (?, ?)", ((f.relation, _json(f.arguments)) for f in map.facts()))

    def load(self) -> Contents | None:
        """What the file holds; None for a new one."""
        with _explained(self.path):
            definitions = [
                msgspec.json.decode(document, type=KINDS[kind])
                for kind, document in self._db.execute("SELECT kind, document FROM definitions ORDER BY rowid")
            ]
            if not definitions:
                return None
            objects = [_OBJECT.decode(document) for (document,) in self._db.execute("SELECT document FROM objects ORDER BY rowid")]
            rows = self._db.execute("SELECT relation, arguments FROM facts ORDER BY rowid")
            facts = [Fact(relation, _ARGUMENTS.decode(arguments)) for relation, arguments in rows]
            (version,) = self._db.execute("SELECT coalesce(max(version), 0) FROM events").fetchone()
            answered = self._db.execute("SELECT request, answer FROM answered ORDER BY number")
            return Contents(
                ontology=Ontology(definitions),
                map=Map(objects, facts),
                version=version,
                changed_at=dict(self._db.execute("SELECT object, max(version) FROM touched GROUP BY object")),
                answered={request: _ANSWER.decode(answer) for request, answer in answered},
                subscriptions=dict(self._db.execute("SELECT address, until FROM subscriptions ORDER BY rowid")),
            )

    def record(self, entry: Entry) -> None:
        """Keep the entry, wholly or not at all. It is on disk when this returns."""
        with self._transaction() as db:
            match entry:
                case Subscription(address=address, until=None):
                    db.execute("DELETE FROM subscriptions WHERE address = ?", (address,))
                case Subscription(address=address, until=until):
                    db.execute("INSERT OR REPLACE INTO subscriptions VALUES (?, ?)", (address, until))
                case Handled():
                    self._handled(entry)

    def history(self, object: str, limit: int) -> tuple[Event, ...]:
        """The latest events that changed the object, newest first."""
        with _explained(self.path):
            rows = self._db.execute(
                "SELECT version, at, author, changes FROM events JOIN touched USING (version) WHERE object = ?"
                " ORDER BY version DESC LIMIT ?",
                (object, limit),
            )
            return tuple(
                Event(version=version, at=at, author=author, changes=_CHANGES.decode(changes)) for version, at, author, changes in rows
            )

    def answer(self, task: object) -> object:
        """Carry out what a Repository asks for."""
        match task:
            case HistoryOf(object=object, limit=limit):
                return self.history(object, limit)
        raise UsageError(f"{self.path}: a store knows histories, and nothing of {type(task).__name__}")

    def _handled(self, handled: Handled) -> None:
        number = self._db.execute(
            "INSERT OR REPLACE INTO answered (request, answer) VALUES (?, ?)", (handled.request, _json(handled.answer))
        ).lastrowid
        self._db.execute("DELETE FROM answered WHERE number <= ?", ((number or 0) - REMEMBERED,))
        for definition in handled.definitions.each() if handled.definitions is not None else ():
            self._define(definition)
        if (event := handled.event) is not None:
            self._event(event, handled.definitions)

    def _define(self, definition: Definition) -> None:
        self._db.execute(
            "INSERT INTO definitions VALUES (?, ?, ?) ON CONFLICT DO UPDATE SET document = excluded.document",
            (type(definition).__name__, definition.name, _json(definition)),
        )

    def _event(self, event: Event, definitions: Definitions | None) -> None:
        self._db.execute(
            "INSERT INTO events VALUES (?, ?, ?, ?, ?)",
            (event.version, event.at, event.author, _json(event.changes), _json(definitions) if definitions is not None else None),
        )
        names = dict.fromkeys(name for change in event.changes for name in objects_of(change))
        self._db.executemany("INSERT INTO touched VALUES (?, ?)", ((name, event.version) for name in names))
        for change in event.changes:
            self._change(change)

    def _change(self, change: Change) -> None:
        """As `Map.changed`."""
        db = self._db
        match change:
            case ObjectAdded(object):
                db.execute(
                    "INSERT INTO objects VALUES (?, ?) ON CONFLICT DO UPDATE SET document = excluded.document", (object.name, _json(object))
                )
            case ObjectRemoved(name):
                db.execute("DELETE FROM objects WHERE name = ?", (name,))
                db.execute("DELETE FROM facts WHERE EXISTS (SELECT 1 FROM json_each(arguments) WHERE value = ?)", (name,))
            case ValueSet(name, path, value):
                row = db.execute("SELECT document FROM objects WHERE name = ?", (name,)).fetchone()
                if row is None:
                    raise UsageError(f"{self.path}: has no object {name} whose {path} could be set; put a copy of the file back")
                object = _OBJECT.decode(row[0])
                values = {**object.values, path: value} if value is not None else {p: v for p, v in object.values.items() if p != path}
                db.execute("UPDATE objects SET document = ? WHERE name = ?", (_json(msgspec.structs.replace(object, values=values)), name))
            case FactAdded(fact):
                db.execute("INSERT OR IGNORE INTO facts VALUES (?, ?)", (fact.relation, _json(fact.arguments)))
            case FactRemoved(fact):
                db.execute("DELETE FROM facts WHERE relation = ? AND arguments = ?", (fact.relation, _json(fact.arguments)))


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """What SQLite says, as something that a person can act on."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if error.sqlite_errorname in ("SQLITE_BUSY", "SQLITE_LOCKED"):
            raise UsageError(f"{path}: is in use by another process; stop that one, or take another file") from None
        raise UsageError(f"{path}: cannot be used: {error}; see to the disk's space and the file's rights") from None
    except sqlite3.DatabaseError as error:
        raise UsageError(f"{path}: is no Repository's file, or is damaged ({error}); take another file, or put a copy back") from None
    except (msgspec.DecodeError, KeyError) as error:
        raise UsageError(f"{path}: holds something that is no ontology, map or event ({error}); put a copy back") from None
