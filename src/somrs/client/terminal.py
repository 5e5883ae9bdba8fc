"""Output for the terminal: tables, plans, and running tasks."""

from __future__ import annotations

import json
import time
from collections.abc import Collection, Iterable, Sequence
from datetime import datetime

import msgspec
from rich.console import Console, Group
from rich.padding import Padding
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from somrs.client.fitted_table import FittedTable
from somrs.client.message_chart import SETBACKS, describe_message
from somrs.client.state_labels import OUTCOMES, task_state
from somrs.client.task_forecast import cost_text, remaining_text
from somrs.client.task_report import reasons
from somrs.client.trace import Line
from somrs.ontology.objects import Change, FactAdded, FactRemoved, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.services import ServiceType
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.events import TaskEnded
from somrs.protocol.messages.findings import Findings
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.observations import Discovery
from somrs.protocol.messages.people import person_name
from somrs.protocol.messages.task_views import StepView, TaskEvent, TaskView, WorkView

MARKS = {Outcome.ACCOMPLISHED: ("✔", "green"), Outcome.FAILED: ("✘", "red"), Outcome.CANCELLED: ("■", "yellow")}
"""A sign and a colour for each outcome; colour is never the only sign."""

SIGNS = {
    State.COMPLETED: ("✔", "green"),
    State.FAILED: ("✘", "red"),
    State.STOPPED: ("■", "yellow"),
    State.COMPENSATED: ("↶", "green"),
    State.STRANDED: ("!", "red"),
    State.UNREACHABLE: ("?", "red"),
}
"""A sign and a colour for each result of work."""

COLOURS = {EventKind.SETBACK: "red", EventKind.END: "bold"}
"""Colours of kinds of events; the remaining kinds are recoveries."""

PARTY = 28
"""Width of a column with the sender or recipient of a message, in characters: `Camera001.RecognizeSituation` fits."""


def print_json(value: object) -> None:
    """Print a value as JSON on standard output, for programs."""
    print(json.dumps(msgspec.to_builtins(value), ensure_ascii=False, indent=2))


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]], whole: Collection[str] = ()) -> Table:
    """A table that fits the terminal. `whole`: columns whose lines are not wrapped; those of others are, between words.

    If the terminal is too narrow for this, each row is a block of lines.
    """
    grid = FittedTable(title)
    for column in columns:
        grid.add_column(column, overflow="fold", no_wrap=column in whole)
    for row in rows:
        grid.add_row(*(cell if isinstance(cell, Text | ProgressBar | Group) else Text(str(cell)) for cell in row))
    return grid


def lines(*parts: str) -> str:
    """The non-empty parts, one per line."""
    return "\n".join(part for part in parts if part)


def inputs(step: StepView | WorkView) -> str:
    return "\n".join(f"{name}: {value}" for name, value in step.inputs.items())


def demand(step: StepView) -> str:
    """What services demanded for a step."""
    return f"demanded: {step.condition} ({', '.join(step.demanded_by)})" if step.condition is not None else ""


def learnt(step: StepView) -> str:
    """What the step finds out, and the values that it returned."""
    values = ", ".join(f"{name} = {value}" for name, value in step.outputs.items())
    return lines(f"finds out: {', '.join(step.learns)}" if step.learns else "", f"found: {values}" if values else "")


def findings(findings: Findings, outcome: Outcome | None) -> Group:
    """The answers to a question: what is so, who saw it, and when; and who did not find what. If the task was not accomplished, nobody
    could find out all that was asked, and what the map has besides is said to be this."""
    rows = [
        (answer.situation, answer.sightings[0].service, moment(answer.sightings[0].at))
        if answer.sightings
        else (answer.situation, "(the map)", "-")
        for answer in findings.answers
    ]
    is_known = outcome is Outcome.ACCOMPLISHED
    title = "Findings" if is_known else "Not known; the map has"
    nothing = Text(f"{'not so' if is_known else 'not known'}: {findings.formula}", style="bold")
    answers = table(title, ("what is so", "seen by", "at"), rows) if rows else nothing
    unseen = [Text(f"{entry.service} ({', '.join(entry.inputs.values())}): {entry.reason}", style="yellow") for entry in findings.unseen]
    more = [Text("there are further answers")] if findings.more else []
    return Group(answers, *more, *unseen)


def steps(title: str, step_views: Sequence[StepView], other_work: Sequence[WorkView] = ()) -> Table:
    """A plan with the state of each step, followed by `other_work`, which is not part of the plan (observation, compensation)."""
    is_ordered = any(step.after for step in step_views)
    columns = ("step", "action", *(("after",) if is_ordered else ()), "service", "state")
    rows = [
        (
            step.step,
            lines(step.service_type, inputs(step), demand(step), learnt(step)),
            *((", ".join(step.after) or "-",) if is_ordered else ()),
            lines(step.service or "-", terms(step.price, step.currency, step.duration)),
            _step_progress(step),
        )
        for step in step_views
    ]
    other_rows = (
        (work.step, lines(work.service_type, inputs(work)), *(("-",) if is_ordered else ()), work.service, state_text(work.state))
        for work in other_work
    )
    return table(title, columns, [*rows, *other_rows], whole=("state",))


def terms(price: float | None, currency: str, duration: float | None) -> str:
    """The price and the duration (seconds) that a service offers, as text."""
    cost = f"{price:g} {currency}" if price is not None else ""
    return ", ".join(part for part in (cost, f"{duration:.0f} s" if duration is not None else "") if part)


def _step_progress(step: StepView) -> Group | Text:
    """The state of a step, with a progress bar while it executes."""
    if step.foreseen:
        return Text("foreseen", style="dim")
    if step.state is State.NEW:
        return Text("open", style="dim")
    if step.state is not State.EXECUTING:
        return state_text(step.state)
    return Group(Text(f"{step.state.value} {100 * step.fraction:.0f} %"), ProgressBar(total=1.0, completed=step.fraction, width=14))


def state_text(state: State) -> Text:
    """A state with its sign and colour."""
    sign, colour = SIGNS.get(state, ("", ""))
    return Text(f"{sign} {state.value}".strip(), style=colour)


def plan(step_views: Sequence[StepView]) -> Table:
    """A plan that is not being executed."""
    return table(
        "Plan",
        ("step", "action", "after", "reason"),
        (
            (
                step.step,
                lines(step.service_type, inputs(step), demand(step)),
                ", ".join(step.after) or "-",
                "\n".join(dict.fromkeys(step.because)) or "-",
            )
            for step in step_views
        ),
    )


def outcome(view: TaskView) -> Text:
    """The state of a task, and the first reason for it."""
    reason_text = "".join(f": {reason}" for reason in reasons(view)[:1])
    return _progress_text(view).append(reason_text, style="not bold" if view.outcome is None else None)


def _progress_text(view: TaskView) -> Text:
    """The state of a task; after its end, with its total time."""
    if view.outcome is None:
        return Text(task_state(view.phase, None).lower(), style="bold")
    sign, colour = MARKS[view.outcome]
    seconds = f" in {view.ended_at - view.submitted_at:.1f} s" if view.ended_at is not None else ""
    return Text(f"{sign} {task_state(view.phase, view.outcome).lower()}{seconds}", style=colour)


def ending(view: TaskView) -> Group:
    """The state of a task, and the reasons for it, one per line."""
    return Group(_progress_text(view), *(Padding(Text(reason), (0, 0, 0, 2)) for reason in reasons(view)))


def tasks(views: Sequence[TaskView]) -> Table:
    """The tasks, and which Task Manager has them if there are several."""
    has_managers = any(view.task_manager for view in views)
    rows = (
        (
            short_id(view.task),
            view.effect,
            *([view.task_manager] if has_managers else []),
            moment(view.submitted_at),
            outcome(view).append("".join(f"\n{name} {text}" for name, text in forecast(view)), style="not bold dim"),
        )
        for view in views
    )
    columns = ("task", "goal", *(["Task Manager"] if has_managers else []), "submitted", "state")
    return table("Tasks", columns, rows, whole=("task", "submitted"))


def forecast(view: TaskView) -> list[tuple[str, str]]:
    """The remaining time and the cost of a task, each with its name, as far as they are known or expected."""
    texts = (("remaining", remaining_text(view, time.time())), ("cost", cost_text(view)))
    return [(name, text) for name, text in texts if text]


def services(offers: Sequence[Offer]) -> Table:
    """The services on offer. Their attributes are below their names, because formulas have long words."""
    rows = (
        (
            lines(
                offer.service,
                f"a {offer.provider_type}",
                f"from {offer.registry}" if offer.registry else "",
                *(f"{name} {value}" for name, value in offer.attributes.items()),
            ),
            offer.service_type.effect,
            lines(offer.service_type.precondition or "", while_text(offer.service_type)) or "-",
        )
        for offer in offers
    )
    return table("Services on offer", ("service and attributes", "effect", "precondition"), rows)


def while_text(service_type: ServiceType) -> str:
    """What has to hold while a service of the type runs."""
    return f"while {service_type.invariant}" if service_type.invariant is not None else ""


def clock(timestamp: float) -> str:
    return datetime.fromtimestamp(timestamp).strftime("%H:%M:%S")


def moment(timestamp: float) -> str:
    """The time of day, with the date unless that is today."""
    date_time = datetime.fromtimestamp(timestamp)
    return f"{date_time:%H:%M:%S}" if date_time.date() == datetime.now().date() else f"{date_time:%Y-%m-%d %H:%M}"


def discovered(discovery: Discovery) -> str:
    """Who put an object on the map by a sighting, and when."""
    return f"discovered by {person_name(discovery.author)}, {moment(discovery.at)}"


def event(task_event: TaskEvent) -> Text:
    """An event of a task, as one line."""
    step = f"{task_event.step}: " if task_event.step else ""
    return Text.assemble((f"{clock(task_event.at)}  ", "dim"), (step, "bold"), task_event.text)


def events(task_events: Iterable[TaskEvent]) -> Table:
    """The events of a task: time, kind (empty for ordinary news), and text. `ending` has the reasons for the outcome."""
    grid = Table.grid(padding=(0, 1), pad_edge=False)
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column(min_width=max(len(kind.value) for kind in EventKind), no_wrap=True)
    grid.add_column(overflow="fold")
    for task_event in task_events:
        colour = COLOURS.get(task_event.kind, "bold cyan")
        kind = Text("" if task_event.kind is EventKind.NEWS else task_event.kind.value, style=colour)
        step = f"{task_event.step}: " if task_event.step else ""
        text = OUTCOMES[task_event.event.outcome].lower() if isinstance(task_event.event, TaskEnded) else task_event.text
        grid.add_row(clock(task_event.at), kind, Text.assemble((step, "bold"), text))
    return grid


def passing(line: Line, start: float) -> Text:
    """A message, as one line. `start`: the time of the first message."""
    style = "bold red" if line.type in SETBACKS else "bold"
    parties = f"{line.sender:>{PARTY}} → {line.recipient:<{PARTY}} "
    return Text.assemble(f"{line.at - start:7.2f} s ", (parties, "dim"), (f"{line.type:<12}", style), describe_message(line))


def live(view: TaskView) -> Group:
    """The plan and the state of a running or ended task."""
    if not view.steps:
        return ending(view)
    step_names = {step.step for step in view.steps}
    other_work = (
        [work for work in view.work if work.state is State.EXECUTING and work.step not in step_names] if view.outcome is None else []
    )
    return Group("", steps(view.effect, view.steps, other_work), "", ending(view))


def change(map_change: Change) -> str:
    """A change of the map, as one line."""
    match map_change:
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
