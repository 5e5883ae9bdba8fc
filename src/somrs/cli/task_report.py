"""Everything of one task, for the terminal and for programs: its steps, what was done and what became of it, terms, events, messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from somrs.client import terminal as show
from somrs.client.message_chart import SETBACKS, said
from somrs.client.trace import TASK_MANAGER, Line, without_heartbeats
from somrs.protocol.messages.clients import ContractView, Phase, TaskEvent, TaskRecord, TaskView, WorkView
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.people import person


class Story(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of a task. Only of one that is over there is a record."""

    view: TaskView
    events: tuple[TaskEvent, ...] = ()
    contracts: tuple[ContractView, ...] = ()
    record: TaskRecord | None = None

    @classmethod
    def of(cls, record: TaskRecord) -> Story:
        return cls(view=view(record), events=record.events, contracts=record.contracts, record=record)


def view(record: TaskRecord) -> TaskView:
    """A task that is over, as those that are not are seen."""
    shared = {name: getattr(record, name) for name in TaskView.__struct_fields__ if name in TaskRecord.__struct_fields__}
    return TaskView(phase=Phase.ENDED, **shared)


def builtins(story: Story) -> dict[str, Any]:
    """For programs: one flat object, with the fields of a TaskView, and `events`; and of a TaskRecord, once there is one."""
    more = {"events": story.events, "contracts": story.contracts}
    found: dict[str, Any] = msgspec.to_builtins(story.view) | msgspec.to_builtins(more)
    return found if story.record is None else found | msgspec.to_builtins(story.record)


def tell(story: Story, console: Console) -> None:
    """All but the messages."""
    seen, record = story.view, story.record
    parts: list[RenderableType] = [Group(Text(seen.effect, style="bold"), show.ending(seen), "", _facts(story))]
    if seen.steps:
        parts.append(show.steps("Plan" if record is None else "Last plan", seen.steps))
    if seen.work:
        parts.append(work(seen.work))
    if story.contracts:
        parts.append(contracts(story.contracts))
    if story.events:
        parts.append(Group(Text("Events", style="bold"), show.events(story.events)))
    for number, part in enumerate(parts):
        console.print(*([""] if number else []), part, sep="\n")


def _facts(story: Story) -> Table:
    seen, record = story.view, story.record
    facts = [
        ("task", seen.task),
        ("submitted", show.moment(seen.submitted_at)),
        *([("ended", show.moment(record.ended_at))] if record is not None else []),
        ("by", person(seen.client)),
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
            show.lines(one.service, show.inputs(one)),
            show.became(one.state),
            show.lines(one.situation or "nothing is known", one.note),
        )
        for one in works
    )
    return show.table(
        "What was done",
        ("step", "by", "became", "and left"),
        rows,
        whole=("became",),
        least={"by": show.room(work.service for work in works)},
    )


def contracts(found: Iterable[ContractView]) -> Table:
    """Who was asked for a step, what they wanted, and who got it."""
    asked = [*found]
    rows = (
        (
            one.step,
            one.service,
            Text(
                f"{'✔ ' if one.accepted else ''}{show.terms(one.price, one.currency, one.duration) or '-'}", "green" if one.accepted else ""
            ),
            Group(show.became(one.state)) if one.state is not State.ENDED else one.reason or "left",
        )
        for one in asked
    )
    return show.table(
        "Terms", ("step", "asked", "offered (✔ accepted)", "in the end"), rows, least={"asked": show.room(one.service for one in asked)}
    )


def messages(lines: Sequence[Line]) -> Table:
    """The sequence of messages, seen from the Task Manager; of signs of life in a row, the last."""
    start = lines[0].at if lines else 0.0
    rows = (
        (
            f"{line.at - start:.2f} s",
            f"→ {line.recipient}" if line.sender == TASK_MANAGER else f"← {line.sender}",
            Text(line.type, style="bold red" if line.type in SETBACKS else "bold"),
            said(line),
        )
        for line in without_heartbeats(lines)
    )
    return show.table(
        "Messages: → from the Task Manager, ← to it", ("after", "with", "message", "which says"), rows, whole=("after", "message")
    )
