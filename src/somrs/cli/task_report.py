"""Everything of one task, for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from somrs.client import terminal
from somrs.client.message_chart import SETBACKS, describe_message
from somrs.client.task_report import TaskReport
from somrs.client.trace import TASK_MANAGER, Line, without_heartbeats
from somrs.protocol.messages.clients import ContractView, WorkView
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.people import person_name


def tell(story: TaskReport, console: Console) -> None:
    """All but the messages."""
    seen, record = story.view, story.record
    parts: list[RenderableType] = [Group(Text(seen.effect, style="bold"), terminal.ending(seen), "", _facts(story))]
    if seen.steps:
        parts.append(terminal.steps("Plan" if record is None else "Last plan", seen.steps))
    if seen.work:
        parts.append(work(seen.work))
    if story.contracts:
        parts.append(contracts(story.contracts))
    if story.events:
        parts.append(Group(Text("Events", style="bold"), terminal.events(story.events)))
    for number, part in enumerate(parts):
        console.print(*([""] if number else []), part, sep="\n")


def _facts(story: TaskReport) -> Table:
    seen, record = story.view, story.record
    facts = [
        ("task", seen.task),
        ("submitted", terminal.moment(seen.submitted_at)),
        *([("ended", terminal.moment(record.ended_at))] if record is not None else []),
        ("by", person_name(seen.client)),
        ("policy", seen.policy.value),
        *([("priority", f"{seen.priority}")] if seen.priority else []),
        *([("from", seen.precondition)] if seen.precondition else []),
        *([("deadline", f"{seen.deadline:g} s")] if seen.deadline is not None else []),
    ]
    made = Table.grid(padding=(0, 2))
    for fact in facts:
        made.add_row(*fact)
    return made


def work(found: Iterable[WorkView]) -> Table:
    """What services did, in the order in which they began, and what became of it."""
    works = [*found]
    rows = (
        (
            one.step,
            terminal.lines(one.service, terminal.inputs(one)),
            terminal.state_text(one.state),
            terminal.lines(one.situation or "nothing is known", one.note),
        )
        for one in works
    )
    return terminal.table(
        "What was done",
        ("step", "by", "became", "and left"),
        rows,
        whole=("became",),
        least={"by": terminal.column_width(work.service for work in works)},
    )


def contracts(found: Iterable[ContractView]) -> Table:
    """Who was asked for a step, what they wanted, and who got it."""
    asked = [*found]
    rows = (
        (
            one.step,
            one.service,
            Text(
                f"{'✔ ' if one.accepted else ''}{terminal.terms(one.price, one.currency, one.duration) or '-'}",
                "green" if one.accepted else "",
            ),
            Group(terminal.state_text(one.state)) if one.state is not State.ENDED else one.reason or "left",
        )
        for one in asked
    )
    return terminal.table(
        "Terms",
        ("step", "asked", "offered (✔ accepted)", "in the end"),
        rows,
        least={"asked": terminal.column_width(one.service for one in asked)},
    )


def messages(lines: Sequence[Line]) -> Table:
    """The sequence of messages, seen from the Task Manager; of signs of life in a row, the last."""
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
        "Messages: → from the Task Manager, ← to it", ("after", "with", "message", "which says"), rows, whole=("after", "message")
    )
