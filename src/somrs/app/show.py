"""How things look in the terminal: tables, plans, and a task while it runs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import Any

import msgspec
from rich.console import Console, Group
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from somrs.ontology.objects import Change, FactAdded, FactRemoved, ObjectAdded, ObjectRemoved, ValueSet
from somrs.protocol.clients import StepView, TaskEvent, TaskView
from somrs.protocol.directory import Offer
from somrs.protocol.frp import Outcome, State

MARKS = {Outcome.ACCOMPLISHED: ("✔", "green"), Outcome.FAILED: ("✘", "red"), Outcome.CANCELLED: ("■", "yellow")}
"""A sign and a colour for each outcome; colour is never the only sign."""


def print_json(value: object) -> None:
    """For programs: plain JSON on standard output."""
    print(json.dumps(msgspec.to_builtins(value), ensure_ascii=False, indent=2))


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Table:
    made = Table(title=title, title_justify="left", title_style="bold", header_style="bold", expand=False)
    for column in columns:
        made.add_column(column, overflow="fold")
    for row in rows:
        made.add_row(*(cell if isinstance(cell, Text | ProgressBar) else str(cell) for cell in row))
    return made


def inputs(step: StepView) -> str:
    return ", ".join(f"{name}: {value}" for name, value in step.inputs.items())


def steps(title: str, found: Sequence[StepView]) -> Table:
    """A plan, and how far each step is."""
    return table(
        title,
        ("step", "service type", "inputs", "after", "by", "price", "state", ""),
        (
            (
                step.step,
                step.service_type,
                inputs(step),
                ", ".join(step.after) or "-",
                step.service or "-",
                f"{step.price:g} EUR" if step.price is not None else "-",
                step.state.value if step.state is not State.NEW else "open",
                ProgressBar(total=1.0, completed=1.0 if step.state is State.COMPLETED else step.fraction, width=16),
            )
            for step in found
        ),
    )


def plan(found: Sequence[StepView]) -> Table:
    """A plan that nobody carries out."""
    return table(
        "Plan",
        ("step", "service type", "inputs", "after", "because"),
        (
            (step.step, step.service_type, inputs(step), ", ".join(step.after) or "-", "; ".join(dict.fromkeys(step.because)) or "-")
            for step in found
        ),
    )


def outcome(view: TaskView) -> Text:
    """How a task ended, in a line."""
    if view.outcome is None:
        return Text(view.phase.value)
    sign, colour = MARKS[view.outcome]
    seconds = f" in {view.ended_at - view.submitted_at:.1f} s" if view.ended_at is not None else ""
    why = f": {view.explanation}" if view.explanation else ""
    return Text(f"{sign} {view.outcome.value}{seconds}{why}", style=colour)


def tasks(found: Sequence[TaskView]) -> Table:
    return table(
        "Tasks",
        ("task", "wish", "submitted", "how far"),
        ((view.task.rpartition(":")[2][:8], view.effect, clock(view.submitted_at), outcome(view)) for view in found),
    )


def services(found: Sequence[Offer]) -> Table:
    return table(
        "Services on offer",
        ("service", "device", "brings about", "if", "attributes"),
        (
            (
                offer.service,
                f"{offer.provider}: {offer.provider_type}",
                offer.service_type.effect,
                offer.service_type.precondition or "-",
                ", ".join(f"{name} {value}" for name, value in offer.attributes.items()) or "-",
            )
            for offer in found
        ),
    )


def clock(at: float) -> str:
    return datetime.fromtimestamp(at).strftime("%H:%M:%S")


def event(happened: TaskEvent) -> Text:
    """Something that happened to a task, in a line."""
    step = f"{happened.step}: " if happened.step else ""
    return Text.assemble((f"{clock(happened.at)}  ", "dim"), (step, "bold"), happened.text)


def live(view: TaskView) -> Group:
    """A task under way."""
    parts: list[Any] = [outcome(view)]
    return Group(steps(view.effect, view.steps), *parts) if view.steps else Group(*parts)


def change(made: Change) -> str:
    """A change of the map, in a line."""
    match made:
        case ObjectAdded(object):
            return f"{object.name}: {object.type} appeared"
        case ObjectRemoved(name):
            return f"{name} disappeared"
        case ValueSet(name, path, None):
            return f"{name}.{path} is unknown"
        case ValueSet(name, path, value):
            return f"{name}.{path} = {value}"
        case FactAdded(fact):
            return f"{fact}"
        case FactRemoved(fact):
            return f"no longer {fact}"


def console() -> Console:
    return Console(highlight=False)
