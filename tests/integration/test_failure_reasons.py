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
from somrs.gui.pages.task_header import reason_text
from somrs.gui.pages.task_story import story
from somrs.gui.pages.tasks import _table_row as task_row
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.task_news import TasksNews, WatchTasks
from somrs.protocol.messages.task_views import TaskRow
from tests.integration.test_recovery import GOAL
from tests.support.virtual_system import Robot, VirtualSystem

REASON = (
    f"no plan: {GOAL} could be brought about by TransferObject, but no service is left "
    "(Robot1.TransferObject: it is too heavy; Robot2.TransferObject: its way is blocked)"
)


@pytest.fixture(scope="module")
def system() -> VirtualSystem:
    """In which all robots refused, each for a reason of its own."""
    system = VirtualSystem(Robot("Robot1", 10, 60, refuses="it is too heavy"), Robot("Robot2", 25, 60, refuses="its way is blocked"))
    system.finish(system.submit(GOAL))
    return system


@pytest.fixture(scope="module")
def record(system: VirtualSystem) -> TaskRecord:
    return system.task_record()


@pytest.fixture(scope="module")
def old_record(record: TaskRecord) -> TaskRecord:
    """The same as SO-MRS 0.1 kept it: without reasons, and events in sentences only."""
    return structs.replace(record, reasons=(), events=tuple(structs.replace(event, event=None) for event in record.events))


def console_text(*things: object) -> str:
    console = Console(file=io.StringIO(), width=400, highlight=False)
    for thing in things:
        console.print(thing)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_a_reason_with_a_list_in_it_is_one_reason(record: TaskRecord) -> None:
    assert record.reasons == (REASON,)
    assert record.explanation == REASON


def test_the_page_of_a_task_shows_it_whole(record: TaskRecord) -> None:
    whole = REASON[:1].upper() + REASON[1:]
    assert [reason_text(reason) for reason in reasons(view(record))] == [whole]
    assert [line.text for line in story(view(record), record.events)[-1].lines] == [whole]


def test_the_page_of_tasks_shows_it_whole(system: VirtualSystem) -> None:
    (news,) = [answer for answer in [system.ask(WatchTasks())] if isinstance(answer, TasksNews)]
    (row,) = news.rows
    assert isinstance(row, TaskRow)
    assert task_row(row, frozenset(), row.submitted_at)["note"] == REASON[:1].upper() + REASON[1:]


def test_the_page_of_history_shows_it_whole(record: TaskRecord) -> None:
    assert history_row(record)["why"] == REASON


def test_the_terminal_shows_it_whole(record: TaskRecord) -> None:
    task_view = view(record)
    assert REASON in console_text(terminal.tasks([task_view]))
    console = Console(file=io.StringIO(), width=400, highlight=False)
    print_report(TaskReport.from_record(record), console)
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue().count(REASON) == 1


def test_a_record_without_reasons_shows_its_explanation_whole(old_record: TaskRecord) -> None:
    assert reasons(old_record) == (REASON,)
    assert history_row(old_record)["why"] == REASON
    assert REASON in console_text(terminal.ending(view(old_record)))


def test_of_a_record_without_structs_the_events_are_told_as_they_are(old_record: TaskRecord) -> None:
    chapters = story(view(old_record), old_record.events)
    assert [chapter.title for chapter in chapters] == ["client submitted the task", "Recorded events", "Failed"]
    text_events = old_record.events[1:-1]
    assert [line.text for line in chapters[1].lines] == [
        f"{event.step}: {event.text}" if event.step else event.text for event in text_events
    ]
    assert [line.kind for line in chapters[1].lines] == [event.kind if event.kind is not EventKind.NEWS else None for event in text_events]
