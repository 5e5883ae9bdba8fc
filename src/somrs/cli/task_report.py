"""The report on a task, for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from somrs.client import terminal
from somrs.client.message_chart import SETBACKS, describe_message
from somrs.client.state_labels import priority_text
from somrs.client.task_report import TaskReport
from somrs.client.trace import TASK_MANAGER, Line, without_heartbeats
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.people import person_name
from somrs.protocol.messages.task_views import ContractView, WorkView


def print_report(report: TaskReport, console: Console) -> None:
    """Print the report without the messages."""
    view, record = report.view, report.record
    parts: list[RenderableType] = [Group(Text(view.effect, style="bold"), terminal.ending(view), "", _facts(report))]
    if view.steps:
        parts.append(terminal.steps("Plan" if record is None else "Last plan", view.steps))
    if view.work:
        parts.append(_work(view.work))
    if view.findings is not None:
        parts.append(terminal.findings(view.findings, view.outcome))
    if report.contracts:
        parts.append(contracts(report.contracts))
    if report.events:
        parts.append(Group(Text("Events", style="bold"), terminal.events(report.events)))
    for number, part in enumerate(parts):
        console.print(*([""] if number else []), part, sep="\n")


def _facts(report: TaskReport) -> Table:
    view, record = report.view, report.record
    facts = [
        ("task", view.task),
        ("submitted", terminal.moment(view.submitted_at)),
        *([("at", view.task_manager)] if view.task_manager else []),
        *([("ended", terminal.moment(record.ended_at))] if record is not None else []),
        ("by", person_name(view.client)),
        *terminal.forecast(view),
        ("policy", view.policy.value),
        ("priority", priority_text(view.priority).lower()),
        *([("from", view.precondition)] if view.precondition else []),
        *([("deadline", f"{view.deadline:g} s")] if view.deadline is not None else []),
    ]
    table = Table.grid(padding=(0, 2))
    for fact in facts:
        table.add_row(*fact)
    return table


def _work(views: Iterable[WorkView]) -> Table:
    """The execution log: the work of services in the order in which it began, with its results."""
    rows = (
        (
            work.step,
            terminal.lines(work.service, terminal.inputs(work)),
            terminal.state_text(work.state),
            terminal.lines(work.situation or "not known", work.note),
        )
        for work in views
    )
    return terminal.table("Execution log", ("step", "service", "result", "situation"), rows, whole=("result",))


def contracts(views: Iterable[ContractView]) -> Table:
    """The services that received a call for terms, with their terms and the results."""
    rows = (
        (
            contract.step,
            contract.service,
            Text(
                f"{'✔ ' if contract.accepted else ''}{terminal.terms(contract.price, contract.currency, contract.duration) or '-'}",
                "green" if contract.accepted else "",
            ),
            Group(terminal.state_text(contract.state)) if contract.state is not State.ENDED else contract.reason or "left",
        )
        for contract in views
    )
    return terminal.table("Terms", ("step", "service", "terms (✔ accepted)", "result"), rows)


def messages(lines: Sequence[Line]) -> Table:
    """The sequence of messages from the Task Manager's point of view; of consecutive heartbeats, only the last."""
    start = lines[0].at if lines else 0.0
    rows = (
        (
            f"{line.at - start:.2f} s",
            f"→ {line.recipient}" if line.sender == TASK_MANAGER else f"← {line.sender}",
            Text(line.type, style="bold red" if line.type in SETBACKS else "bold"),
            describe_message(line),
        )
        for line in without_heartbeats(lines)
    )
    return terminal.table(
        "Messages: → from the Task Manager, ← to it", ("time", "service", "message", "content"), rows, whole=("time", "message")
    )
