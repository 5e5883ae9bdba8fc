"""Why a task failed, as people see it in four places: a reason with a list in brackets stays whole in each."""

from __future__ import annotations

import io

import pytest
from msgspec import structs
from rich.console import Console

from somrs.cli.task_report import print_report
from somrs.client import terminal
from somrs.client.task_report import TaskReport, reasons, view
from somrs.gui.pages.history import _row as history_row
from somrs.gui.pages.task_head import reason_text
from somrs.gui.pages.task_story import story
from somrs.gui.pages.tasks import _table_row as task_row
from somrs.protocol.messages.clients import TaskRow, TasksNews, WatchTasks
from somrs.protocol.messages.events import EventKind
from somrs.protocol.messages.records import TaskRecord
from tests.integration.test_recovery import WISH
from tests.support.virtual_system import Robot, VirtualSystem

WHY = (
    f"no plan: {WISH} could be brought about by TransferObject, but nobody is left to do it "
    "(Robot1.TransferObject: it is too heavy; Robot2.TransferObject: its way is blocked)"
)


@pytest.fixture(scope="module")
def system() -> VirtualSystem:
    """In which all robots refused, each for a reason of its own."""
    system = VirtualSystem(Robot("Robot1", 10, 60, refuses="it is too heavy"), Robot("Robot2", 25, 60, refuses="its way is blocked"))
    system.finish(system.submit(WISH))
    return system


@pytest.fixture(scope="module")
def record(system: VirtualSystem) -> TaskRecord:
    (found,) = [entry for entry in system.world.records["tm"] if isinstance(entry, TaskRecord)]
    return found


@pytest.fixture(scope="module")
def before(record: TaskRecord) -> TaskRecord:
    """The same as SO-MRS 0.1 kept it: without reasons, and events in sentences only."""
    return structs.replace(record, reasons=(), events=tuple(structs.replace(event, event=None) for event in record.events))


def shown(*things: object) -> str:
    console = Console(file=io.StringIO(), width=400, highlight=False)
    for thing in things:
        console.print(thing)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_a_reason_with_a_list_in_it_is_one_reason(record: TaskRecord) -> None:
    assert record.reasons == (WHY,)
    assert record.explanation == WHY


def test_the_page_of_a_task_shows_it_whole(record: TaskRecord) -> None:
    whole = WHY[:1].upper() + WHY[1:]
    assert [reason_text(reason) for reason in reasons(view(record))] == [whole]
    assert [line.text for line in story(view(record), record.events)[-1].lines] == [whole]


def test_the_page_of_tasks_shows_it_whole(system: VirtualSystem) -> None:
    (news,) = [answer for answer in [system.ask(WatchTasks())] if isinstance(answer, TasksNews)]
    (row,) = news.rows
    assert isinstance(row, TaskRow)
    assert task_row(row, frozenset(), row.submitted_at)["note"] == WHY[:1].upper() + WHY[1:]


def test_the_page_of_history_shows_it_whole(record: TaskRecord) -> None:
    assert history_row(record)["why"] == WHY


def test_the_terminal_shows_it_whole(record: TaskRecord) -> None:
    seen = view(record)
    assert WHY in shown(terminal.tasks([seen]))
    console = Console(file=io.StringIO(), width=400, highlight=False)
    print_report(TaskReport.from_record(record), console)
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue().count(WHY) == 1


def test_a_record_without_reasons_shows_its_explanation_whole(before: TaskRecord) -> None:
    assert reasons(before) == (WHY,)
    assert history_row(before)["why"] == WHY
    assert WHY in shown(terminal.ending(view(before)))


def test_of_a_record_without_structs_the_events_are_told_as_they_are(before: TaskRecord) -> None:
    chapters = story(view(before), before.events)
    assert [chapter.title for chapter in chapters] == ["client stated the task", "What was kept of it", "Failed"]
    kept = before.events[1:-1]
    assert [line.text for line in chapters[1].lines] == [f"{event.step}: {event.text}" if event.step else event.text for event in kept]
    assert [line.kind for line in chapters[1].lines] == [event.kind if event.kind is not EventKind.NEWS else None for event in kept]
