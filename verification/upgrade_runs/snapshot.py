"""Replaces the records in each journal of a data folder by a snapshot of the component's state, as in long runs.

`python snapshot.py DATA` runs with the code of the release that wrote the journals.
"""

from __future__ import annotations

import contextlib
import sqlite3
import sys
from pathlib import Path

from somrs.kernel.component import Stateful
from somrs.registry.component import SCHEMA as REGISTRY
from somrs.service_manager.participant.participant import SCHEMA as SERVICE_MANAGER
from somrs.storage.journal import Journal
from somrs.task_manager.manager import SCHEMA as TASK_MANAGER


def setting_of(path: Path) -> str:
    """Return the kind of component that the journal belongs to."""
    with contextlib.closing(sqlite3.connect(path)) as db:
        (setting,) = db.execute("SELECT setting FROM life").fetchone()
    return str(setting)


def is_journal(path: Path) -> bool:
    with contextlib.closing(sqlite3.connect(path)) as db:
        return db.execute("SELECT 1 FROM sqlite_schema WHERE name = 'life'").fetchone() is not None


def journals_of(data: Path) -> list[Journal]:
    """Open all journals of a data folder."""
    files = {data / "task-manager.sqlite": TASK_MANAGER, data / "registry.sqlite": REGISTRY}
    files |= dict.fromkeys(sorted((data / "devices").glob("*.sqlite")), SERVICE_MANAGER)
    if is_journal(orders := data / "orders.sqlite"):
        # In earlier releases the Scheduler had no journal, and the module no SCHEMA.
        from somrs.scheduling.component import SCHEMA as SCHEDULER

        files[orders] = SCHEDULER
    return [Journal(path, schema, setting_of(path)) for path, schema in files.items()]


def refuse_empty_journal(address: str) -> Stateful:
    """Raise an error: each journal has a component's state."""
    raise AssertionError(f"the journal of {address} is empty")


def main(data: Path) -> None:
    for journal in journals_of(data):
        journaled, _ = journal.begin(journal.address, refuse_empty_journal)
        journal.snapshot(journaled)
        journal.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
