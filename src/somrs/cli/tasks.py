"""The commands about tasks: state one, list them, show one, cancel one, export those that are over."""

from __future__ import annotations

import sys
import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from somrs.cli.options import DEFAULT_FOLDER, Data, Formula, Json, awaited, fail, guarded

if TYPE_CHECKING:
    from somrs.protocol.messages.records import ReadRecords

tasks_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)

TaskName = Annotated[str, typer.Argument(help="The task's id, or its beginning; or `last`.")]
PROCEDURE = "[SERVICE TYPE:] FORMULA [WHEN FORMULA]; it may speak of the step's inputs, such as ?Object. Can be given several times."

SinceOption = Annotated[str | None, typer.Option(help="Those that ended since: 2026-03-01, 2026-03-01T14:30, or so long ago: 2h, 7d.")]
TextOption = Annotated[str | None, typer.Option("--text", help="Those with this text in what was wished for.")]
ByOption = Annotated[str | None, typer.Option("--by", help="Those in which this service, or a service of this device, did something.")]


class PolicyOption(StrEnum):
    """How services are chosen."""

    price = "price"
    time = "time"
    weighted = "weighted"


class OutcomeOption(StrEnum):
    """How a task ended."""

    accomplished = "accomplished"
    failed = "failed"
    cancelled = "cancelled"


OutcomeWanted = Annotated[OutcomeOption | None, typer.Option("--outcome", help="Those that ended so.")]


class FormatOption(StrEnum):
    """How tasks are exported."""

    jsonl = "jsonl"
    csv = "csv"


class TableOption(StrEnum):
    """What a row of a CSV file is."""

    tasks = "tasks"
    work = "work"
    contracts = "contracts"
    events = "events"
    messages = "messages"


@tasks_app.command()
def do(
    formula: Formula,
    precondition: Annotated[str | None, typer.Option(help="The initial situation, if it matters.")] = None,
    policy: Annotated[PolicyOption, typer.Option(help="What services are chosen by.")] = PolicyOption.price,
    time_value: Annotated[float, typer.Option(help="With `weighted`: what a second is worth.")] = 0.01,
    deadline: Annotated[float | None, typer.Option(help="Give up after so many seconds.")] = None,
    priority: Annotated[
        int, typer.Option(help="Of tasks that wait for the same things or devices, the one with the higher number goes first.")
    ] = 0,
    on_failure: Annotated[list[str], typer.Option(help=f"Bring this about when a step fails, before it is recovered: {PROCEDURE}")] = [],  # noqa: B006  # typer's way to say a list
    on_compensation: Annotated[
        list[str], typer.Option(help=f"Bring this about to undo a step, instead of what was before it: {PROCEDURE}")
    ] = [],  # noqa: B006  # as above
    wait: Annotated[bool, typer.Option(help="Stay until the task ended.")] = True,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Make a formula true. Shows the plan, who does what, what is done about failures, and how it ends."""
    from somrs.cli.task_commands import handlers
    from somrs.cli.task_commands import run_task as run
    from somrs.protocol.messages.clients import Policy, Submit

    submission = Submit(
        effect=formula,
        precondition=precondition,
        policy=Policy(policy.value),
        time_value=time_value,
        deadline=deadline,
        priority=priority,
        handlers=guarded(lambda: handlers(on_failure, on_compensation)),
    )
    sys.exit(awaited(run(submission, data, wait=wait, json=json)))


@tasks_app.command()
def tasks(
    history: Annotated[bool, typer.Option("--history", help="Those that are over, too.")] = False,
    limit: Annotated[int, typer.Option(min=1, help="At most so many of those that are over.")] = 20,
    since: SinceOption = None,
    outcome: OutcomeWanted = None,
    text: TextOption = None,
    service: ByOption = None,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """The tasks that run. With --history those that are over, too; these also when no system runs. With --since, --outcome, --text or
    --by only those that are over, and fit."""
    from somrs.cli.task_commands import tasks as run

    query = guarded(lambda: _make_query(since, outcome, text, service))
    awaited(run(data, history=history or query is not None, limit=limit, json=json, query=query))


@tasks_app.command()
def task(
    task: TaskName,
    messages: Annotated[bool, typer.Option("--messages", help="The sequence of its messages.")] = False,
    chart: Annotated[Path | None, typer.Option(help="Write the messages as a sequence chart to this SVG file.")] = None,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Everything of one task. Its steps, what was done and what became of it, terms, events; also when no system runs."""
    from somrs.cli.task_commands import task as run

    awaited(run(task, data, messages=messages, picture=chart, json=json))


@tasks_app.command()
def cancel(
    task: TaskName,
    reason: Annotated[str, typer.Option(help="Why.")] = "cancelled by the client",
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Stop a task, and have undone what was done."""
    from somrs.cli.task_commands import cancel as run

    awaited(run(task, reason, data))


@tasks_app.command()
def export(
    out: Annotated[Path | None, typer.Argument(help="The file to write; otherwise it is printed.")] = None,
    format: Annotated[
        FormatOption | None, typer.Option(help="JSON lines, a task a line; or CSV. If it is not said, the file's name says it.")
    ] = None,
    table: Annotated[TableOption | None, typer.Option(help="With CSV: what a row is; tasks, if it is not said.")] = None,
    since: SinceOption = None,
    outcome: OutcomeWanted = None,
    text: TextOption = None,
    service: ByOption = None,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Write what is kept of tasks that are over. For other programs, the latest first; also when no system runs."""
    from somrs.client.export import Format, Table
    from somrs.client.export import export as run

    csv = table is not None or (out is not None and out.suffix.lower() == ".csv")
    if format is FormatOption.jsonl and table is not None:
        fail(f"--table {table.value} is a table, and JSON lines hold all of a task; leave one of the two out", 2)
    chosen = Format(format.value) if format is not None else Format.CSV if csv else Format.JSONL
    chosen_table = Table(table.value) if table is not None else Table.TASKS
    awaited(run(out, data, chosen, chosen_table, guarded(lambda: _make_query(since, outcome, text, service))))


def _make_query(since: str | None, outcome: OutcomeOption | None, text: str | None, service: str | None) -> ReadRecords | None:
    """The tasks that are over that are asked for; None: all."""
    from somrs.client.export import moment
    from somrs.protocol.messages.frp import Outcome
    from somrs.protocol.messages.records import ReadRecords

    if since is None and outcome is None and not text and not service:
        return None
    start_time = moment(since, time.time()) if since is not None else None
    return ReadRecords(since=start_time, outcome=Outcome(outcome.value) if outcome is not None else None, text=text, service=service)
