"""Texts for tasks: badges of phases and outcomes, ids and names for display, shortened situations."""

from __future__ import annotations

import re

from somrs.client import state_labels
from somrs.client.durations import format_duration
from somrs.gui.components.task.waits import WaitText
from somrs.gui.icons import OUTCOMES, Sign, join_names
from somrs.protocol.messages.event_text import reserved_text, short_id
from somrs.protocol.messages.task_views import Phase, TaskRow, TaskView
from somrs.protocol.messages.waits import WaitsForTasks, WaitsToRetry

PHASES = {
    Phase.PLANNING: Sign("schema", state_labels.PHASES[Phase.PLANNING], "busy"),
    Phase.WAITING: Sign("hourglass_empty", state_labels.PHASES[Phase.WAITING], "plain"),
    Phase.ARRANGING: Sign("handshake", state_labels.PHASES[Phase.ARRANGING], "busy"),
    Phase.EXECUTING: Sign("play_circle", state_labels.PHASES[Phase.EXECUTING], "busy"),
    Phase.RECOVERING: Sign("healing", state_labels.PHASES[Phase.RECOVERING], "bad"),
    Phase.COMPENSATING: Sign("undo", state_labels.PHASES[Phase.COMPENSATING], "bad"),
    Phase.ENDED: Sign("flag", state_labels.PHASES[Phase.ENDED], "plain"),
}

_PLACE = re.compile(r"(\w+)\.PositionX = (\S+) AND \1\.PositionY = (\S+)(?: AND \1\.PositionZ = \S+)?")
_FIGURES = re.compile(r" AND \w+\.(?:Position|Rotation)\w* = \S+")
NEARBY_POSITION = re.compile(r" AND \w+ at \S+, \S+ m")
"""A position in numbers after another statement about the place, which is more informative."""


PAUSED = Sign("pause_circle", "Paused", "busy")


def task_sign(task: TaskView | TaskRow) -> Sign:
    """The badge for a task's phase or outcome, or that it is paused."""
    if task.outcome is not None:
        return OUTCOMES[task.outcome]
    return PAUSED if task.pause is not None else PHASES[task.phase]


def task_key(task: str) -> str:
    """A task's id without the common prefix, as in the address of its page."""
    return task.rpartition(":")[2]


def task_path(task: str) -> str:
    return f"/tasks/{task_key(task)}"


def wait_texts(waiting_for: WaitsForTasks | None) -> list[WaitText]:
    """The tasks that a task waits for."""
    holders = waiting_for.known_holders if waiting_for is not None else ()
    return [
        WaitText(goal=holder.goal or f"task {short_id(holder.task)}", href=task_path(holder.task), reserved=reserved_text(holder))
        for holder in holders
    ]


def hindrance_texts(wait: WaitsToRetry) -> list[str]:
    """Why there is no way to do a task now; services with the same reason together."""
    subjects_by_reason: dict[str, list[str]] = {}
    for hindrance in wait.hindrances:
        subjects_by_reason.setdefault(hindrance.reason, []).append(hindrance.subject)
    return [f"Waits for {join_names(subjects)}: {gist(reason)}." for reason, subjects in subjects_by_reason.items()]


def device_name(service: str) -> str:
    return service.partition(".")[0]


def gist(text: str) -> str:
    """Shorten a situation, or a text that ends with one: fewer numbers."""
    placed = _FIGURES.sub("", _PLACE.sub(r"\1 at \2, \3 m", text))
    return NEARBY_POSITION.sub("", placed).replace(" AND ", " and ")


def count_text(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def due_text(deadline: float | None, due_at: float | None, is_ended: bool, now: float) -> str:
    """The time that a task has left until its deadline, or had."""
    if deadline is None:
        return "none"
    if is_ended:
        return f"within {format_duration(deadline)}"
    if due_at is None:
        return f"within {format_duration(deadline)}; the simulation stands still"
    remaining = due_at - now
    return f"in {format_duration(remaining)}" if remaining > 0 else f"{format_duration(-remaining)} overdue"
