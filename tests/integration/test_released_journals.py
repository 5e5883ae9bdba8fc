"""The journals of each release are read by this program, which goes on with what was under way in them."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest

from somrs.kernel.codec import decode_untyped, encode
from somrs.kernel.component import Send, Started, TimerFired
from somrs.kernel.durability import JournaledComponent
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.task_views import Phase
from somrs.registry.component import Registry
from somrs.registry.state import LeasesDue
from somrs.repository.component import Repository
from somrs.scheduling.book import Book
from somrs.scheduling.component import Scheduler
from somrs.scheduling.store import orders_journal
from somrs.storage.journal import Journal
from somrs.storage.repository_store import repository_journal
from somrs.task_manager.manager import SCHEMA, TaskManager
from tests.support.paths import ROOT
from verification.upgrade_runs.snapshot import journals_of, refuse_empty_journal

RELEASES = sorted(folder for folder in (ROOT / "tests" / "data" / "journals").iterdir())
KILLED_AND_LONG_RUN = [
    pytest.param(release, release / part, id=f"{release.name}-{name}")
    for release in RELEASES
    for part, name in (("", "killed"), ("snapshots", "long-run"))
]


def unpack(packed: Path, data: Path) -> Path:
    """A data folder with the files of a release."""
    for file in packed.rglob("*.sqlite.gz"):
        inner = file.relative_to(packed)
        if inner.parts[0] != "snapshots":
            target = data / inner.with_suffix("")
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(gzip.decompress(file.read_bytes()))
    return data


def resume_journal(journal: Journal) -> JournaledComponent:
    journaled, is_resumed = journal.begin(journal.address, refuse_empty_journal)
    assert is_resumed
    return journaled


@pytest.mark.parametrize(("release", "packed"), KILLED_AND_LONG_RUN)
def test_tasks_that_were_under_way_go_on(release: Path, packed: Path, tmp_path: Path) -> None:
    (journal, *other_journals) = journals_of(unpack(packed, tmp_path))
    for other_journal in other_journals:
        other_journal.close()
    journaled = resume_journal(journal)
    assert isinstance(journaled.component, TaskManager)
    open_goals: dict[str, str] = json.loads((release / "open.json").read_text())
    tasks = journaled.component.state.tasks
    assert {id: task.task.effect for id, task in tasks.items() if task.phase is not Phase.ENDED} == open_goals
    assert [task.outcome for task in tasks.values() if task.phase is Phase.ENDED] == [Outcome.ACCOMPLISHED]
    completed_work = [work for task in tasks.values() for work in task.log if work.state is State.COMPLETED]
    assert completed_work
    assert all(work.goal is GoalKind.TASK for work in completed_work)
    undoing = [execution.kind for task in tasks.values() for execution in task.side_goals]
    compensated = [work for task in tasks.values() for work in task.log if work.state is State.COMPENSATING]
    assert undoing or compensated, "a task was being undone"
    effects = journaled.handle(journaled.make_entry(Started(journal.address), journaled.time))
    for timer in [*journaled.pending.timers]:
        effects += journaled.handle(journaled.make_entry(TimerFired(timer), journaled.time + 3600))
    assert any(isinstance(effect, Send) for effect, _ in effects), "it turns to the participants again"
    journal.close()


def content(journaled: JournaledComponent) -> Any:
    """The state, with what is in a set or a list in an order that depends on nothing."""

    def ordered(value: Any) -> Any:
        match value:
            case dict():
                return {key: ordered(item) for key, item in value.items()}
            case list():
                return sorted(map(ordered, value), key=repr)
            case scalar:
                return scalar

    return ordered(decode_untyped(encode(journaled.component.state)))


@pytest.mark.parametrize(("release", "packed"), KILLED_AND_LONG_RUN)
def test_what_was_read_once_is_kept_as_this_program_writes_it(release: Path, packed: Path, tmp_path: Path) -> None:
    data = unpack(packed, tmp_path)
    states_before = []
    for journal in journals_of(data):
        states_before.append((journal.open, content(resume_journal(journal))))
        journal.close()
    states_after = []
    for journal in journals_of(data):
        states_after.append((journal.open, content(resume_journal(journal))))
        journal.close()
    assert states_before == states_after
    assert len(states_before) >= 4, "the Task Manager, the Service Registry and devices"


@pytest.mark.parametrize(("release", "packed"), KILLED_AND_LONG_RUN)
def test_the_map_is_as_it_was(release: Path, packed: Path, tmp_path: Path) -> None:
    data = unpack(packed, tmp_path)
    maps = []
    for address in ("here", "elsewhere"):
        journal = repository_journal(data / "repository.sqlite")
        journaled, is_resumed = journal.begin(address, refuse_empty_journal)
        assert is_resumed
        assert isinstance(journaled.component, Repository)
        contents = journaled.component.contents
        assert contents.changed_at["letter"] > 0, "the first task saw to that"
        maps.append((contents.version, contents.map, len(contents.answered)))
        journal.close()
    assert maps[0] == maps[1]
    assert maps[0][0] > 0


@pytest.mark.parametrize(("release", "packed"), KILLED_AND_LONG_RUN)
def test_the_book_of_orders_is_as_it_was(release: Path, packed: Path, tmp_path: Path) -> None:
    data = unpack(packed, tmp_path)
    books = []
    for address in ("here", "elsewhere"):
        journal = orders_journal(data / "orders.sqlite")
        journaled, is_resumed = journal.begin(address, refuse_empty_journal)
        assert is_resumed
        assert isinstance(journaled.component, Scheduler)
        books.append(journaled.component.book)
        journal.close()
    assert books == [Book(), Book()], "nobody had given orders"
    journals = journals_of(data)
    assert data / "orders.sqlite" in [journal.disk.path for journal in journals]
    for journal in journals:
        journal.close()


@pytest.mark.parametrize(("release", "packed"), KILLED_AND_LONG_RUN)
def test_services_on_offer_still_are_and_who_leaves_is_remembered(release: Path, packed: Path, tmp_path: Path) -> None:
    for journal in journals_of(unpack(packed, tmp_path)):
        if journal.disk.path.name == "registry.sqlite":
            journaled = resume_journal(journal)
            assert isinstance(journaled.component, Registry)
            providers = {*journaled.component.state.providers}
            assert providers
            journaled.handle(journaled.make_entry(TimerFired(LeasesDue()), journaled.time + 3600))
            log = journaled.component.state.presence_log
            assert {change.device for change in log if not change.joined and change.at < journaled.time} >= providers
        journal.close()


def test_there_are_journals_of_each_version_of_the_state() -> None:
    """Whoever changes the state has the release before in `RELEASES`, so that its migration is seen to work."""
    assert set(SCHEMA.migrations) == {*range(1, SCHEMA.version)}
    assert len(RELEASES) >= SCHEMA.version - 1
