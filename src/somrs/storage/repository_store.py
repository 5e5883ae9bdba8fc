"""The Repository's file: one SQLite database with the ontology, the map, and all that ever happened to them.

Documents in it are JSON, for whoever looks with other tools. How it comes to be on disk is `disk.py`'s; events are read back in
`store_events.py`.
"""

from __future__ import annotations

import asyncio
import functools
import sqlite3
from pathlib import Path
from typing import Any

import msgspec

from somrs.errors import UsageError
from somrs.ontology.naming import Named, Section, named
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
from somrs.protocol.messages.knowledge import Event, Revision
from somrs.repository.entries import (
    REMEMBERED,
    Answer,
    Contents,
    Defining,
    Entry,
    EventsOf,
    Handled,
    HistoryOf,
    PastOf,
    Subscription,
)
from somrs.storage.disk import Disk, Job, Kind
from somrs.storage.store_events import event_of, happened, history, leading_back, past

DRIVERS = ("fixed_camera", "manipulator", "patrol")
"""Modules with drivers of simulated devices."""

KIND = Kind(
    owner="a Repository's",
    holds="ontology, map or event",
    rival="another process",
    application=0x534F4D52,  # `SOMR` in ASCII
    version=3,
    tables="""
    CREATE TABLE definitions (kind TEXT NOT NULL, name TEXT NOT NULL, document TEXT NOT NULL, UNIQUE (kind, name));
    CREATE TABLE objects (name TEXT NOT NULL UNIQUE, document TEXT NOT NULL);
    CREATE TABLE facts (relation TEXT NOT NULL, arguments TEXT NOT NULL, UNIQUE (relation, arguments));
    CREATE TABLE events (version INTEGER PRIMARY KEY, at REAL NOT NULL, author TEXT NOT NULL, changes TEXT NOT NULL, before TEXT,
      revision TEXT, renamed TEXT, undoes INTEGER);
    CREATE INDEX revisions ON events (version) WHERE revision IS NOT NULL;
    CREATE TABLE touched (object TEXT NOT NULL, version INTEGER NOT NULL, PRIMARY KEY (object, version)) WITHOUT ROWID;
    CREATE TABLE revised (section TEXT NOT NULL, name TEXT NOT NULL, version INTEGER NOT NULL, PRIMARY KEY (section, name)) WITHOUT ROWID;
    CREATE TABLE renamed (name TEXT NOT NULL, version INTEGER NOT NULL, before TEXT NOT NULL, PRIMARY KEY (name, version)) WITHOUT ROWID;
    CREATE TABLE answered (number INTEGER PRIMARY KEY AUTOINCREMENT, request TEXT NOT NULL UNIQUE, answer TEXT NOT NULL);
    CREATE TABLE subscriptions (address TEXT PRIMARY KEY, until REAL NOT NULL);
    """,
    migrations={
        # What was before an event is not known of those of the first format: `before` is NULL.
        1: """
    ALTER TABLE events ADD COLUMN before TEXT;
    ALTER TABLE events ADD COLUMN revision TEXT;
    ALTER TABLE events ADD COLUMN renamed TEXT;
    ALTER TABLE events ADD COLUMN undoes INTEGER;
    UPDATE events SET revision = json_object('before', json('{}'), 'after', json(definitions)) WHERE definitions IS NOT NULL;
    ALTER TABLE events DROP COLUMN definitions;
    CREATE INDEX revisions ON events (version) WHERE revision IS NOT NULL;
    CREATE TABLE revised (section TEXT NOT NULL, name TEXT NOT NULL, version INTEGER NOT NULL, PRIMARY KEY (section, name)) WITHOUT ROWID;
    INSERT INTO revised
      SELECT of.key, json_extract(one.value, '$.name'), max(version)
      FROM events, json_each(revision, '$.after') AS of, json_each(of.value) AS one WHERE revision IS NOT NULL GROUP BY 1, 2;
    CREATE TABLE renamed (name TEXT NOT NULL, version INTEGER NOT NULL, before TEXT NOT NULL, PRIMARY KEY (name, version)) WITHOUT ROWID;
    """,
        # The drivers of devices are in packages of their own since.
        2: "".join(
            f"UPDATE definitions SET document = replace(document, '{before}:', '{after}:');"
            for before, after in (
                ("somrs.devices.person", "somrs.devices.person.device"),
                *((f"somrs.devices.simulator.{name}", f"somrs.devices.simulator.drivers.{name}") for name in DRIVERS),
            )
        ),
    },
)

KINDS: dict[str, type[Definition]] = {kind.__name__: kind for kind in (AttributeType, RelationType, FunctionType, ObjectType, ServiceType)}

_OBJECT = msgspec.json.Decoder(Object)
_ARGUMENTS = msgspec.json.Decoder(tuple[str, ...])
_ANSWER: msgspec.json.Decoder[Answer] = msgspec.json.Decoder(Answer)


def _json(value: object) -> str:
    return msgspec.json.encode(value).decode()


class RepositoryStore:
    """An open file. Its methods raise UsageError for a file that is damaged, is somebody else's, or cannot be written."""

    def __init__(self, disk: Disk) -> None:
        self.disk = disk
        self.path = disk.path

    @classmethod
    def open(cls, path: Path) -> RepositoryStore:
        """Open the file, or make it; its folder must be there."""
        return cls(Disk(path, KIND))

    def close(self) -> None:
        self.disk.close()

    def initialise(self, ontology: Ontology, map: Map) -> None:
        """Begin with this ontology and this map, as version 0. What was in the file before must be nothing."""
        if self.load() is not None:
            raise UsageError(f"{self.path}: holds a map already; change that one, or take a new file")

        def write(db: sqlite3.Connection) -> None:
            for definition in ontology:
                _define(db, definition)
            db.executemany("INSERT INTO objects VALUES (?, ?)", ((o.name, _json(o)) for o in map.objects.values()))
            db.executemany("INSERT INTO facts VALUES (?, ?)", ((f.relation, _json(f.arguments)) for f in map.facts()))

        self.disk.do(write)

    def load(self) -> Contents | None:
        """What the file holds; None for a new one."""
        return self.disk.read(_contents).result()

    def record(self, entry: Entry) -> None:
        """Keep the entry, wholly or not at all. It is on disk when this returns."""
        self.disk.do(functools.partial(self._write, entry))

    def keep(self, entry: object) -> None:
        """Have an entry of a Repository on disk, soon."""
        assert isinstance(entry, Handled | Subscription), f"a Repository does not record {type(entry).__name__}"
        self.disk.write(functools.partial(self._write, entry))

    def history(self, object: str, limit: int) -> tuple[Event, ...]:
        """The latest events that changed the object, newest first."""
        return tuple(map(event_of, self.disk.read(functools.partial(history, object, limit)).result()))

    def answer(self, task: object) -> object:
        """Carry out what a Repository asks for."""
        return self._rest(task, self.disk.read(self._reading(task)).result())

    async def carry_out(self, task: object, report: object) -> object:
        """Carry out what a Repository asks for, while its event loop goes on."""
        found = await asyncio.wrap_future(self.disk.read(self._reading(task)))
        # Going back through ten thousand events takes a while: neither the event loop nor the disk waits for it.
        return await asyncio.to_thread(self._rest, task, found)

    def _reading(self, task: object) -> Job[Any]:
        """What has to be read to answer."""
        match task:
            case HistoryOf(object=object, limit=limit):
                return functools.partial(history, object, limit)
            case EventsOf():
                return functools.partial(happened, task)
            case PastOf(version=version, at_version=at):
                return functools.partial(leading_back, version, at)
        raise UsageError(f"{self.path}: a store knows what happened, and nothing of {type(task).__name__}")

    def _rest(self, task: object, found: Any) -> object:
        """What is to be made of what was read."""
        with self.disk.explained():
            return past(task, *found) if isinstance(task, PastOf) else tuple(map(event_of, found))

    def _write(self, entry: Entry, db: sqlite3.Connection) -> None:
        match entry:
            case Subscription(address=address, until=None):
                db.execute("DELETE FROM subscriptions WHERE address = ?", (address,))
            case Subscription(address=address, until=until):
                db.execute("INSERT OR REPLACE INTO subscriptions VALUES (?, ?)", (address, until))
            case Handled():
                self._handled(entry, db)

    def _handled(self, handled: Handled, db: sqlite3.Connection) -> None:
        number = db.execute(
            "INSERT OR REPLACE INTO answered (request, answer) VALUES (?, ?)", (handled.request, _json(handled.answer))
        ).lastrowid
        db.execute("DELETE FROM answered WHERE number <= ?", ((number or 0) - REMEMBERED,))
        if handled.event is not None:
            self._event(handled.event, db)

    def _event(self, event: Event, db: sqlite3.Connection) -> None:
        revision, version = event.revision, event.version
        db.execute(
            "INSERT INTO events VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (
                version,
                event.at,
                event.author,
                _json(event.changes),
                _json(event.before),
                _json(revision) if revision is not None else None,
                _json(event.renamed) if event.renamed else None,
                event.undoes,
            ),
        )
        if revision is not None:
            _revise(revision, version, db)
        objects = [renaming for renaming in event.renamed if renaming.section is Section.OBJECTS]
        db.executemany("INSERT INTO renamed VALUES (?, ?, ?)", ((one.to, version, one.name) for one in objects))
        names = dict.fromkeys(name for change in event.changes for name in objects_of(change))
        db.executemany("INSERT INTO touched VALUES (?, ?)", ((name, event.version) for name in names))
        for change in event.changes:
            self._change(change, db)

    def _change(self, change: Change, db: sqlite3.Connection) -> None:
        """As `Map.changed`."""
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


def _define(db: sqlite3.Connection, definition: Definition) -> None:
    db.execute(
        "INSERT INTO definitions VALUES (?, ?, ?) ON CONFLICT DO UPDATE SET document = excluded.document",
        (type(definition).__name__, definition.name, _json(definition)),
    )


def _revise(revision: Revision, version: int, db: sqlite3.Connection) -> None:
    after = {named(definition) for definition in revision.after.each()}
    for definition in revision.before.each():
        if named(definition) not in after:
            db.execute("DELETE FROM definitions WHERE kind = ? AND name = ?", (type(definition).__name__, definition.name))
    for definition in revision.after.each():
        _define(db, definition)
    every = dict.fromkeys((*map(named, revision.before.each()), *after))
    db.executemany("INSERT OR REPLACE INTO revised VALUES (?, ?, ?)", ((what.section, what.name, version) for what in every))


def _contents(db: sqlite3.Connection) -> Contents | None:
    definitions = [
        msgspec.json.decode(document, type=KINDS[kind])
        for kind, document in db.execute("SELECT kind, document FROM definitions ORDER BY rowid")
    ]
    if not definitions:
        return None
    objects = [_OBJECT.decode(document) for (document,) in db.execute("SELECT document FROM objects ORDER BY rowid")]
    rows = db.execute("SELECT relation, arguments FROM facts ORDER BY rowid")
    facts = [Fact(relation, _ARGUMENTS.decode(arguments)) for relation, arguments in rows]
    (version,) = db.execute("SELECT coalesce(max(version), 0) FROM events").fetchone()
    (since,) = db.execute("SELECT coalesce(max(version), 0) FROM events WHERE before IS NULL").fetchone()
    revised = db.execute("SELECT section, name, version, author FROM revised JOIN events USING (version)")
    answered = db.execute("SELECT request, answer FROM answered ORDER BY number")
    return Contents(
        ontology=Ontology(definitions),
        map=Map(objects, facts),
        version=version,
        changed_at=dict(db.execute("SELECT object, max(version) FROM touched GROUP BY object")),
        defined_at={
            Named(section=Section(section), name=name): Defining(version=version, author=author)
            for section, name, version, author in revised
        },
        answered={request: _ANSWER.decode(answer) for request, answer in answered},
        subscriptions=dict(db.execute("SELECT address, until FROM subscriptions ORDER BY rowid")),
        since=since,
    )
