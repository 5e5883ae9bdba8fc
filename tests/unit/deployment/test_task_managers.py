"""The number of Task Managers of a system: as many as asked for, or as its data folder has had."""

from __future__ import annotations

from pathlib import Path

import pytest

from somrs.deployment.task_managers import task_manager_count
from somrs.errors import UsageError
from somrs.storage.archive import archive_file
from somrs.storage.journal import Journal
from somrs.task_manager.manager import SCHEMA, TaskManager


def make_journal(data: Path, number: int, *open_tasks: str) -> None:
    """The journal of a Task Manager that has run, and stopped with these tasks open."""
    journal = Journal(archive_file(data, number), SCHEMA)
    manager, _ = journal.begin("http://here/task-manager", lambda address: TaskManager(address, repository="", registry=""))
    assert isinstance(manager.component, TaskManager)
    manager.component.state.running.extend(open_tasks)
    journal.note(manager.component)
    journal.close()


def test_a_new_system_has_one(tmp_path: Path) -> None:
    assert task_manager_count(tmp_path, None) == 1
    assert task_manager_count(tmp_path, 3) == 3


def test_a_system_goes_on_with_as_many_as_it_had_unless_it_is_to_have_more(tmp_path: Path) -> None:
    make_journal(tmp_path, 1)
    make_journal(tmp_path, 2, "urn:task")
    assert task_manager_count(tmp_path, None) == 2
    assert task_manager_count(tmp_path, 3) == 3


def test_a_system_with_its_journals_elsewhere_goes_on_with_as_many_as_it_had(tmp_path: Path) -> None:
    assert task_manager_count(tmp_path, None, last_count=2) == 2
    assert task_manager_count(tmp_path, 3, last_count=2) == 3


def test_one_with_open_tasks_is_not_left_out(tmp_path: Path) -> None:
    make_journal(tmp_path, 1)
    make_journal(tmp_path, 2)
    make_journal(tmp_path, 3, "urn:a", "urn:b")
    with pytest.raises(UsageError, match=r"TaskManager3 would not run, and 2 tasks are open \(urn:a, urn:b\).*--task-managers 3"):
        task_manager_count(tmp_path, 1)
    assert task_manager_count(tmp_path, 3) == 3


def test_one_without_open_tasks_can_be_left_out_and_where_its_ended_tasks_are_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    make_journal(tmp_path, 1, "urn:a")
    make_journal(tmp_path, 2)
    assert task_manager_count(tmp_path, 1) == 1
    assert f"the ended tasks of TaskManager2 stay in {archive_file(tmp_path, 2)}" in caplog.text
