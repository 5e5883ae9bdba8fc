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
from somrs.protocol.messages.clients import CancelTask, ReadTasks, TaskNews, Tasks, TaskView, WatchTask
from somrs.protocol.messages.events import EventKind
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.records import TaskRecord
from somrs.runtime.virtual import Work
from somrs.service_manager.sdk.orders import Advance, Order
from tests.integration.test_recovery import BOTH, WISH, goes_silent, holding, patrolled, puts_back, until_one_is_done
from tests.support.virtual_system import Robot, VirtualSystem

NARROW = 80


def shown(*things: object) -> str:
    console = Console(file=io.StringIO(), width=NARROW, highlight=False)
    for thing in things:
        if isinstance(thing, TaskReport):
            print_report(thing, console)
        else:
            console.print(thing)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def record(system: VirtualSystem) -> TaskRecord:
    (found,) = [entry for entry in system.world.records["tm"] if isinstance(entry, TaskRecord)]
    return found


@pytest.fixture(scope="module")
def looked_at() -> TaskRecord:
    """Of a task in which a robot fell silent, a patrol looked, and another robot went on."""
    system = patrolled("Floor001", Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    task = system.submit(WISH)
    goes_silent(system, task)
    system.finish(task)
    return record(system)


@pytest.fixture(scope="module")
def stranded() -> TaskRecord:
    """Of a task that failed, and left a jar that nobody can bring back."""
    system = VirtualSystem(Robot("Robot1", 10, 60, works=holding("Robot1")))
    system.finish(system.submit(WISH))
    return record(system)


def test_a_story_tells_what_was_done_by_whom_on_which_terms(looked_at: TaskRecord) -> None:
    text = shown(TaskReport.from_record(looked_at))
    head = [line.rstrip() for line in text.splitlines()[:2]]
    assert head == [WISH, f"✔ accomplished in {looked_at.ended_at - looked_at.submitted_at:.1f} s"]
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


def test_names_of_services_are_not_torn_apart_at_80_columns(looked_at: TaskRecord) -> None:
    text = shown(TaskReport.from_record(looked_at), messages(lines_of(looked_at)))
    assert max(map(len, text.splitlines())) <= NARROW
    for table in ("Last plan", "What was done", "Terms", "Messages"):
        part = text.partition(f"{table}")[2].partition("\n\n")[0]
        assert "Robot2.TransferObject" in part, part


def test_a_failure_is_told_once_with_what_it_left(stranded: TaskRecord) -> None:
    text = shown(TaskReport.from_record(stranded))
    assert "! Stranded" in text
    assert text.count("could not be undone, and it left") == 1
    assert stranded.reasons[0][:40] in text


def test_messages_are_told_from_the_task_managers_side_without_every_heartbeat(looked_at: TaskRecord) -> None:
    lines = lines_of(looked_at)
    assert {line.sender for line in lines if line.type in ("Arrange", "Accept", "Execute", "End")} == {"TaskManager"}
    assert {line.recipient for line in lines if line.type in ("Terms", "Completed")} == {"TaskManager"}
    kept = without_heartbeats(lines)
    assert [line.type for line in kept if line.type != "Progress"] == [line.type for line in lines if line.type != "Progress"]
    for before, after in itertools.pairwise(kept):
        assert (before.type, before.participant, after.type, after.participant) != (
            "Progress",
            after.participant,
            "Progress",
            before.participant,
        )
    assert sum(line.type == "Progress" for line in lines) > sum(line.type == "Progress" for line in kept) > 0
    text = shown(messages(lines))
    assert "→ Robot1.TransferObject" in text
    assert "← Robot1.TransferObject" in text


def test_for_programs_there_is_one_object_with_everything(stranded: TaskRecord) -> None:
    found = to_builtins(TaskReport.from_record(stranded))
    assert {"task", "effect", "phase", "outcome", "steps", "work", "contracts", "events", "messages", "client"} <= set(found)
    assert found["work"][0]["state"] == "Stranded"


def test_what_is_done_beside_the_plan_is_shown_while_it_is_done() -> None:
    system = patrolled("Floor001", Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    task = system.submit(WISH)
    goes_silent(system, task)
    assert system.world.run(200, lambda: any(work.step.startswith("look") for work in system.view(task).work))
    text = shown(terminal.live(system.view(task)))
    assert "RecognizeSituation" in text
    assert "recovering" in text
    system.finish(task)
    assert "RecognizeSituation" not in shown(terminal.live(system.view(task)))


def test_undoing_is_shown_while_it_is_done() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, undoes=puts_back))
    task = system.submit(BOTH)
    until_one_is_done(system, task)
    system.ask(CancelTask(task=task, reason="enough"))
    system.finish(task)
    (record,) = [entry for entry in system.world.records["tm"] if isinstance(entry, TaskRecord)]
    events = record.events
    assert [event.kind for event in events if event.kind is EventKind.UNDO]
    assert "undo" in shown(terminal.events(events))


def test_why_a_task_ended_is_not_among_its_events(stranded: TaskRecord) -> None:
    text = shown(terminal.events(stranded.events))
    assert text.rstrip().endswith("failed")


# Long lists


def dawdles(order: Order) -> Work:
    for number in range(600):
        yield 5.0, Advance(fraction=0.1, note=f"thinks of {number} things at once, and of what to say about that many things")


def test_news_of_a_task_come_by_pages_that_fit_a_message() -> None:
    system = VirtualSystem(Robot("Robot1", 1, 4000, works=dawdles))
    task = system.submit(WISH)
    system.world.run(3200)
    all = system.manager.state.tasks[task].events
    assert len(all) > 500
    found: list[int] = []
    for _ in range(20):
        news = system.ask(WatchTask(task=task, after=len(found), wait=0.0))
        assert isinstance(news, TaskNews)
        found += [event.number for event in news.events]
        if not news.more:
            break
        assert len(news.events) < len(all)
    assert found == [*range(1, len(all) + 1)]


def test_tasks_are_listed_by_pages_the_newest_first() -> None:
    system = VirtualSystem(Robot("Robot1", 1, 30))
    first = system.submit(WISH)
    system.finish(first)
    rest = [system.submit(f"{jar} isOn Platform001") for jar in ("Jar001", "Tin001")]
    rest.append(system.submit("Jar002 isOn Cupboard001"))
    found: list[TaskView] = []
    behind = None
    while True:
        page = system.ask(ReadTasks(limit=2, behind=behind))
        assert isinstance(page, Tasks)
        found += page.tasks
        if not page.more:
            break
        assert len(page.tasks) == 2
        behind = page.tasks[-1].task
    assert [view.task for view in found] == [*reversed(rest), first]
    running = system.ask(ReadTasks(running=True))
    assert isinstance(running, Tasks)
    assert {view.task for view in running.tasks} == {view.task for view in found if view.outcome is None}
    assert first not in {view.task for view in running.tasks}
    assert not running.more
    assert State.COMPLETED in {step.state for view in found for step in view.steps}
