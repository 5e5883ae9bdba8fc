"""What is kept of tasks that are over: page by page, from a running Task Manager and from the journal of one that does not run."""

from __future__ import annotations

import asyncio
import csv
import functools
import io
import json
import random
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from msgspec import structs

from somrs.cli import task_commands as tasks
from somrs.client.export import Format, Table, columns, export, moment
from somrs.client.task_history import TaskHistory, open_task_history
from somrs.errors import UsageError
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES
from somrs.storage import archive
from somrs.storage.disk import Disk
from somrs.storage.journal_file import KIND
from tests.integration.test_recovery import GOAL, holding, restore_object
from tests.support.virtual_system import Robot, VirtualSystem


@pytest.fixture(scope="module")
def recovered() -> TaskRecord:
    """Of a task in which a robot failed, what it left was undone, and another robot did it."""
    system = VirtualSystem(
        Robot("Robot1", 10, 60, works=holding("Robot1"), undoes=restore_object),
        Robot("Robot2", 25, 60),
        Robot("Robot3", 1, 60, refuses="busy"),
    )
    task = system.submit(GOAL)
    system.finish(task)
    return system.task_record()


def numbered(record: TaskRecord, number: int, ended_at: float, outcome: Outcome = Outcome.ACCOMPLISHED) -> TaskRecord:
    return structs.replace(record, task=message_id("task", number), ended_at=ended_at, outcome=outcome)


def longer(record: TaskRecord, times: int) -> TaskRecord:
    return structs.replace(record, messages=record.messages * times, events=record.events * times)


@pytest.fixture
def db() -> Iterator[sqlite3.Connection]:
    db = sqlite3.connect(":memory:")
    db.executescript(archive.TABLES)
    yield db
    db.close()


def test_a_record_that_is_stored_is_not_written_again(db: sqlite3.Connection, recovered: TaskRecord) -> None:
    """A Task Manager reads its journal once more while its disk cannot be written."""
    task_archive = archive.TaskArchive()
    task_archive.store_replayed([recovered], None, db)
    db.commit()
    db.execute("PRAGMA query_only=ON")
    task_archive.store_replayed([recovered], None, db)
    with pytest.raises(sqlite3.OperationalError, match="readonly"):
        task_archive.store_replayed([longer(recovered, 2)], None, db)


def read(db: sqlite3.Connection, request: ReadRecords) -> tuple[list[TaskRecord], list[Records]]:
    """All records that are asked for, as a client puts them together, and the pages on which they came."""
    pages: list[Records] = []

    async def ask(page: ReadRecords) -> Records:
        pages.append(archive.find_records(page, db))
        return pages[-1]

    async def read_all() -> list[TaskRecord]:
        return [record async for page in TaskHistory(ask).pages(request) for record in page.records]

    return asyncio.run(read_all()), pages


def test_the_records_of_a_task_tell_everything_of_its_recovery(recovered: TaskRecord) -> None:
    assert [work.state for work in recovered.work] == [State.COMPENSATED, State.COMPLETED]
    assert [event.kind.value for event in recovered.events if event.kind.value != "news"][-1] == "end"
    assert {"setback", "replan", "undo"} <= {event.kind.value for event in recovered.events}
    states = {(contract.service.partition(".")[0], contract.accepted): contract for contract in recovered.contracts}
    assert states["Robot1", True].state is State.COMPENSATED
    assert states["Robot2", True].state is State.COMPLETED
    assert states["Robot3", False].reason == "busy"


def test_all_come_back_page_by_page_the_latest_first(db: sqlite3.Connection, recovered: TaskRecord) -> None:
    """Several may end at the same time: none is left out, none comes twice, wherever a page ends."""
    chance = random.Random(1)
    records = [numbered(recovered, number, ended_at=float(chance.randrange(12))) for number in range(60)]
    for record in records:
        archive.store_record(record, db)
        archive.store_record(record, db)
    for limit in (1, 7, 1000):
        found_records, pages = read(db, ReadRecords(limit=limit))
        assert [record.ended_at for record in found_records] == sorted((record.ended_at for record in records), reverse=True)
        assert sorted(found_records, key=lambda record: record.task) == sorted(records, key=lambda record: record.task)
        assert pages[0].total == 60
        assert len(pages) > 1, "they do not fit a message"


def test_a_page_fits_a_message_and_a_record_that_does_not_comes_in_parts(db: sqlite3.Connection, recovered: TaskRecord) -> None:
    records = [longer(numbered(recovered, number, float(number)), times) for number, times in enumerate((1, 40, 1, 1, 15))]
    for record in records:
        archive.store_record(record, db)
    assert len(msgspec.json.encode(records[1])) > MOST_BYTES
    found_records, pages = read(db, ReadRecords())
    assert found_records == records[::-1]
    header = Header(sender="http://tm", recipient="http://client", message_id=message_id("answer"))
    sizes = [len(soap.encode(Message(header=header, body=page))) for page in pages]
    assert max(sizes) < MOST_BYTES
    assert max(sizes) > MOST_BYTES / 10, "messages are used well"
    brief, _ = read(db, ReadRecords(brief=True))
    assert [record.work for record in brief] == [record.work for record in found_records]
    assert not any(record.messages or record.events or record.contracts for record in brief)


def test_it_is_known_how_work_ended_before_it_was_undone(recovered: TaskRecord) -> None:
    first, second = recovered.work
    assert (first.result, second.result) == (State.FAILED, State.COMPLETED)
    assert first.ended is not None
    assert second.ended is not None
    assert first.began < first.ended <= second.began < second.ended <= recovered.ended_at


def test_tasks_are_found_by_what_was_wished_for_and_by_who_worked(db: sqlite3.Connection, recovered: TaskRecord) -> None:
    second_record = structs.replace(numbered(recovered, 2, 2.0), effect="Cup_1 isOn Table001", work=recovered.work[:1])
    for record in (first_record := numbered(recovered, 1, 1.0), second_record):
        archive.store_record(record, db)
    device, _, service = recovered.work[1].service.partition(".")
    for request, expected in (
        (ReadRecords(text="CUP_1"), [second_record]),
        (ReadRecords(text="Cup%"), []),
        (ReadRecords(service=device), [first_record]),
        (ReadRecords(service=f"{device}.{service}"), [first_record]),
        (ReadRecords(service=recovered.work[0].service), [second_record, first_record]),
        (ReadRecords(service=device[:-1]), []),
        (ReadRecords(service="Robot3"), []),
    ):
        found_records, pages = read(db, request)
        assert found_records == expected, request
        assert pages[0].total == len(expected)
    assert {contract.service for contract in recovered.contracts} > {work.service for work in recovered.work}, "Robot3 was only asked"


def test_what_is_asked_for_is_what_comes(db: sqlite3.Connection, recovered: TaskRecord) -> None:
    outcomes = [*Outcome] * 4
    records = [numbered(recovered, number, float(number), outcome) for number, outcome in enumerate(outcomes)]
    for record in records:
        archive.store_record(record, db)
    failed, pages = read(db, ReadRecords(outcome=Outcome.FAILED, since=5.0, limit=1))
    assert failed == [record for record in records if record.outcome is Outcome.FAILED and record.ended_at >= 5.0][::-1]
    assert pages[0].total == len(failed) > 1
    task_id = records[7].task
    for name in (task_id, task_id.upper().replace("URN:", "urn:"), task_id.removeprefix("urn:uuid:"), task_id[9:19]):
        assert read(db, ReadRecords(task=name))[0] == [records[7]], name
    assert read(db, ReadRecords(task="urn:uuid:none"))[0] == []
    assert len(read(db, ReadRecords(task=""))[0]) == len(records)


# Of a system that does not run


@pytest.fixture
def stopped(tmp_path: Path, recovered: TaskRecord) -> Path:
    disk = Disk(tmp_path / archive.FILE, KIND)
    failed = structs.replace(
        numbered(longer(recovered, 40), 2, recovered.ended_at + 86_400, Outcome.FAILED), explanation='no plan, "it says"; second reason'
    )
    for record in (recovered, failed):
        disk.write_and_wait(functools.partial(archive.store_record, record))
    disk.close()
    return tmp_path


def exported(data: Path, format: Format, table: Table = Table.TASKS, since: str | None = None, outcome: Outcome | None = None) -> str:
    output_path = data / "out"
    request = ReadRecords(since=moment(since, 0.0) if since is not None else None, outcome=outcome)
    asyncio.run(export(output_path, data, format, table, request))
    assert sorted(path.name for path in data.glob("out*")) == ["out"]
    return output_path.read_text()


def test_json_lines_hold_all_that_is_kept(stopped: Path, recovered: TaskRecord, capsys: pytest.CaptureFixture[str]) -> None:
    text = exported(stopped, Format.JSONL)
    assert capsys.readouterr().out == f"{stopped / 'out'}: 2 tasks\n"
    failed, first = [msgspec.json.decode(line, type=TaskRecord) for line in text.splitlines()]
    assert first == recovered
    assert (failed.outcome, len(failed.messages)) == (Outcome.FAILED, 40 * len(recovered.messages))
    asyncio.run(export(None, stopped, Format.JSONL, Table.TASKS))
    assert capsys.readouterr().out == text
    day = moment("1970-01-13", 0.0)
    assert recovered.ended_at < day < failed.ended_at
    assert len(exported(stopped, Format.JSONL, since="1970-01-13").splitlines()) == 1
    assert exported(stopped, Format.JSONL, outcome=Outcome.CANCELLED) == ""


def test_csv_tables_have_a_row_for_each_thing(stopped: Path, recovered: TaskRecord) -> None:
    rows = {table: [*csv.DictReader(io.StringIO(exported(stopped, Format.CSV, table)))] for table in Table}
    failed, first = rows[Table.TASKS]
    assert (failed["outcome"], failed["explanation"]) == ("failed", 'no plan, "it says"; second reason')
    assert first["submitted_at"].startswith("1970-01-12T13:46:")
    assert (first["completed"], first["compensated"], first["stranded"]) == ("1", "1", "0")
    assert (float(first["price"]), first["currency"]) == (35, "EUR"), "of the contracts that were accepted"
    assert float(first["seconds"]) == pytest.approx(recovered.ended_at - recovered.submitted_at, abs=0.001)
    for table, count in (
        (Table.WORK, 2 * len(recovered.work)),
        (Table.CONTRACTS, 2 * len(recovered.contracts)),
        (Table.EVENTS, 41 * len(recovered.events)),
        (Table.MESSAGES, 41 * len(recovered.messages)),
    ):
        assert len(rows[table]) == count
        assert {row["task"] for row in rows[table]} == {failed["task"], first["task"]}
        assert set(rows[table][0]) == set(columns(table))
    assert json.loads(rows[Table.WORK][0]["inputs"])["Object"] == "Jar002"
    assert {row["accepted"] for row in rows[Table.CONTRACTS]} == {"true", "false"}
    assert json.loads(first["reasons"]) == [*recovered.reasons]
    assert {json.loads(row["event"])["type"] for row in rows[Table.EVENTS]} >= {"TaskStated", "StepCompleted", "TaskEnded"}
    assert all(row["at"].endswith("Z") for row in rows[Table.MESSAGES])


def test_terms_that_hold_longer_than_there_are_dates_are_exported(tmp_path: Path, recovered: TaskRecord) -> None:
    disk = Disk(tmp_path / archive.FILE, KIND)
    forever = tuple(structs.replace(contract, valid_until=1e18) for contract in recovered.contracts)
    disk.write_and_wait(functools.partial(archive.store_record, structs.replace(recovered, contracts=forever)))
    disk.close()
    (row, *_) = csv.DictReader(io.StringIO(exported(tmp_path, Format.CSV, Table.CONTRACTS)))
    assert float(row["valid_until"]) == 1e18


def test_tasks_that_are_over_can_be_looked_at(stopped: Path, recovered: TaskRecord, capsys: pytest.CaptureFixture[str]) -> None:
    asyncio.run(tasks.tasks(stopped, history=True, limit=20, json=False))
    listed = capsys.readouterr().out
    assert listed.index("failed in") < listed.index("accomplished in")
    asyncio.run(tasks.tasks(stopped, history=True, limit=1, json=True))
    assert [task["outcome"] for task in json.loads(capsys.readouterr().out)] == ["failed"]
    request = ReadRecords(outcome=Outcome.ACCOMPLISHED, service=recovered.work[0].service, text="jar")
    asyncio.run(tasks.tasks(stopped, history=True, limit=20, json=True, query=request))
    assert [task["task"] for task in json.loads(capsys.readouterr().out)] == [recovered.task]
    asyncio.run(tasks.tasks(stopped, history=True, limit=20, json=False, query=ReadRecords(service="Robot7")))
    assert capsys.readouterr().out == "no matching task\n"
    name = recovered.task[9:15]
    asyncio.run(tasks.task(name, stopped, messages=False, picture=None, json=True))
    assert msgspec.convert(json.loads(capsys.readouterr().out) | {"type": "TaskRecord"}, TaskRecord) == recovered
    asyncio.run(tasks.task(name, stopped, messages=False, picture=stopped / "chart.svg", json=False))
    assert "Compensated" in (stopped / "chart.svg").read_text()
    with pytest.raises(UsageError, match="no task begins with xyz"):
        asyncio.run(tasks.task("xyz", stopped, messages=False, picture=None, json=False))
    with pytest.raises(UsageError, match="somrs do"):
        asyncio.run(tasks.task(GOAL, stopped, messages=False, picture=None, json=False))


def test_a_journal_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    async def look(data: Path) -> None:
        async with open_task_history(data) as archive:
            await archive.first(ReadRecords(), 1)

    with pytest.raises(UsageError, match="somrs up"):
        asyncio.run(look(tmp_path))
    file = tmp_path / archive.FILE
    file.write_text("no database, but long enough to be one" * 100)
    with pytest.raises(UsageError, match=archive.FILE):
        asyncio.run(look(tmp_path))
    file.unlink()
    foreign_db = sqlite3.connect(file)
    foreign_db.execute("CREATE TABLE something (else_ TEXT)")
    foreign_db.close()
    with pytest.raises(UsageError, match="is not a journal's"):
        asyncio.run(look(tmp_path))
    file.unlink()
    disk = Disk(file, KIND)
    try:
        with pytest.raises(UsageError, match="in use"):
            asyncio.run(look(tmp_path))
    finally:
        disk.close()


def test_an_interrupted_export_leaves_no_file_that_looks_whole(stopped: Path) -> None:
    (stopped / "out").write_text("an earlier one")
    with sqlite3.connect(stopped / archive.FILE) as db:
        db.execute("UPDATE records SET document = '{' WHERE outcome = 'accomplished'")
    with pytest.raises(UsageError, match=archive.FILE):
        asyncio.run(export(stopped / "out", stopped, Format.JSONL, Table.TASKS))
    assert [path.name for path in stopped.glob("out*")] == ["out"]
    assert (stopped / "out").read_text() == "an earlier one"


@pytest.mark.parametrize(
    ("text", "expected"),
    [("90s", 910.0), ("1.5m", 910.0), ("0h", 1000.0), ("1970-01-01T00:00:05+00:00", 5.0), ("1d", 1000.0 - 86_400)],
)
def test_moments(text: str, expected: float) -> None:
    assert moment(text, 1000.0) == expected


@pytest.mark.parametrize("text", ["", "yesterday", "2h ago", "2026-13-01", "-2h"])
def test_what_is_no_moment(text: str) -> None:
    with pytest.raises(UsageError, match="is not a time"):
        moment(text, 1000.0)
