"""What people see of tasks in the terminal: while they run, when they are over, and how failures were dealt with."""

from __future__ import annotations

import io
import itertools

import pytest
from rich.console import Console

from somrs.cli.task_report import messages, print_report
from somrs.client import terminal
from somrs.client.task_report import TaskReport, to_builtins
from somrs.client.trace import lines_of, without_heartbeats
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.submission import CancelTask
from somrs.protocol.messages.task_news import ReadTasks, TaskNews, Tasks, WatchTask
from somrs.protocol.messages.task_views import TaskView
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Advance, Order
from tests.integration.test_recovery import BOTH_JARS, GOAL, goes_silent, holding, patrolled_system, restore_object, run_until_step_done
from tests.support.virtual_system import Robot, VirtualSystem

NARROW = 80


def console_text(*things: object) -> str:
    console = Console(file=io.StringIO(), width=NARROW, highlight=False)
    for thing in things:
        if isinstance(thing, TaskReport):
            print_report(thing, console)
        else:
            console.print(thing)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


@pytest.fixture(scope="module")
def observed_record() -> TaskRecord:
    """Of a task in which a robot fell silent, a patrol looked, and another robot went on."""
    system = patrolled_system("Floor001", Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    task = system.submit(GOAL)
    goes_silent(system, task)
    system.finish(task)
    return system.task_record()


@pytest.fixture(scope="module")
def stranded_record() -> TaskRecord:
    """Of a task that failed, and left a jar that nobody can bring back."""
    system = VirtualSystem(Robot("Robot1", 10, 60, works=holding("Robot1")))
    system.finish(system.submit(GOAL))
    return system.task_record()


def test_a_story_tells_what_was_done_by_whom_on_which_terms(observed_record: TaskRecord) -> None:
    text = console_text(TaskReport.from_record(observed_record))
    head = [line.rstrip() for line in text.splitlines()[:2]]
    assert head == [GOAL, f"✔ accomplished in {observed_record.ended_at - observed_record.submitted_at:.1f} s"]
    for part in ("? Unreachable", "✔ Completed", "✔ 10 EUR, 600 s", "chosen", "Robot3.RecognizeSituation"):
        assert part in text, part
    kinds = [line.split()[1] for line in text.partition("Events")[2].splitlines() if len(line.split()) > 1]
    assert [kind for kind in kinds if kind in ("setback", "look", "replace", "end")] == [
        "setback",
        "setback",
        "look",
        "look",
        "replace",
        "end",
    ]


def test_names_of_services_are_not_torn_apart_at_80_columns(observed_record: TaskRecord) -> None:
    text = console_text(TaskReport.from_record(observed_record), messages(lines_of(observed_record)))
    assert max(map(len, text.splitlines())) <= NARROW
    for table in ("Last plan", "Execution log", "Terms", "Messages"):
        part = text.partition(f"{table}")[2].partition("\n\n")[0]
        assert "Robot2.TransferObject" in part, part


def test_a_failure_is_told_once_with_what_it_left(stranded_record: TaskRecord) -> None:
    text = console_text(TaskReport.from_record(stranded_record))
    assert "! Stranded" in text
    assert text.count("could not be undone, and it left") == 1
    assert stranded_record.reasons[0][:40] in text


def test_messages_are_told_from_the_task_managers_side_without_every_heartbeat(observed_record: TaskRecord) -> None:
    lines = lines_of(observed_record)
    assert {line.sender for line in lines if line.type in ("Arrange", "Accept", "Execute", "End")} == {"TaskManager"}
    assert {line.recipient for line in lines if line.type in ("Terms", "Completed")} == {"TaskManager"}
    filtered_lines = without_heartbeats(lines)
    assert [line.type for line in filtered_lines if line.type != "Progress"] == [line.type for line in lines if line.type != "Progress"]
    for line, next_line in itertools.pairwise(filtered_lines):
        assert (line.type, line.participant, next_line.type, next_line.participant) != (
            "Progress",
            next_line.participant,
            "Progress",
            line.participant,
        )
    assert sum(line.type == "Progress" for line in lines) > sum(line.type == "Progress" for line in filtered_lines) > 0
    text = console_text(messages(lines))
    assert "→ Robot1.TransferObject" in text
    assert "← Robot1.TransferObject" in text


def test_for_programs_there_is_one_object_with_everything(stranded_record: TaskRecord) -> None:
    document = to_builtins(TaskReport.from_record(stranded_record))
    assert {"task", "effect", "phase", "outcome", "steps", "work", "contracts", "events", "messages", "client"} <= set(document)
    assert document["work"][0]["state"] == "Stranded"


def test_what_is_done_beside_the_plan_is_shown_while_it_is_done() -> None:
    system = patrolled_system("Floor001", Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    task = system.submit(GOAL)
    goes_silent(system, task)
    assert system.world.run(200, lambda: any(work.step.startswith("look") for work in system.view(task).work))
    text = console_text(terminal.live(system.view(task)))
    assert "RecognizeSituation" in text
    assert "recovering" in text
    system.finish(task)
    assert "RecognizeSituation" not in console_text(terminal.live(system.view(task)))


def test_undoing_is_shown_while_it_is_done() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, undoes=restore_object))
    task = system.submit(BOTH_JARS)
    run_until_step_done(system, task)
    system.ask(CancelTask(task=task, reason="enough"))
    system.finish(task)
    record = system.task_record()
    events = record.events
    assert [event.kind for event in events if event.kind is EventKind.UNDO]
    assert "undo" in console_text(terminal.events(events))


def test_why_a_task_ended_is_not_among_its_events(stranded_record: TaskRecord) -> None:
    text = console_text(terminal.events(stranded_record.events))
    assert text.rstrip().endswith("failed")


# Long lists


def dawdles(order: Order) -> Work:
    for number in range(600):
        yield 5.0, Advance(fraction=0.1, note=f"thinks of {number} things at once, and of what to say about that many things")


def test_news_of_a_task_come_by_pages_that_fit_a_message() -> None:
    system = VirtualSystem(Robot("Robot1", 1, 4000, works=dawdles))
    task = system.submit(GOAL)
    system.world.run(3200)
    all_events = system.manager.state.tasks[task].events
    assert len(all_events) > 500
    numbers: list[int] = []
    for _ in range(20):
        news = system.ask(WatchTask(task=task, after=len(numbers), wait=0.0))
        assert isinstance(news, TaskNews)
        numbers += [event.number for event in news.events]
        if not news.more:
            break
        assert len(news.events) < len(all_events)
    assert numbers == [*range(1, len(all_events) + 1)]


def test_tasks_are_listed_by_pages_the_newest_first() -> None:
    system = VirtualSystem(Robot("Robot1", 1, 30))
    first = system.submit(GOAL)
    system.finish(first)
    rest = [system.submit(f"{jar} isOn Platform001") for jar in ("Jar001", "Tin001")]
    rest.append(system.submit("Jar002 isOn Cupboard001"))
    views: list[TaskView] = []
    last_task = None
    while True:
        page = system.ask(ReadTasks(limit=2, behind=last_task))
        assert isinstance(page, Tasks)
        views += page.tasks
        if not page.more:
            break
        assert len(page.tasks) == 2
        last_task = page.tasks[-1].task
    assert [view.task for view in views] == [*reversed(rest), first]
    running = system.ask(ReadTasks(running=True))
    assert isinstance(running, Tasks)
    assert {view.task for view in running.tasks} == {view.task for view in views if view.outcome is None}
    assert first not in {view.task for view in running.tasks}
    assert not running.more
    assert State.COMPLETED in {step.state for view in views for step in view.steps}
