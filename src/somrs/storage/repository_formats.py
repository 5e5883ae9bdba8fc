"""Earlier formats of the Repository's file, and the migration of each to the next.

Up to the third format, the state was in tables of its own: definitions, objects, facts, answers and subscriptions. The migration makes it
the first snapshot of a journal; the events stay as they are.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping

import msgspec

from somrs.kernel.durability import JournalCodec, JournaledComponent
from somrs.kernel.subscription import Subscription
from somrs.ontology.map import Map
from somrs.ontology.naming import Section
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, Ontology, RelationType
from somrs.repository.component import SCHEMA, Repository
from somrs.repository.state import Answer, Contents, DefinitionChange
from somrs.storage import journal_file
from somrs.storage.disk import Step, execute

DRIVERS = ("fixed_camera", "manipulator", "patrol")
"""Modules with drivers of simulated devices."""

_KINDS: dict[str, type[Definition]] = {kind.__name__: kind for kind in (AttributeType, RelationType, FunctionType, ObjectType, ServiceType)}

_OBJECT = msgspec.json.Decoder(Object)
_ARGUMENTS = msgspec.json.Decoder(tuple[str, ...])
_ANSWER: msgspec.json.Decoder[Answer] = msgspec.json.Decoder(Answer)


def _journaled(db: sqlite3.Connection) -> None:
    """Convert the tables with the state to a snapshot."""
    contents = _contents(db)
    execute(
        db,
        "DROP TABLE definitions; DROP TABLE objects; DROP TABLE facts; DROP TABLE answered; DROP TABLE subscriptions; DROP TABLE revised;"
        + journal_file.TABLES,
    )
    if contents is not None:
        journal_file.begin_with(db, JournaledComponent(Repository.restored(contents), SCHEMA), JournalCodec(SCHEMA))


def _contents(db: sqlite3.Connection) -> Contents | None:
    definitions = [
        msgspec.json.decode(document, type=_KINDS[kind])
        for kind, document in db.execute("SELECT kind, document FROM definitions ORDER BY rowid")
    ]
    if not definitions:
        return None
    objects = [_OBJECT.decode(document) for (document,) in db.execute("SELECT document FROM objects ORDER BY rowid")]
    rows = db.execute("SELECT relation, arguments FROM facts ORDER BY rowid")
    facts = [Fact(relation, _ARGUMENTS.decode(arguments)) for relation, arguments in rows]
    (version,) = db.execute("SELECT coalesce(max(version), 0) FROM events").fetchone()
    (first_version,) = db.execute("SELECT coalesce(max(version), 0) FROM events WHERE before IS NULL").fetchone()
    defined_at: dict[Section, dict[str, DefinitionChange]] = {}
    for section, name, defined_version, author in db.execute(
        "SELECT section, name, version, author FROM revised JOIN events USING (version)"
    ):
        defined_at.setdefault(Section(section), {})[name] = DefinitionChange(version=defined_version, author=author)
    answered = db.execute("SELECT request, answer FROM answered ORDER BY number")
    subscriptions = db.execute("SELECT address, until FROM subscriptions ORDER BY rowid")
    return Contents(
        ontology=Ontology(definitions),
        map=Map(objects, facts),
        version=version,
        changed_at=dict(db.execute("SELECT object, max(version) FROM touched GROUP BY object")),
        defined_at=defined_at,
        answered={request: _ANSWER.decode(answer) for request, answer in answered},
        subscriptions={address: Subscription(until=end_time, version=version) for address, end_time in subscriptions},
        since=first_version,
    )


MIGRATIONS: Mapping[int, Step] = {
    # Events of the first format do not have the state before them: `before` is NULL.
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
    # In later formats, the drivers of devices are in packages of their own.
    2: "".join(
        f"UPDATE definitions SET document = replace(document, '{old_module}:', '{new_module}:');"
        for old_module, new_module in (
            ("somrs.devices.person", "somrs.devices.person.device"),
            *((f"somrs.devices.simulator.{name}", f"somrs.devices.simulator.drivers.{name}") for name in DRIVERS),
        )
    ),
    3: _journaled,
    4: journal_file.WITHOUT_INDEX,
    # What became of the reports that events come from.
    5: "ALTER TABLE events ADD COLUMN reception TEXT;",
    # Objects that turned out to be others.
    6: """
    ALTER TABLE events ADD COLUMN merged TEXT;
    CREATE TABLE merged (name TEXT NOT NULL, version INTEGER NOT NULL, before TEXT NOT NULL, PRIMARY KEY (name, version, before))
      WITHOUT ROWID;
    """,
    7: journal_file.WITH_PARTS,
    8: journal_file.WITH_SUMS,
}
"""The migration to the next format, by the format of the file."""
