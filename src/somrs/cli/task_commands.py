"""What the commands about tasks do: state one, follow it, list them, show one, cancel one."""

from __future__ import annotations

import asyncio
from pathlib import Path

from msgspec import structs
from rich.live import Live

from somrs.cli import task_report
from somrs.cli.procedures import handler
from somrs.client import terminal
from somrs.client.client import Addresses, Client
from somrs.client.message_chart import chart
from somrs.client.task_history import TaskHistory, open_task_history
from somrs.client.task_report import TaskReport, is_named, to_builtins, view
from somrs.client.trace import Line, lines_from, lines_of, without_heartbeats
from somrs.errors import FormulaError, UsageError
from somrs.ontology.services import Handler, Occasion
from somrs.protocol.messages.clients import Submit, TaskNews, TaskView
from somrs.protocol.messages.events import EventKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.records import ReadRecords

LAST = "last"
"""In place of an id: the task that was stated last."""


def handlers(on_failure: list[str], on_compensation: list[str]) -> tuple[Handler, ...]:
    """What is laid down for failures and for undoing. Raises FormulaError, which names the option."""
    found: list[Handler] = []
    for option, occasion, texts in (
        ("--on-failure", Occasion.FAILURE, on_failure),
        ("--on-compensation", Occasion.COMPENSATION, on_compensation),
    ):
        for text in texts:
            try:
                found.append(handler(occasion, text))
            except FormulaError as error:
                raise FormulaError(text, error.position, f"{option}: {error.problem}", error.hint) from None
    return tuple(found)


async def do(wish: Submit, data: Path, *, wait: bool, json: bool) -> int:
    """State a task, and follow it; 0 when it was accomplished."""
    console = terminal.console()
    async with Client(Addresses.read(data)) as client:
        id = await client.submit(wish)
        if not wait:
            if json:
                terminal.print_json({"task": id})
            else:
                print(id)
            return 0
        last: TaskNews | None = None
        try:
            with Live(console=console, refresh_per_second=8, transient=True) as screen:
                async for news in client.news(id):
                    last = news
                    # How it ended is said once, under the steps.
                    told = [event for event in news.events if event.kind is not EventKind.END]
                    if json:
                        continue
                    if told:
                        screen.console.print(terminal.events(told))
                    screen.update(terminal.live(news.view))
        except (asyncio.CancelledError, KeyboardInterrupt):
            await client.cancel(id, "stopped at the command line")
            raise
        assert last is not None, "a task that was accepted has news"
        if json:
            terminal.print_json(last.view)
        else:
            console.print(terminal.live(last.view))
        return 0 if last.view.outcome is Outcome.ACCOMPLISHED else 1


async def tasks(data: Path, *, history: bool, limit: int, json: bool, wanted: ReadRecords | None = None) -> None:
    """The tasks that run; with their history, those that are over, too, the latest first. `wanted`: only those of the history that are."""
    if history:
        async with open_task_history(data) as archive:
            running = await archive.client.tasks(running=True) if archive.client is not None and wanted is None else ()
            records = await archive.first(structs.replace(wanted or ReadRecords(), brief=True), limit)
            found = [*running, *map(view, records)]
    else:
        async with Client(Addresses.read(data)) as client:
            found = [*await client.tasks(running=True)]
    if json:
        terminal.print_json(found)
    elif found:
        terminal.console().print(terminal.tasks(found))
    else:
        print(
            ("no such task" if wanted is not None else "no tasks yet")
            if history
            else "no task is running; --history shows those that are over"
        )


async def task(name: str, data: Path, *, messages: bool, picture: Path | None, json: bool) -> None:
    """Everything of one task."""
    if any(sign in name for sign in " \t\n=<>(?"):
        raise UsageError(f"`somrs task` shows a task, by its id; to have a formula made true: somrs do '{name}'")
    async with open_task_history(data) as archive:
        found = await _story(name, archive)
        lines = await _lines(found, archive) if messages or picture is not None else []
    if picture is not None:
        picture.write_text(chart(without_heartbeats(lines), found.view.effect), encoding="utf-8")
        print(f"{picture}: {len(lines)} messages")
    elif json:
        terminal.print_json(to_builtins(found))
    elif messages:
        terminal.console().print(task_report.messages(lines) if lines else "no messages have passed yet")
    else:
        task_report.tell(found, terminal.console())


async def _lines(found: TaskReport, archive: TaskHistory) -> list[Line]:
    """The messages of the task, so far."""
    if found.record is not None:
        return lines_of(found.record)
    assert archive.client is not None, "what is not kept was heard from the running system"
    return lines_from(await archive.client.all_messages(found.view.task), found.view.task)


async def _story(name: str, archive: TaskHistory) -> TaskReport:
    running = await archive.client.tasks(limit=1 if name == LAST else None) if archive.client is not None else ()
    id = _only(name, [*(view.task for view in running), *await _kept(name, archive)])
    records = await archive.first(ReadRecords(task=id), 1)
    if records:
        return TaskReport.from_record(records[0])
    assert archive.client is not None, "what is not kept was heard from the running system"
    seen = await archive.client.read_task(id)
    return TaskReport(view=seen.view, events=seen.events, contracts=seen.contracts)


async def _kept(name: str, archive: TaskHistory) -> list[str]:
    wanted = ReadRecords(brief=True) if name == LAST else ReadRecords(brief=True, task=name)
    return [record.task for record in await archive.first(wanted, 1 if name == LAST else 10)]


def _only(name: str, ids: list[str]) -> str:
    """The one that is meant."""
    if name == LAST:
        if not ids:
            raise UsageError("there was no task yet; `somrs do FORMULA` states one")
        return ids[0]
    found = [*dict.fromkeys(id for id in ids if is_named(id, name))]
    if len(found) != 1:
        raise UsageError(f"{f'{len(found)} tasks begin' if found else 'no task begins'} with {name}; `somrs tasks --history` lists them")
    return found[0]


async def cancel(name: str, reason: str, data: Path) -> None:
    async with Client(Addresses.read(data)) as client:
        views: tuple[TaskView, ...] = await client.tasks(running=True)
        if name == LAST and not views:
            raise UsageError("no task is running")
        id = _only(name, [view.task for view in views])
        await client.cancel(id, reason)
        print(f"stopping {id}")
