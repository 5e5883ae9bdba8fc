"""A journal on a real disk: what was acknowledged is there, whatever happened to the process, and its owner goes on with it."""

from __future__ import annotations

import asyncio
import contextlib
import sqlite3
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Struct, structs

from somrs.client.addresses import Addresses
from somrs.deployment.components import run_task_manager
from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.errors import UsageError
from somrs.kernel.codec import Migration, Schema
from somrs.kernel.component import Answered, DeliveryFailed, ErrorAnswer, Input, Received, Record, Started, TimerFired
from somrs.kernel.durability import Entry, JournalCodec, JournaledComponent, PendingEffects
from somrs.kernel.replica import ReplicaDue
from somrs.planner.model.plan import Link, NoPlan, Plan, Step
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.storage.journal import Journal
from somrs.storage.journal_file import KIND
from somrs.task_manager.manager import SCHEMA as TASK_MANAGER
from somrs.task_manager.timers import AnswerDue, BidsDue, PlanWanted, SilenceDue
from tests.support.bodies import KINDS, messages
from tests.support.examples import examples
from tests.support.hang import HANG_TIME
from tests.support.killed_writer import run_until_killed
from tests.support.ledger import SCHEMA, Ledger, LedgerState, amount_message, doubled

WRITTEN = JournalCodec(TASK_MANAGER)

ADDRESS = "http://127.0.0.1:7001/ledger"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "ledger.sqlite"


def make_ledger(address: str) -> Ledger:
    return Ledger(address=address)


class Shelf:
    """A ledger and its journal, without a node: what is said is thrown away, and questions are answered on the spot."""

    def __init__(self, path: Path, setting: str = "", address: str = ADDRESS, schema: Schema = SCHEMA) -> None:
        self.journal = Journal(path, schema, setting)
        try:
            self.journaled, self.is_resumed = self.journal.begin(address, make_ledger)
        except UsageError:
            self.journal.close()
            raise
        self.sent_count = 0

    @property
    def ledger(self) -> Ledger:
        assert isinstance(self.journaled.component, Ledger)
        return self.journaled.component

    @property
    def pending(self) -> PendingEffects:
        return self.journaled.pending

    def feed(self, event: Input, now: float = 1.0) -> None:
        entry = self.journaled.make_entry(event, now)
        self.journal.append(entry)
        self.journaled.handle(entry)
        self.journal.note(self.journaled.component)

    def send_amount(self, amount: int) -> None:
        self.feed(Received(amount_message(self.sent_count, amount)))
        self.sent_count += 1

    def answer(self) -> None:
        for question, task in [*self.pending.questions.items()]:
            self.feed(Answered(question, doubled(task)))

    def reopen(self) -> Shelf:
        self.journal.close()
        return Shelf(self.journal.disk.path)


@pytest.fixture
def shelf(path: Path) -> Iterator[Shelf]:
    shelf = Shelf(path)
    yield shelf
    shelf.journal.close()


# What is written


@examples(10)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_every_message_is_read_as_it_was_written(kind: type, data: st.DataObject) -> None:
    message = data.draw(messages(kind))
    entries = [Entry(1, 1.5, Received(message)), Entry(2, 2.5, DeliveryFailed(message, "nobody is there"), (4, 9))]
    assert WRITTEN.decode_batch(WRITTEN.encode_batch(map(WRITTEN.encode_entry, entries))) == entries


def test_every_other_input_is_read_as_it_was_written() -> None:
    step = Step("s1", "TransferObject", {"Object": Name("Jar1")}, parse("Jar1 isOn Table2 AND NOT Jar1.Working = TRUE"), provider="R1")
    plan = Plan((step,), (Link("s1", "s2", "Jar1 isOn Table2"),))
    question, values = (
        PlanWanted("task", 1, 0, 2),
        (plan, NoPlan("no", separate_reasons=("no", "never")), ErrorAnswer("broken"), Records(records=(), more=True)),
    )
    timers = (BidsDue("task", 1), SilenceDue("task", "Robot1"), AnswerDue("request"), ReplicaDue())
    events: list[Input] = [Started(ADDRESS), *map(TimerFired, timers), *(Answered(question, value) for value in values)]
    entries = [Entry(number, 0.1 * number, event) for number, event in enumerate(events)]
    assert WRITTEN.decode_batch(WRITTEN.encode_batch(map(WRITTEN.encode_entry, entries))) == entries


def test_an_exception_is_kept_as_what_it_says() -> None:
    journaled = JournaledComponent(Ledger(), SCHEMA)
    entry = journaled.make_entry(Answered("q", ZeroDivisionError("division by zero")), 1.0)
    ledgers = JournalCodec(SCHEMA)
    assert ledgers.decode_batch(ledgers.encode_batch([ledgers.encode_entry(entry)]))[0].event == Answered(
        "q", ErrorAnswer("division by zero")
    )


# What is there again


def test_a_new_file_makes_its_component(shelf: Shelf) -> None:
    assert (shelf.is_resumed, shelf.ledger.address, shelf.journal.open) == (False, ADDRESS, ())


@pytest.mark.parametrize("snapshot", [None, 0, 1, 2, 3])
def test_all_is_as_it_was(shelf: Shelf, snapshot: int | None) -> None:
    for number, amount in enumerate((5, 7, 11)):
        shelf.send_amount(amount)
        if number == 1:
            shelf.answer()
            shelf.feed(TimerFired(next(iter(shelf.ledger.amounts))))
            shelf.journaled.mark_delivered(1)
        if number == snapshot:
            shelf.journal.snapshot(shelf.journaled)
    if snapshot == 3:
        shelf.journal.snapshot(shelf.journaled)
    reopened_shelf = shelf.reopen()
    assert reopened_shelf.is_resumed
    assert reopened_shelf.ledger.state == shelf.ledger.state
    assert reopened_shelf.pending == shelf.pending
    assert (reopened_shelf.journaled.number, reopened_shelf.journaled.time) == (shelf.journaled.number, shelf.journaled.time)
    assert [*reopened_shelf.journal.open] == reopened_shelf.ledger.open == [amount_message(2, 0).header.message_id]
    reopened_shelf.journal.close()


def test_snapshots_make_room(shelf: Shelf) -> None:
    for amount in range(600):
        shelf.send_amount(amount)
        if amount % 100 == 0:
            shelf.answer()
            for number in [*shelf.pending.messages]:
                shelf.journaled.mark_delivered(number)
            shelf.journal.snapshot(shelf.journaled)
    reopened_shelf = shelf.reopen()
    assert reopened_shelf.ledger.total == sum(range(600))
    (entries,) = reopened_shelf.journal.disk.write_and_wait(lambda db: db.execute("SELECT count(*) FROM entries").fetchone())
    assert entries <= 100
    reopened_shelf.journal.close()


def test_a_defect_that_was_met_is_met_again_and_changes_nothing(path: Path) -> None:
    shelf = Shelf(path)
    shelf.send_amount(1)
    with pytest.raises(ValueError, match="invalid literal"):
        shelf.feed(Received(structs.replace(amount_message(8, 0), body=structs.replace(amount_message(8, 0).body, task="many"))))
    shelf.send_amount(2)
    reopened_shelf = shelf.reopen()
    assert reopened_shelf.ledger.total == 3
    reopened_shelf.journal.close()


def test_what_cannot_be_kept_is_not_handled_either(path: Path) -> None:
    shelf = Shelf(path)
    shelf.send_amount(1)
    for event in (
        Answered("q", object()),
        Answered("q", 5),
        Answered("q", [ErrorAnswer("t")]),
        DeliveryFailed(amount_message(1, 1), "\ud800"),
    ):
        with pytest.raises((TypeError, UnicodeEncodeError)):
            shelf.feed(event)
    shelf.send_amount(2)
    reopened_shelf = shelf.reopen()
    assert reopened_shelf.ledger.total == 3
    assert not reopened_shelf.ledger.doubled
    reopened_shelf.journal.close()


def test_time_does_not_go_back_behind_what_was_handled(shelf: Shelf) -> None:
    shelf.feed(Received(amount_message(0, 1)), now=2e9)
    reopened_shelf = shelf.reopen()
    assert reopened_shelf.journaled.make_entry(TimerFired("x"), 1e9).time == 2e9
    reopened_shelf.journal.close()


# The archive


def records(shelf: Shelf, request: ReadRecords) -> tuple[TaskRecord, ...]:
    result = asyncio.run(shelf.journal.carry_out(request))
    assert isinstance(result, Records)
    return result.records


def test_a_record_that_was_lost_with_the_process_is_kept_when_it_is_back(shelf: Shelf) -> None:
    shelf.send_amount(4)  # its record is among the effects, which are thrown away
    reopened_shelf = shelf.reopen()
    (record,) = records(reopened_shelf, ReadRecords(task=amount_message(0, 0).header.message_id))
    assert record.effect == "4"
    reopened_shelf.journal.close()


# Accidents

WRITER = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tests.integration.test_journal import Shelf

shelf = Shelf(Path(sys.argv[1]))
shelf.sent_count = len(shelf.ledger.amounts)
while True:
    shelf.send_amount(shelf.sent_count)
    if shelf.sent_count % 7 == 0:
        shelf.journal.snapshot(shelf.journaled)
    while shelf.journal.disk.durable < shelf.journal.disk.position:
        pass
    print(shelf.sent_count, flush=True)
"""


def test_nothing_that_was_acknowledged_is_lost_when_the_process_is_killed(path: Path) -> None:
    acknowledged = 0
    for lines in (30, 7, 1):
        acknowledged += run_until_killed(WRITER, path, lines)
        shelf = Shelf(path)
        amount_count = len(shelf.ledger.amounts)
        assert acknowledged <= amount_count <= acknowledged + 1
        assert sorted(shelf.ledger.amounts.values()) == [*range(amount_count)]
        assert len(shelf.pending.questions) == amount_count
        assert len(shelf.pending.messages) == amount_count
        acknowledged = amount_count
        shelf.journal.close()


def test_what_comes_together_is_written_together(shelf: Shelf) -> None:
    """Each alone takes a commit; all that come while the disk is busy take one."""
    disk = shelf.journal.disk

    def rows() -> int:
        return int(disk.write_and_wait(lambda db: db.execute("SELECT count(*) FROM entries").fetchone()[0]))

    row_count = rows()
    for _ in range(30):
        shelf.feed(TimerFired("tick"))
        while disk.durable < disk.position:
            time.sleep(0)
    assert rows() == row_count + 30
    release_event = threading.Event()
    busy = disk.read(lambda db: release_event.wait(HANG_TIME))
    for _ in range(300):
        shelf.feed(TimerFired("tick"))
    release_event.set()
    assert busy.result()
    assert rows() == row_count + 31
    assert disk.durable == disk.position


def test_an_interrupted_snapshot_leaves_the_one_before(shelf: Shelf) -> None:
    shelf.send_amount(1)
    shelf.journal.snapshot(shelf.journaled)
    shelf.send_amount(2)

    def torn(db: sqlite3.Connection) -> None:
        db.execute("DELETE FROM snapshot")
        db.execute("INSERT INTO snapshot VALUES ('', 9, 9, 9, x'00')")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shelf.journal.disk.write_and_wait(torn)
    reopened_shelf = shelf.reopen()
    assert reopened_shelf.ledger.total == 3
    reopened_shelf.journal.close()


def alter_file(path: Path, statement: str, *values: object) -> None:
    """Change the file by other means."""
    with sqlite3.connect(path) as db:
        db.execute(statement, values)
    db.close()


def test_a_state_that_is_damaged_is_said_to_be(shelf: Shelf) -> None:
    shelf.send_amount(1)
    shelf.journal.close()
    alter_file(shelf.journal.disk.path, "UPDATE snapshot SET state = CAST(substr(state, 2) AS BLOB)")
    with pytest.raises(UsageError, match=r"is damaged: its state is not the one .* 1 task is open .* move the file away"):
        shelf.reopen()


def test_an_entry_that_is_missing_is_noticed(shelf: Shelf) -> None:
    for amount in range(3):
        shelf.send_amount(amount)
        shelf.journal.disk.write_and_wait(lambda db: None)
    shelf.journal.close()
    alter_file(shelf.journal.disk.path, "DELETE FROM entries WHERE last = 2")
    with pytest.raises(UsageError, match="entry 2 is missing before entry 3"):
        shelf.reopen()


@pytest.mark.parametrize("change", ["schema", "setting", "address"])
def test_with_nothing_open_another_begins_anew(shelf: Shelf, change: str) -> None:
    shelf.send_amount(1)
    shelf.answer()
    shelf.journal.store_record(
        next(effect.entry for effect in Ledger().handle(Received(amount_message(0, 1)), 1.0) if isinstance(effect, Record))
    )
    assert not shelf.ledger.open
    shelf.journal.close()
    alter_file(shelf.journal.disk.path, f"UPDATE life SET {change} = ?", 9 if change == "schema" else "something else")
    reopened_shelf = shelf.reopen()
    assert (reopened_shelf.is_resumed, reopened_shelf.ledger.total) == (False, 0)
    assert len(records(reopened_shelf, ReadRecords())) == 1, "what is over stays known"
    reopened_shelf.send_amount(2)
    reopened_shelf = reopened_shelf.reopen()
    assert (reopened_shelf.is_resumed, reopened_shelf.ledger.total) == (True, 2)
    reopened_shelf.journal.close()


def test_it_goes_on_at_the_same_address_with_another_scheme(path: Path) -> None:
    """As of components that have got certificates."""
    plain, secure = "http://127.0.0.1:7001/registry", "https://127.0.0.1:7001/registry"
    sender, foreigner = "http://127.0.0.1:7002/devices/Robot1", "http://127.0.0.1:9000/robot"
    shelf = Shelf(path, address=plain)
    for number, address in enumerate((sender, foreigner)):
        shelf.feed(Received(amount_message(number, 5, reply_to=address)))
    state, number = shelf.ledger.state, shelf.journaled.number
    shelf.journal.close()
    for address, sent_to in ((secure, sender.replace("http:", "https:")), (plain, sender)):
        moved_shelf = Shelf(path, address=address)
        assert moved_shelf.is_resumed
        assert moved_shelf.ledger.state == structs.replace(state, address=address)
        assert moved_shelf.journaled.number == number
        assert {message.message.header.sender for message in moved_shelf.pending.messages.values()} == {address}
        assert {message.message.header.recipient for message in moved_shelf.pending.messages.values()} >= {sent_to, foreigner}
        moved_shelf.journal.close()


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("setting", "was written for something else, and this is for "),
        ("address", f"belongs to something else, where other components expect its owner, and this is {ADDRESS}"),
    ],
)
def test_with_something_open_another_is_told_what_to_do(shelf: Shelf, change: str, problem: str) -> None:
    for amount in range(5):
        shelf.send_amount(amount)
    shelf.journal.close()
    alter_file(shelf.journal.disk.path, f"UPDATE life SET {change} = 'something else'")
    first = amount_message(0, 0).header.message_id
    with pytest.raises(UsageError, match=f"ledger.sqlite: {problem}.*; 5 tasks are open \\({first}, .*\\): use the earlier program"):
        shelf.reopen()


@pytest.mark.parametrize("version", [0, 2])
def test_a_state_of_a_version_that_cannot_be_read_is_said_to_be_so(shelf: Shelf, version: int) -> None:
    shelf.send_amount(1)
    shelf.journal.close()
    alter_file(shelf.journal.disk.path, f"UPDATE life SET program = 'SO-MRS 0.1', schema = {version}")
    with pytest.raises(UsageError, match=r"was written by SO-MRS 0\.1, whose state SO-MRS .* cannot read; 1 task is open"):
        shelf.reopen()


def test_a_state_of_another_shape_is_said_to_be_unreadable(shelf: Shelf) -> None:
    shelf.send_amount(1)
    shelf.journal.close()
    shape = structs.replace(SCHEMA, state=dict[str, int])
    with pytest.raises(UsageError, match=r"cannot be read \(ValidationError.*1 task is open"):
        Shelf(shelf.journal.disk.path, schema=shape)


class Migrated(Struct, kw_only=True):
    """The state of a later version."""

    sink: str
    address: str
    patience: float
    totals: dict[str, float]
    doubled: dict[str, str] = {}
    reminded: set[str] = set()
    starts: int = 0


class LaterLedger(Ledger):
    @classmethod
    def restored(cls, state: object) -> LaterLedger:
        assert isinstance(state, Migrated)
        shared_fields = {name: getattr(state, name) for name in ("sink", "address", "patience", "doubled", "reminded", "starts")}
        ledger = cls()
        ledger.state = LedgerState(amounts={id: int(total) for id, total in state.totals.items()}, **shared_fields)
        return ledger


def migrate_snapshot(snapshot: Any) -> Any:
    snapshot["state"]["totals"] = {id: float(amount) for id, amount in snapshot["state"].pop("amounts").items()}
    return snapshot


def migrate_entry(entry: Any) -> Any:
    """Amounts that came as messages were counted twice as much in the earlier version, say."""
    number, timestamp, event, *delivered = entry
    if event["type"] == "Received":
        event["message"]["body"]["task"] = str(2 * int(event["message"]["body"]["task"]))
    return [number, timestamp, event, *delivered]


LATER_SCHEMA = structs.replace(
    SCHEMA,
    version=2,
    state=Migrated,
    restore=LaterLedger.restored,
    migrations={1: Migration(snapshot=migrate_snapshot, entry=migrate_entry)},
)


def test_a_journal_of_an_earlier_version_is_gone_on_with(shelf: Shelf) -> None:
    shelf.send_amount(1)
    shelf.journal.snapshot(shelf.journaled)
    shelf.send_amount(20)
    shelf.journal.close()
    reopened_shelf = Shelf(shelf.journal.disk.path, schema=LATER_SCHEMA)
    assert reopened_shelf.is_resumed
    assert [*reopened_shelf.ledger.amounts.values()] == [1, 40]
    assert len(reopened_shelf.pending.questions) == 2
    reopened_shelf.journal.close()
    (version,) = sqlite3.connect(shelf.journal.disk.path).execute("SELECT schema FROM life").fetchone()
    assert version == 2, "it is written anew at once"


def test_one_process_at_a_time_has_the_file(shelf: Shelf) -> None:
    with pytest.raises(UsageError, match="in use by another process"):
        Journal(shelf.journal.disk.path, SCHEMA)


def test_a_database_of_somebody_else_is_refused_and_left_alone(path: Path) -> None:
    alter_file(path, "CREATE TABLE entries (name TEXT)")
    content_before = path.read_bytes()
    with pytest.raises(UsageError, match="not a journal's"):
        Journal(path, SCHEMA)
    assert path.read_bytes() == content_before


def test_a_file_of_the_second_format_had_one_component(path: Path, shelf: Shelf) -> None:
    shelf.send_amount(3)
    shelf.journal.snapshot(shelf.journaled)
    shelf.send_amount(4)
    amounts_before = shelf.ledger.amounts
    shelf.journal.close()
    # As it was: https://www.sqlite.org/lang_altertable.html cannot drop a column of a key, so the tables are made anew.
    with sqlite3.connect(shelf.journal.disk.path) as db:
        db.executescript("""
        CREATE TABLE l (number INTEGER PRIMARY KEY CHECK (number = 1), program TEXT NOT NULL, setting TEXT NOT NULL,
          address TEXT NOT NULL, open TEXT NOT NULL, schema INTEGER NOT NULL);
        INSERT INTO l SELECT 1, program, setting, address, open, schema FROM life; DROP TABLE life; ALTER TABLE l RENAME TO life;
        CREATE TABLE s (number INTEGER NOT NULL, at REAL NOT NULL, sum INTEGER NOT NULL, state BLOB NOT NULL);
        INSERT INTO s SELECT number, at, sum, state FROM snapshot; DROP TABLE snapshot; ALTER TABLE s RENAME TO snapshot;
        CREATE TABLE e (last INTEGER PRIMARY KEY, batch BLOB NOT NULL);
        INSERT INTO e SELECT last, batch FROM entries; DROP TABLE entries; ALTER TABLE e RENAME TO entries;
        PRAGMA user_version = 2;
        """)
    db.close()
    reopened_shelf = Shelf(shelf.journal.disk.path)
    assert reopened_shelf.is_resumed
    assert reopened_shelf.ledger.amounts == amounts_before
    reopened_shelf.journal.close()
    new = path.with_name("new.sqlite")
    Journal(new, SCHEMA).close()
    assert shape(path) == shape(new)


def shape(path: Path) -> set[tuple[str, str]]:
    """The tables of a file."""
    with contextlib.closing(sqlite3.connect(path)) as db:
        return {(name, " ".join(sql.split())) for name, sql in db.execute("SELECT name, sql FROM sqlite_schema WHERE sql IS NOT NULL")}


def test_a_file_of_another_format_is_refused(path: Path) -> None:
    Journal(path, SCHEMA).close()
    alter_file(path, f"PRAGMA user_version = {KIND.version + 1}")
    with pytest.raises(UsageError, match=f"has format {KIND.version + 1}"):
        Journal(path, SCHEMA)


def test_a_disk_that_is_full_is_noticed_and_what_was_there_stays(shelf: Shelf) -> None:
    shelf.send_amount(1)
    shelf.journal.disk.write_and_wait(lambda db: db.execute("PRAGMA max_page_count = 20").fetchone())
    for amount in range(2000):
        shelf.send_amount(amount)
        if shelf.journal.disk.failed is not None:
            break
    assert shelf.journal.disk.write_and_wait(lambda db: 1) == 1
    assert "full" in str(shelf.journal.disk.failed)
    assert shelf.journal.disk.durable < shelf.journal.disk.position
    acknowledged = shelf.journal.disk.durable
    reopened_shelf = shelf.reopen()
    assert reopened_shelf.ledger.total >= 1
    assert reopened_shelf.journaled.number >= acknowledged / 3
    reopened_shelf.journal.close()


# A Task Manager's


def test_a_task_manager_whose_port_is_taken_says_who_knows_it_there(tmp_path: Path) -> None:
    server = asyncio.new_event_loop()

    async def listen() -> int:
        listening = await asyncio.start_server(lambda reader, writer: None, "127.0.0.1", 0)
        return int(listening.sockets[0].getsockname()[1])

    port = server.run_until_complete(listen())
    Shelf(tmp_path / "task-manager.sqlite", address=f"http://127.0.0.1:{port}/task-manager").journal.close()
    alter_file(tmp_path / "task-manager.sqlite", "UPDATE life SET open = '[\"urn:task\"]'")
    addresses = Addresses(repository="http://127.0.0.1:1/repository", registry="http://127.0.0.1:1/registry", task_manager="")
    with pytest.raises(UsageError, match=f"cannot listen at 127.0.0.1:{port}.*know the Task Manager only as http://127.0.0.1:{port}"):
        asyncio.run(run_task_manager(tmp_path, addresses, "127.0.0.1", 0))
    server.close()


# Whatever happens

steps = st.lists(st.one_of(st.integers(-9, 9), st.sampled_from(("answer", "ring", "arrive", "snapshot", "restart"))), max_size=30)


@examples(40)
@given(steps)
def test_restarts_change_nothing(script: list[int | str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        shelf, plain = Shelf(Path(folder) / "ledger.sqlite"), JournaledComponent(Ledger(address=ADDRESS), SCHEMA)

        def feed_both(event: Input) -> None:
            shelf.feed(event)
            plain.handle(plain.make_entry(event, 1.0))

        count = 0
        for step in [*script, "restart"]:
            match step:
                case int(amount):
                    feed_both(Received(amount_message(count, amount)))
                    count += 1
                case "answer":
                    for question, task in [*plain.pending.questions.items()][:1]:
                        feed_both(Answered(question, doubled(task)))
                case "ring":
                    for timer in [*plain.pending.timers][:1]:
                        feed_both(TimerFired(timer))
                case "arrive":
                    for number in [*plain.pending.messages][:1]:
                        shelf.journaled.mark_delivered(number)
                        plain.mark_delivered(number)
                case "snapshot":
                    shelf.journal.snapshot(shelf.journaled)
                case _:
                    feed_both(TimerFired("tick"))  # so that what arrived is in the journal
                    shelf = shelf.reopen()
        assert shelf.ledger.state == plain.component.state
        assert shelf.pending == plain.pending
        shelf.journal.close()


# Damage


def damage(file: Path, position: int) -> None:
    """Flip a bit of a byte."""
    content = bytearray(file.read_bytes())
    content[position] ^= 1 << position % 8
    with file.open("r+b") as stream:  # in place, as a disk damages a file
        stream.write(content)


KILLED_WRITER = WRITER.replace("% 7 == 0", "% 1000 == 0")


def killed_file(path: Path, lines: int = 20) -> tuple[Path, int]:
    """The write-ahead log of a file whose process was killed, and how many amounts were acknowledged."""
    return path.with_name(path.name + "-wal"), run_until_killed(KILLED_WRITER, path, lines)


def test_inputs_whose_write_ahead_log_was_removed_are_missed(path: Path) -> None:
    log, _ = killed_file(path)
    log.unlink()
    with pytest.raises(UsageError, match=r"inputs are missing.*-wal was damaged or removed\. Restore a backup; or delete .*-mark"):
        Shelf(path)
    with pytest.raises(UsageError, match="inputs are missing"):
        Shelf(path)
    path.with_name(path.name + "-mark").unlink()
    shelf = Shelf(path)
    shelf.send_amount(1)
    shelf.reopen().journal.close()


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_inputs_behind_a_damaged_page_of_the_log_are_missed(path: Path, share: float) -> None:
    log, _ = killed_file(path)
    damage(log, int(log.stat().st_size * share))
    with pytest.raises(UsageError, match="inputs are missing"):
        Shelf(path)


def test_a_mark_is_behind_or_of_another_file(path: Path, tmp_path: Path) -> None:
    """After a kill between a commit and its mark, in a copy, and with an older file put back, nothing is missing."""
    _, acknowledged = killed_file(path)
    mark = path.with_name(path.name + "-mark")
    older_mark = mark.read_bytes()
    acknowledged = max(acknowledged, run_until_killed(KILLED_WRITER, path, 5))
    mark.write_bytes(older_mark)
    shelf = Shelf(path)
    assert len(shelf.ledger.amounts) >= acknowledged
    shelf.journal.close()
    backup = tmp_path / "backup.sqlite"
    backup.write_bytes(path.read_bytes())
    shelf = Shelf(path)
    for amount in range(5):
        shelf.send_amount(amount + 1000)
    shelf.journal.close()
    backup.replace(path)
    Shelf(path).journal.close()
    mark.write_bytes(b"nonsense")
    Shelf(path).journal.close()
    path.unlink()
    mark.write_bytes(older_mark)
    Shelf(path).journal.close()


def test_an_input_that_was_altered_is_noticed(shelf: Shelf) -> None:
    shelf.send_amount(123456789)
    shelf.journal.disk.write_and_wait(lambda db: None)
    shelf.journal.close()
    path = shelf.journal.disk.path
    damage(path, path.read_bytes().index(b"123456789"))
    with pytest.raises(UsageError, match="are not those that were written"):
        shelf.reopen()


def test_a_damaged_file_is_explained(shelf: Shelf) -> None:
    """Whatever byte of it: the file is refused with a reason, or is read."""
    for amount in range(20):
        shelf.send_amount(amount)
    shelf.journal.snapshot(shelf.journaled)
    for amount in range(20):
        shelf.send_amount(amount + 100)
    shelf.journal.close()
    path = shelf.journal.disk.path
    content = path.read_bytes()
    for position in range(0, len(content), max(1, len(content) // 150)):
        damage(path, position)
        try:
            Shelf(path).journal.close()
        except UsageError as error:
            assert str(path) in str(error)  # noqa: PT017  # most damages are not noticed: they are of unused bytes
        path.write_bytes(content)
        for suffix in ("-wal", "-shm", "-mark"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)
