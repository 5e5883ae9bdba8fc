"""Reports for people: one run as a list of messages and events in order, and many runs as figures."""

from __future__ import annotations

from collections.abc import Iterator

from rich.table import Table

from somrs.kernel.component import Input, Received
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_text import sentence
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import Rejected, UpdateMap
from somrs.protocol.messages.submission import Cancelling, CancelTask, Submit, Submitted, TaskRejected
from verification.fault_runs.result import RECOVERIES, Result
from verification.fault_runs.scenario_run import ScenarioRun

REPORTED_BODIES = (
    frp.Arrange | frp.Terms | frp.Refuse | frp.Accept | frp.Cancel | frp.Execute | frp.Completed | frp.Failed | frp.Stop | frp.Stopped
    | frp.Compensate | frp.Compensated | frp.Stranded | frp.Query | frp.Status | frp.End | frp.Fault
    | UpdateMap | Rejected | Submit | Submitted | TaskRejected | CancelTask | Cancelling
)  # fmt: skip
"""The types of messages that a report lists, without heartbeats and subscriptions."""


class MessageLog:
    """Collects the messages that arrive at each address."""

    def __init__(self) -> None:
        self.entries: list[tuple[float, str]] = []

    def record(self, time: float, event: Input) -> None:
        if isinstance(event, Received) and isinstance(event.message.body, REPORTED_BODIES):
            self.entries.append((time, _describe(event.message)))


def report_lines(scenario_run: ScenarioRun, message_log: MessageLog) -> Iterator[str]:
    """Yield the messages and events of a run, in order of time."""
    lines = [(time, 0, f"    ! {text}") for time, text in scenario_run.log]
    lines += [
        (d.at, 1, f"    * {d.actor}: {d.object} {_state(d.state_before)} -> {_state(d.state_after)}") for d in scenario_run.reality.actions
    ]
    lines += [(time, 2, text) for time, text in message_log.entries]
    for address in scenario_run.managers:
        manager = scenario_run.task_manager(address)
        for task in manager.state.tasks.values() if manager is not None else ():
            lines += [(event.at, 3, f"  {address} {task.id[-6:]} {event.step or ''}: {sentence(event.event)}") for event in task.events]
    for time, _, text in sorted(lines, key=lambda line: line[:2]):
        yield f"{time - scenario_run.start:10.3f} {text}"


def _describe(message: Message) -> str:
    header, body = message.header, message.body
    participant = f" {header.participant}" if header.participant else ""
    task = f" {header.transaction[-6:]}" if header.transaction else ""
    text = getattr(body, "situation", None) or getattr(body, "reason", None) or getattr(body, "description", None) or ""
    if isinstance(body, Submit):
        text = body.effect
    return f"{header.sender} > {header.recipient}:{task}{participant} {type(body).__name__} {text}".rstrip()


def _state(state: tuple[str, str] | bool) -> str:
    return " ".join(state) if isinstance(state, tuple) else "open" if state else "closed"


def figures(result: Result, seconds: float) -> Table:
    """Return a table of the outcomes of tasks and of the recoveries."""
    table = Table(title=f"{result.runs} runs, {result.runs / seconds:.0f} a second", title_justify="left", show_header=True)
    table.add_column("tasks")
    table.add_column("all", justify="right")
    table.add_column("with a failure", justify="right")
    for outcome in Outcome:
        table.add_row(outcome.value, str(result.tasks[outcome]), str(result.troubled[outcome]))
    table.add_section()
    troubled_count = sum(result.troubled.values())
    table.add_row(
        "accomplished despite a failure", "", f"{result.troubled[Outcome.ACCOMPLISHED] / troubled_count:.1%}" if troubled_count else "-"
    )
    table.add_section()
    for recovery in (*dict.fromkeys(RECOVERIES.values()), "stranded", "given up", "rejected"):
        table.add_row(recovery, str(result.recoveries[recovery]), "")
    table.add_section()
    table.add_row("messages per run", f"{result.messages / result.runs:.0f}" if result.runs else "-", "")
    table.add_row("inputs per run", f"{result.inputs / result.runs:.0f}" if result.runs else "-", "")
    return table
