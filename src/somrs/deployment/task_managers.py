"""How many Task Managers a system has, given those that its data folder has had."""

from __future__ import annotations

import logging
from pathlib import Path

from somrs.client.addresses import task_manager_name
from somrs.errors import UsageError
from somrs.storage.archive import archive_file, archive_files

log = logging.getLogger(__name__)


def task_manager_count(data: Path, count: int | None, last_count: int = 1) -> int:
    """The number of Task Managers to start: `count`, or by default as many as the data folder has had. `last_count`: how many there were in
    the last run, whose journals may be elsewhere.

    Raises UsageError if that leaves out a Task Manager with open tasks.
    """
    kept_count = len(archive_files(data))
    if count is None:
        return max(kept_count, last_count)
    for number in range(count + 1, kept_count + 1):
        name, file = task_manager_name(number), archive_file(data, number)
        if open_tasks := _open_tasks(file):
            tasks = f"{len(open_tasks)} task{'s are' if len(open_tasks) > 1 else ' is'} open ({', '.join(open_tasks[:3])})"
            advice = f"start with `--task-managers {kept_count}` until they are over or cancelled; `--fresh` discards them with the map"
            raise UsageError(f"{name} would not run, and {tasks} in {file}: {advice}")
        log.warning("the ended tasks of %s stay in %s; they are listed again with `--task-managers %d`", name, file, number)
    return count


def _open_tasks(file: Path) -> tuple[str, ...]:
    """The tasks that have not ended, in the journal of a Task Manager that does not run."""
    from somrs.storage.journal import Journal
    from somrs.task_manager.manager import SCHEMA

    journal = Journal(file, SCHEMA)
    journal.close()
    return journal.open
