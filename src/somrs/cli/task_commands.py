"""The implementations of the commands about tasks: submit, follow, list, show and cancel."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from msgspec import structs
from rich.live import Live

from somrs.cli import task_report
from somrs.cli.procedures import handler
from somrs.cli.running_site import site_addresses, site_on_bus
from somrs.client import terminal
from somrs.client.client import PATIENCE, Client
from somrs.client.message_chart import chart
from somrs.client.task_history import TaskHistory, open_task_history
from somrs.client.task_managers import Listing, silent_text
from somrs.client.task_report import TaskReport, is_named, repetition, to_builtins, view
from somrs.client.trace import Line, lines_from, lines_of, without_heartbeats
from somrs.errors import FormulaError, UsageError
from somrs.ontology.services import Handler, Occasion
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.records import ReadRecords
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_news import TaskNews

LAST_TASK = "last"
"""In place of an id: the task that was submitted last."""


def handlers(on_failure: list[str], on_compensation: list[str]) -> tuple[Handler, ...]:
    """The handlers of failures and compensations from the options' texts. Raises FormulaError, which names the option."""
    procedures: list[Handler] = []
    for option, occasion, texts in (
        ("--on-failure", Occasion.FAILURE, on_failure),
        ("--on-compensation", Occasion.COMPENSATION, on_compensation),
    ):
        for text in texts:
            try:
                procedures.append(handler(occasion, text))
            except FormulaError as error:
                raise FormulaError(text, error.position, f"{option}: {error.problem}", error.hint) from None
    return tuple(procedures)


async def run_task(task: Submit, data: Path, *, wait: bool, json: bool, task_manager: str | None = None) -> int:
    """Submit a task, to any Task Manager or the one with this name, and follow it if `wait`. Returns the exit status: 0 if it was
    accomplished, or submitted without `wait`.

    With `json`, prints the task as it ended; of a task that asks what is so, its findings.
    """
    console = terminal.console()
    async with Client(await site_addresses(data)) as client:
        id = await client.submit(task, patience=PATIENCE, task_manager=task_manager)
        if not wait:
            if json:
                terminal.print_json({"task": id})
            else:
                print(id)
            return 0
        latest_news: TaskNews | None = None
        try:
            with Live(console=console, refresh_per_second=8, transient=True) as screen:
                async for news in client.news(id):
                    latest_news = news
                    # The outcome is printed once, below the steps.
                    events = [event for event in news.events if event.kind is not EventKind.END]
                    if json:
                        continue
                    if events:
                        screen.console.print(terminal.events(events))
                    screen.update(terminal.live(news.view))
        except (asyncio.CancelledError, KeyboardInterrupt):
            await client.cancel(id, "stopped at the command line")
            raise
        assert latest_news is not None, "a task that was accepted has news"
        findings = latest_news.view.findings
        if json:
            terminal.print_json(latest_news.view if findings is None else findings)
        else:
            console.print(terminal.live(latest_news.view))
            if findings is not None:
                console.print("", terminal.findings(findings, latest_news.view.outcome), sep="\n")
        return 0 if latest_news.view.outcome is Outcome.ACCOMPLISHED else 1


async def tasks(data: Path, *, history: bool, limit: int, json: bool, query: ReadRecords | None = None) -> None:
    """Print the running tasks and, with `history`, the ended ones, the latest first. `query`: only ended tasks that match it."""
    silent: tuple[str, ...]
    if history:
        async with open_task_history(data, await site_on_bus()) as archive:
            running = await archive.client.tasks(running=True) if archive.client is not None and query is None else ()
            records = await archive.first(structs.replace(query or ReadRecords(), brief=True), limit)
            views, silent = [*running, *map(view, records)], tuple(archive.silent)
    else:
        async with Client(await site_addresses(data)) as client:
            listing = await client.tasks(running=True)
            views, silent = [*listing], listing.silent
    if silent:
        print(silent_text(silent), file=sys.stderr)
    if json:
        terminal.print_json(views)
    elif views:
        terminal.console().print(terminal.tasks(views))
    else:
        print(
            ("no matching task" if query is not None else "no tasks yet") if history else "no task is running; --history shows ended tasks"
        )


async def task(name: str, data: Path, *, messages: bool, picture: Path | None, json: bool) -> None:
    """Print the report on a task, or its messages; with `picture`, write the messages as a sequence chart."""
    if any(sign in name for sign in " \t\n=<>(?"):
        raise UsageError(f"`somrs task` shows the task with an id; to submit a goal: somrs do '{name}'")
    async with open_task_history(data, await site_on_bus()) as archive:
        report = await _read_report(name, archive)
        lines = await _lines(report, archive) if messages or picture is not None else []
    if picture is not None:
        picture.write_text(chart(without_heartbeats(lines), report.view.effect), encoding="utf-8")
        print(f"{picture}: {len(lines)} messages")
    elif json:
        terminal.print_json(to_builtins(report))
    elif messages:
        terminal.console().print(task_report.messages(lines) if lines else "there are no messages yet")
    else:
        task_report.print_report(report, terminal.console())


async def _lines(report: TaskReport, archive: TaskHistory) -> list[Line]:
    """The messages of the task so far."""
    if report.record is not None:
        return lines_of(report.record)
    assert archive.client is not None, "a task without a record is read from the running system"
    return lines_from(await archive.client.all_messages(report.view.task), report.view.task)


async def _read_report(name: str, archive: TaskHistory) -> TaskReport:
    known = await archive.client.tasks(limit=1 if name == LAST_TASK else None) if archive.client is not None else Listing(items=())
    id = _select_id(name, [*(view.task for view in known), *await _find_record_ids(name, archive)], known.silent)
    records = await archive.first(ReadRecords(task=id), 1)
    if records:
        return TaskReport.from_record(records[0])
    assert archive.client is not None, "a task without a record is read from the running system"
    news = await archive.client.read_task(id)
    return TaskReport(view=news.view, events=news.events, contracts=news.contracts)


async def _find_record_ids(name: str, archive: TaskHistory) -> list[str]:
    query = ReadRecords(brief=True) if name == LAST_TASK else ReadRecords(brief=True, task=name)
    return [record.task for record in await archive.first(query, 1 if name == LAST_TASK else 10)]


def _select_id(name: str, ids: list[str], silent: tuple[str, ...] = ()) -> str:
    """The id that `name` selects: `last`, or the beginning of the id. Raises UsageError for no task, or several. `silent`: the Task
    Managers whose tasks are not known."""
    if name == LAST_TASK:
        if not ids:
            raise UsageError("there are no tasks yet; `somrs do FORMULA` submits one")
        return ids[0]
    matches = [*dict.fromkeys(id for id in ids if is_named(id, name))]
    if len(matches) != 1:
        problem = f"{len(matches)} tasks begin" if matches else "no task begins"
        reason = silent_text(silent) if silent and not matches else "`somrs tasks --history` lists them"
        raise UsageError(f"{problem} with {name}; {reason}")
    return matches[0]


async def _select_running(name: str, client: Client) -> str:
    """The id of the running task that `name` selects. Raises UsageError for no task, or several."""
    running = await client.tasks(running=True)
    if name == LAST_TASK and not running.items:
        raise UsageError(silent_text(running.silent) or "no task is running")
    return _select_id(name, [view.task for view in running], running.silent)


async def retry(name: str, data: Path, *, wait: bool, json: bool) -> int:
    """Submit an ended task once more. Returns the exit status, as `run_task` does."""
    async with open_task_history(data, await site_on_bus()) as archive:
        report = await _read_report(name, archive)
    return await run_task(repetition(report.view), data, wait=wait, json=json)


async def pause(name: str, author: str, data: Path, *, paused: bool) -> None:
    async with Client(await site_addresses(data)) as client:
        id = await _select_running(name, client)
        is_paused = await client.pause(id, author, paused=paused)
        print(f"{id} is paused" if is_paused else f"{id} goes on" if not paused else f"{id} has ended or is ending")


async def cancel(name: str, reason: str, data: Path) -> None:
    async with Client(await site_addresses(data)) as client:
        id = await _select_running(name, client)
        await client.cancel(id, reason)
        print(f"stopping {id}")
