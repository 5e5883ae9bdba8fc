"""The commands about tasks: submit, list, show, cancel, and export."""

from __future__ import annotations

import sys
import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from msgspec import structs

from somrs.cli.ontology import DEFAULT_AUTHOR, Author
from somrs.cli.options import DEFAULT_FOLDER, Data, Formula, Json, Priority, Unavailable, UnavailableOption, awaited, fail, guarded
from somrs.cli.task_options import Deadline, PolicyOption, PolicyWanted, Precondition, TaskManagerName, TimeValue, stated_task

if TYPE_CHECKING:
    from somrs.protocol.messages.records import ReadRecords

tasks_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)

TaskName = Annotated[str, typer.Argument(help="The task's id or the beginning of it, or `last`.")]
_PROCEDURE = "[SERVICE TYPE:] FORMULA [WHEN FORMULA]; the step's inputs are variables, such as ?Object. Can be given several times."

SinceOption = Annotated[str | None, typer.Option(help="Only tasks that ended since 2026-03-01, since 2026-03-01T14:30, or within 2h, 7d.")]
TextOption = Annotated[str | None, typer.Option("--text", help="Only tasks with this text in the goal.")]
ByOption = Annotated[str | None, typer.Option("--by", help="Only tasks in which this service, or a service of this device, took part.")]


class OutcomeOption(StrEnum):
    """How a task ended."""

    accomplished = "accomplished"
    failed = "failed"
    cancelled = "cancelled"


OutcomeWanted = Annotated[OutcomeOption | None, typer.Option("--outcome", help="Only tasks with this outcome.")]


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
    precondition: Precondition = None,
    policy: PolicyWanted = PolicyOption.price,
    time_value: TimeValue = 0.01,
    deadline: Deadline = None,
    priority: Priority = 0,
    on_failure: Annotated[
        list[str], typer.Option(help=f"A goal to achieve when a step fails, before the recovery of the step: {_PROCEDURE}")
    ] = [],  # noqa: B006  # typer requires a list as the default
    on_compensation: Annotated[
        list[str], typer.Option(help=f"A goal to achieve to undo a step, instead of the situation before it: {_PROCEDURE}")
    ] = [],  # noqa: B006  # as above
    unavailable: Unavailable = UnavailableOption.wait,
    task_manager: TaskManagerName = None,
    wait: Annotated[bool, typer.Option(help="Wait until the task has ended.")] = True,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Submit a task, with a formula as its goal. Shows the plan, the services, the recovery from failures, and the outcome."""
    from somrs.cli.task_commands import handlers
    from somrs.cli.task_commands import run_task as run

    task = stated_task(formula, precondition, policy, time_value, deadline, priority, unavailable)
    submission = structs.replace(task, handlers=guarded(lambda: handlers(on_failure, on_compensation)))
    sys.exit(awaited(run(submission, data, wait=wait, json=json, task_manager=task_manager)))


@tasks_app.command()
def look(
    formula: Annotated[str, typer.Argument(help="What to find out, such as '?Jar: Jar isOn Table001' or 'Jar001.Weight = ?Weight'.")],
    policy: PolicyWanted = PolicyOption.price,
    deadline: Annotated[float | None, typer.Option(help="Seconds within which it has to be found out.")] = None,
    unavailable: Unavailable = UnavailableOption.fail,
    task_manager: TaskManagerName = None,
    wait: Annotated[bool, typer.Option(help="Wait until the observations have ended.")] = True,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Find out for which objects and values a formula holds. Cognitive services observe it; nothing is moved. Shows the answers, who saw
    them, and when."""
    from somrs.cli.task_commands import run_task as run
    from somrs.protocol.messages.submission import Policy, Submit

    waits = unavailable is UnavailableOption.wait
    submission = Submit(effect=formula, policy=Policy(policy.value), deadline=deadline, waits=waits, recognise=True)
    sys.exit(awaited(run(submission, data, wait=wait, json=json, task_manager=task_manager)))


@tasks_app.command()
def tasks(
    history: Annotated[bool, typer.Option("--history", help="List ended tasks, too.")] = False,
    limit: Annotated[int, typer.Option(min=1, max=1_000_000, help="Maximum number of ended tasks.")] = 20,
    since: SinceOption = None,
    outcome: OutcomeWanted = None,
    text: TextOption = None,
    service: ByOption = None,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """List the running tasks. With --history, also the ended tasks, even if no system runs. With --since, --outcome, --text or --by, only
    the ended tasks that match."""
    from somrs.cli.task_commands import tasks as run

    query = guarded(lambda: _make_query(since, outcome, text, service))
    awaited(run(data, history=history or query is not None, limit=limit, json=json, query=query))


@tasks_app.command()
def task(
    task: TaskName,
    messages: Annotated[bool, typer.Option("--messages", help="Show the sequence of its messages.")] = False,
    chart: Annotated[Path | None, typer.Option(help="Write the messages as a sequence chart to this SVG file.")] = None,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Show a task. Its steps, execution log, terms and events; ended tasks even if no system runs."""
    from somrs.cli.task_commands import task as run

    awaited(run(task, data, messages=messages, picture=chart, json=json))


@tasks_app.command()
def cancel(
    task: TaskName,
    reason: Annotated[str, typer.Option(help="The reason for the cancellation.")] = "cancelled by the client",
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Cancel a task. Its running steps are stopped, and the completed ones are compensated."""
    from somrs.cli.task_commands import cancel as run

    awaited(run(task, reason, data))


@tasks_app.command()
def pause(task: TaskName, author: Author = DEFAULT_AUTHOR, data: Data = DEFAULT_FOLDER) -> None:
    """Pause a task. The devices that work for it stand still, and nothing of it begins, until `somrs resume`. Other tasks go on."""
    from somrs.cli.task_commands import pause as run

    awaited(run(task, author, data, paused=True))


@tasks_app.command()
def resume(task: TaskName, author: Author = DEFAULT_AUTHOR, data: Data = DEFAULT_FOLDER) -> None:
    """Let a paused task go on, where it was."""
    from somrs.cli.task_commands import pause as run

    awaited(run(task, author, data, paused=False))


@tasks_app.command()
def retry(
    task: TaskName,
    wait: Annotated[bool, typer.Option(help="Wait until the new task has ended.")] = True,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Submit an ended task once more, with the same goal and options. The new task names the old one."""
    from somrs.cli.task_commands import retry as run

    sys.exit(awaited(run(task, data, wait=wait, json=json)))


@tasks_app.command()
def export(
    out: Annotated[Path | None, typer.Argument(help="The file to write; by default, standard output.")] = None,
    format: Annotated[
        FormatOption | None, typer.Option(help="JSON lines, one task per line, or CSV; by default, according to the file's name.")
    ] = None,
    table: Annotated[TableOption | None, typer.Option(help="With CSV: what each row describes; by default, a task.")] = None,
    since: SinceOption = None,
    outcome: OutcomeWanted = None,
    text: TextOption = None,
    service: ByOption = None,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Export the records of ended tasks. For other programs, the latest first; even if no system runs."""
    from somrs.cli.running_site import site_on_bus
    from somrs.client.export import Format, Table
    from somrs.client.export import export as write

    async def run(query: ReadRecords | None) -> None:
        await write(out, data, chosen, chosen_table, query, site=await site_on_bus())

    csv = table is not None or (out is not None and out.suffix.lower() == ".csv")
    if format is FormatOption.jsonl and table is not None:
        fail(f"--table {table.value} is for CSV; JSON lines contain the whole of each task. Leave out --table, or choose CSV", 2)
    chosen = Format(format.value) if format is not None else Format.CSV if csv else Format.JSONL
    chosen_table = Table(table.value) if table is not None else Table.TASKS
    awaited(run(guarded(lambda: _make_query(since, outcome, text, service))))


def _make_query(since: str | None, outcome: OutcomeOption | None, text: str | None, service: str | None) -> ReadRecords | None:
    """The query for ended tasks; None for all of them."""
    from somrs.client.export import moment
    from somrs.protocol.messages.frp import Outcome
    from somrs.protocol.messages.records import ReadRecords

    if since is None and outcome is None and not text and not service:
        return None
    start_time = moment(since, time.time()) if since is not None else None
    return ReadRecords(since=start_time, outcome=Outcome(outcome.value) if outcome is not None else None, text=text, service=service)
