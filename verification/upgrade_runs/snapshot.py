"""Has each journal of a data folder hold the state of its component, instead of what led to it, as those of long runs do:
`python snapshot.py DATA`, run with the code of the release that wrote it."""

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
    """What the journal was written for."""
    with contextlib.closing(sqlite3.connect(path)) as db:
        (setting,) = db.execute("SELECT setting FROM life").fetchone()
    return str(setting)


def is_journal(path: Path) -> bool:
    with contextlib.closing(sqlite3.connect(path)) as db:
        return db.execute("SELECT 1 FROM sqlite_schema WHERE name = 'life'").fetchone() is not None


def journals_of(data: Path) -> list[Journal]:
    """All journals of a data folder, open."""
    files = {data / "task-manager.sqlite": TASK_MANAGER, data / "registry.sqlite": REGISTRY}
    files |= dict.fromkeys(sorted((data / "devices").glob("*.sqlite")), SERVICE_MANAGER)
    if is_journal(orders := data / "orders.sqlite"):
        # Schedulers of releases before had no journal, and their code no such schema.
        from somrs.scheduling.component import SCHEMA as SCHEDULER

        files[orders] = SCHEDULER
    return [Journal(path, schema, setting_of(path)) for path, schema in files.items()]


def refuse_empty_journal(address: str) -> Stateful:
    """There is a component in each."""
    raise AssertionError(f"the journal of {address} is empty")


def main(data: Path) -> None:
    for journal in journals_of(data):
        journaled, _ = journal.begin(journal.address, refuse_empty_journal)
        journal.snapshot(journaled)
        journal.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
