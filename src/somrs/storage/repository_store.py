"""The Repository's file: the journal of its inputs, and the archive of all events of the ontology and the map.

Documents in the archive are JSON, so that other tools can read them. `store_events.py` reads events; `repository_formats.py` has the
earlier formats.
"""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Sequence
from pathlib import Path

import msgspec

from somrs.ontology.naming import Section
from somrs.ontology.objects import objects_of
from somrs.protocol.messages.knowledge import Event, MapPage, OntologyPage, ReadMap, Revision, Rows
from somrs.repository.component import SCHEMA
from somrs.repository.pages import map_page, ontology_page
from somrs.repository.rollback import PastState
from somrs.repository.state import ArchivedEvents, Contents, EventsOf, HistoryOf, LargeQuery, PageOf
from somrs.storage import journal_file
from somrs.storage.disk import Disk, Kind
from somrs.storage.journal import Contradiction, Journal, Log
from somrs.storage.large_queries import LargeQueries
from somrs.storage.repository_formats import MIGRATIONS
from somrs.storage.store_events import event_of, read_event, read_job, read_way_back, restore_past

MAX_PAST_VERSIONS = 4
"""The number of past versions that are kept in memory, for their next pages."""

_TABLES = """
    CREATE TABLE events (version INTEGER PRIMARY KEY, at REAL NOT NULL, author TEXT NOT NULL, changes TEXT NOT NULL, before TEXT,
      revision TEXT, renamed TEXT, undoes INTEGER, reception TEXT, merged TEXT);
    CREATE INDEX revisions ON events (version) WHERE revision IS NOT NULL;
    CREATE TABLE touched (object TEXT NOT NULL, version INTEGER NOT NULL, PRIMARY KEY (object, version)) WITHOUT ROWID;
    CREATE TABLE renamed (name TEXT NOT NULL, version INTEGER NOT NULL, before TEXT NOT NULL, PRIMARY KEY (name, version)) WITHOUT ROWID;
    CREATE TABLE merged (name TEXT NOT NULL, version INTEGER NOT NULL, before TEXT NOT NULL, PRIMARY KEY (name, version, before))
      WITHOUT ROWID;
"""

KIND = Kind(
    owner="a Repository's",
    content="ontology, map or event",
    rival="another process",
    application=0x534F4D52,  # `SOMR` in ASCII
    version=9,
    tables=journal_file.TABLES + _TABLES,
    migrations=MIGRATIONS,
)


def repository_journal(path: Path, log: Log | None = None) -> Journal:
    """Open a Repository's file, or create it; its folder must exist.

    Raises:
        UsageError: the file is damaged, of another kind, or not writable.
    """
    return Journal(path, SCHEMA, disk=Disk(path, KIND, syncs=log is None), archive=_MapHistory(), log=log)


class _MapHistory:
    """The archive of a Repository's journal, as `journal.Archive`: each `Event`, with the changes that revert it."""

    def __init__(self) -> None:
        self._pasts: dict[int, PastState] = {}
        self._large_queries = LargeQueries()

    def store_record(self, record: object, db: sqlite3.Connection) -> None:
        """Store an event. Raises Contradiction when a different event is stored for its version."""
        assert isinstance(record, Event), f"the history of a map is of events, not of {type(record).__name__}"
        row = read_event(record.version, db)
        if row is None:
            _insert(record, db)
        elif _comparable_event(event_of(row)) != _comparable_event(record):
            raise Contradiction(f"version {record.version} of the map differs from the result of the same request now")

    def store_replayed(self, records: Sequence[object], state: Contents, db: sqlite3.Connection) -> None:
        for record in records:
            self.store_record(record, db)
        (latest,) = db.execute("SELECT coalesce(max(version), 0) FROM events").fetchone()
        if latest > state.version:
            raise Contradiction(f"version {latest} of the map is not reached by the same requests now, which lead to {state.version}")

    async def answer(self, task: object, disk: Disk) -> ArchivedEvents | MapPage | OntologyPage | Rows:
        match task:
            case LargeQuery():
                return await self._large_queries.answer(task)
            case PageOf(question=question, at_version=version):
                past_state = self._pasts.get(version) or await self._load_past(task, disk)
                if isinstance(question, ReadMap):
                    return map_page(past_state.map, version, question.after)
                return ontology_page(past_state.ontology, version, question.after, past_state.changed_at)
            case HistoryOf() | EventsOf():
                rows = await asyncio.wrap_future(disk.read(read_job(task)))
                with disk.explained():
                    return await asyncio.to_thread(lambda: ArchivedEvents(tuple(map(event_of, rows))))
        raise TypeError(f"the history of a map has no {type(task).__name__}")

    async def _load_past(self, page_request: PageOf, disk: Disk) -> PastState:
        way, changed_at = await asyncio.wrap_future(disk.read(lambda db: read_way_back(page_request.version, page_request.at_version, db)))
        with disk.explained():
            # Reverting ten thousand events takes a while: neither the event loop nor the disk thread waits for it.
            past_state = await asyncio.to_thread(restore_past, page_request, way, changed_at)
        while len(self._pasts) >= MAX_PAST_VERSIONS:
            del self._pasts[next(iter(self._pasts))]
        self._pasts[page_request.at_version] = past_state
        return past_state


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
        _json(event.reception) if event.reception is not None else None,
        _json(event.merged) if event.merged else None,
    )
    db.execute("INSERT INTO events VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", row)
    objects = [renaming for renaming in event.renamed if renaming.section is Section.OBJECTS]
    db.executemany("INSERT INTO renamed VALUES (?, ?, ?)", ((renaming.to, version, renaming.name) for renaming in objects))
    db.executemany("INSERT INTO merged VALUES (?, ?, ?)", ((merging.into, version, merging.name) for merging in event.merged))
    if event.undoes is not None:
        db.execute("DELETE FROM merged WHERE version = ?", (event.undoes,))  # they are two objects after all
    changed = (name for change in event.changes for name in objects_of(change))
    names = dict.fromkeys((*changed, *(merging.into for merging in event.merged)))
    db.executemany("INSERT INTO touched VALUES (?, ?)", ((name, version) for name in names))


def _json(value: object) -> str:
    return msgspec.json.encode(value).decode()


def _comparable_event(event: Event) -> object:
    """Return an event's contents in a canonical order: the order of simultaneous changes may differ after a restart."""
    revision = event.revision if event.revision is not None else Revision()
    groups = (event.changes, event.before, tuple(revision.before.all_definitions()), tuple(revision.after.all_definitions()))
    lists = [sorted(msgspec.json.encode(item, order="sorted") for item in group) for group in groups]
    return event.version, event.at, event.author, event.revision is None, event.renamed, event.undoes, event.reception, event.merged, lists
