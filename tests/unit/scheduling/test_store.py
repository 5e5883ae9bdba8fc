"""The Scheduler's files of before: everything in them is gone on with, or they stay as they are."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path

import pytest

from somrs.errors import UsageError
from somrs.kernel.component import Notified, Send, Started, TimerFired
from somrs.kernel.durability import JournaledComponent
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.orders import Daily, Once, RunState
from somrs.protocol.messages.task_news import WatchTask
from somrs.scheduling.component import Scheduler
from somrs.scheduling.state import Located, OrdersDue
from somrs.scheduling.store import KIND, orders_journal
from somrs.storage import journal_file
from tests.support.paths import ROOT

FIRST = (ROOT / "tests/data/orders-format-1.sql").read_text()
"""A file that SO-MRS 0.2.0 wrote: two templates, four orders, what came of six times, of which three are open."""

OFTEN, MORNING, SINGLE, INSISTS = "58e7d2d7c9d6", "c8053a1241fc", "0087246d46c5", "a2913a9fb20f"


def create_file(path: Path, *scripts: str) -> Path:
    with contextlib.closing(sqlite3.connect(path)) as db:
        for script in scripts:
            db.executescript(script)
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return create_file(tmp_path / "orders.sqlite", FIRST)


def open_journaled(path: Path, address: str) -> JournaledComponent:
    orders_file = orders_journal(path)
    journaled, is_resumed = orders_file.begin(address, lambda address: pytest.fail("there is a book"))
    assert is_resumed
    orders_file.close()
    return journaled


def test_everything_in_a_file_of_before_is_gone_on_with(path: Path) -> None:
    journaled = open_journaled(path, "http://here/scheduler")
    assert isinstance(journaled.component, Scheduler)
    book = journaled.component.book
    assert [*book.templates] == ["Bring „Ö“; it", "Unused"]
    assert [blank.name for blank in book.template("Bring „Ö“; it").blanks] == ["Thing", "Place"]
    assert [*book.orders] == [OFTEN, MORNING, SINGLE, INSISTS]
    assert (book.order(MORNING).when, book.order(MORNING).enabled) == (Daily(at="07:30", days=(0, 2)), False)
    assert book.order(SINGLE).when == Once(at=90000.0)
    often = [(run.due, run.state, run.outcome, run.times, run.open) for run in book.runs_of(OFTEN)]
    assert often == [
        (3600.0, RunState.SUBMITTED, Outcome.ACCOMPLISHED, 1, False),
        (7200.0, RunState.REFUSED, None, 1, False),
        (18000.0, RunState.MISSED, None, 3, False),
        (21600.0, RunState.SUBMITTED, None, 1, True),
        (25200.0, RunState.SUBMITTING, None, 1, True),
    ]
    journaled.handle(journaled.make_entry(Notified(Located("http://there/repository", "http://there/task-manager")), 25201.0))
    journaled.handle(journaled.make_entry(Started("http://here/scheduler"), 25201.0))
    effects = journaled.handle(journaled.make_entry(TimerFired(OrdersDue()), 25201.0))
    messages = [effect.message for effect, _ in effects if isinstance(effect, Send)]
    assert [message.body.task for message in messages if isinstance(message.body, WatchTask)] == [
        run.task for id in (OFTEN, INSISTS) for run in book.runs_of(id) if run.open
    ], "what became of those that were open"
    assert {message.header.recipient for message in messages} == {"http://there/task-manager"}
    assert {message.header.reply_to for message in messages} == {"http://here/scheduler"}


def test_an_old_file_is_a_journal_from_then_on(path: Path, tmp_path: Path) -> None:
    first = open_journaled(path, "http://here/scheduler")
    second = open_journaled(path, "http://elsewhere/scheduler")
    assert second.component.state.book == first.component.state.book
    assert second.component.state.questions == first.component.state.questions
    orders_journal(new := tmp_path / "new.sqlite").close()
    assert shape(path) == shape(new)
    assert shape(path)[1:] == (KIND.application, KIND.version) == (journal_file.KIND.application, journal_file.KIND.version)


def shape(path: Path) -> tuple[set[str], int, int]:
    with contextlib.closing(sqlite3.connect(path)) as db:
        tables = {name for (name,) in db.execute("SELECT name FROM sqlite_schema WHERE name NOT LIKE 'sqlite_%'")}
        (application,) = db.execute("PRAGMA application_id").fetchone()
        (version,) = db.execute("PRAGMA user_version").fetchone()
    return tables, application, version


@pytest.mark.parametrize(
    "damage",
    [
        f"UPDATE orders SET document = '{{}}' WHERE id = '{SINGLE}';",
        "UPDATE runs SET document = 'nothing' WHERE due = 7200.0;",
        "ALTER TABLE templates RENAME TO others;",
    ],
)
def test_a_file_that_cannot_be_read_stays_as_it_was(damage: str, path: Path) -> None:
    create_file(path, damage)
    dump_before = dump(path)
    for _ in range(2):
        with pytest.raises(UsageError, match=r"orders\.sqlite"):
            orders_journal(path)
    assert dump(path) == dump_before
    assert shape(path)[1:] == (0x534F4D4F, 1)


def dump(path: Path) -> list[str]:
    with contextlib.closing(sqlite3.connect(path)) as db:
        return [*db.iterdump()]


def test_an_interrupted_change_leaves_the_file_as_it_was(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dump_before = dump(path)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(journal_file, "begin_with", interrupted)
        with pytest.raises(KeyboardInterrupt):
            orders_journal(path)
    assert dump(path) == dump_before
    assert len(open_journaled(path, "http://here/scheduler").component.state.book.orders) == 4
