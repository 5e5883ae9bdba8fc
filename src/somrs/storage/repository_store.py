"""The Repository's file: the journal of its inputs, and the archive of all that ever happened to the ontology and the map.

Documents in the archive are JSON, for whoever looks with other tools. Events are read back in `store_events.py`; what the file was like
before is in `repository_formats.py`.
"""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Sequence
from pathlib import Path

import msgspec

from somrs.ontology.naming import Section
from somrs.ontology.objects import objects_of
from somrs.protocol.messages.knowledge import Event, MapPage, OntologyPage, ReadMap, Revision
from somrs.repository.component import SCHEMA
from somrs.repository.pages import MapPages, ontology_page
from somrs.repository.past import PastState
from somrs.repository.state import ArchivedEvents, Contents, EventsOf, HistoryOf, PageOf
from somrs.storage import journal
from somrs.storage.disk import Disk, Kind
from somrs.storage.journal import Contradiction, Journal
from somrs.storage.repository_formats import MIGRATIONS
from somrs.storage.store_events import event_of, happened_at, leading_back, past, reading

KEPT = 4
"""So many versions of the past are kept, for the next pages of them."""

TABLES = """
    CREATE TABLE events (version INTEGER PRIMARY KEY, at REAL NOT NULL, author TEXT NOT NULL, changes TEXT NOT NULL, before TEXT,
      revision TEXT, renamed TEXT, undoes INTEGER);
    CREATE INDEX revisions ON events (version) WHERE revision IS NOT NULL;
    CREATE TABLE touched (object TEXT NOT NULL, version INTEGER NOT NULL, PRIMARY KEY (object, version)) WITHOUT ROWID;
    CREATE TABLE renamed (name TEXT NOT NULL, version INTEGER NOT NULL, before TEXT NOT NULL, PRIMARY KEY (name, version)) WITHOUT ROWID;
"""

KIND = Kind(
    owner="a Repository's",
    holds="ontology, map or event",
    rival="another process",
    application=0x534F4D52,  # `SOMR` in ASCII
    version=5,
    tables=journal.TABLES + TABLES,
    migrations=MIGRATIONS,
)


def repository_journal(path: Path) -> Journal:
    """Open a Repository's file, or make it; its folder must be there. Raises UsageError for a file that is damaged, is somebody else's,
    or cannot be written."""
    return Journal(path, SCHEMA, disk=Disk(path, KIND), archive=MapHistory())


class MapHistory:
    """The archive of a Repository's journal, as `journal.Archive`: each `Event`, and what leads back from it."""

    def __init__(self) -> None:
        self._pasts: dict[int, tuple[PastState, MapPages]] = {}

    def keep(self, record: object, db: sqlite3.Connection) -> None:
        """Raises Contradiction for a version that is there and is another one."""
        assert isinstance(record, Event), f"the history of a map is of events, not of {type(record).__name__}"
        known = happened_at(record.version, db)
        if known is None:
            _insert(record, db)
        elif _told(event_of(known)) != _told(record):
            raise Contradiction(f"version {record.version} of the map is not what comes of the same request now")

    def again(self, records: Sequence[object], state: Contents, db: sqlite3.Connection) -> None:
        for record in records:
            self.keep(record, db)
        (latest,) = db.execute("SELECT coalesce(max(version), 0) FROM events").fetchone()
        if latest > state.version:
            raise Contradiction(f"version {latest} of the map is not what comes of the same requests now, which lead to {state.version}")

    async def answer(self, task: object, disk: Disk) -> ArchivedEvents | MapPage | OntologyPage:
        match task:
            case PageOf(question=question, at_version=at):
                then, pages = self._pasts.get(at) or await self._past(task, disk)
                if isinstance(question, ReadMap):
                    return pages.page(at, question.after)
                return ontology_page(then.ontology, at, question.after, then.changed_at)
            case HistoryOf() | EventsOf():
                rows = await asyncio.wrap_future(disk.read(reading(task)))
                with disk.explained():
                    return await asyncio.to_thread(lambda: ArchivedEvents(tuple(map(event_of, rows))))
        raise TypeError(f"the history of a map has no {type(task).__name__}")

    async def _past(self, asked: PageOf, disk: Disk) -> tuple[PastState, MapPages]:
        way, changed_at = await asyncio.wrap_future(disk.read(lambda db: leading_back(asked.version, asked.at_version, db)))
        with disk.explained():
            # Going back through ten thousand events takes a while: neither the event loop nor the disk waits for it.
            found = await asyncio.to_thread(past, asked, way, changed_at)
        while len(self._pasts) >= KEPT:
            del self._pasts[next(iter(self._pasts))]
        self._pasts[asked.at_version] = kept = found, MapPages(found.map)
        return kept


def _insert(event: Event, db: sqlite3.Connection) -> None:
    revision, version = event.revision, event.version
    row = (
        version,
        event.at,
        event.author,
        _json(event.changes),
        _json(event.before),
        _json(revision) if revision is not None else None,
        _json(event.renamed) if event.renamed else None,
        event.undoes,
    )
    db.execute("INSERT INTO events VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)
    objects = [renaming for renaming in event.renamed if renaming.section is Section.OBJECTS]
    db.executemany("INSERT INTO renamed VALUES (?, ?, ?)", ((one.to, version, one.name) for one in objects))
    names = dict.fromkeys(name for change in event.changes for name in objects_of(change))
    db.executemany("INSERT INTO touched VALUES (?, ?)", ((name, version) for name in names))


def _json(value: object) -> str:
    return msgspec.json.encode(value).decode()


def _told(event: Event) -> object:
    """What an event says, in whatever order it says it: the order of what happened at once may be another after a restart."""
    revision = event.revision if event.revision is not None else Revision()
    told = (event.changes, event.before, tuple(revision.before.all_definitions()), tuple(revision.after.all_definitions()))
    lists = [sorted(msgspec.json.encode(one, order="sorted") for one in each) for each in told]
    return event.version, event.at, event.author, event.revision is None, event.renamed, event.undoes, lists
