"""The parts of a task's story: its chapters and their lines. `task_story.py` makes them from events."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from somrs.gui.pages.task_text import count_text
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.waits import WaitsForTasks

ANSWERS = {
    EventKind.HANDLER: "handler",
    EventKind.LOOK: "observation",
    EventKind.REPLACE: "replacement",
    EventKind.REPLAN: "new plan",
    EventKind.UNDO: "compensation",
}
"""Names of the recovery ladder's actions (docs/explanation/recovery.md) within a sentence."""

LABELS = {
    EventKind.HANDLER: "Handler",
    EventKind.LOOK: "Observation",
    EventKind.REPLACE: "Replacement",
    EventKind.REPLAN: "New plan",
    EventKind.UNDO: "Compensation",
    EventKind.SETBACK: "Setback",
    EventKind.WAIT: "Wait",
    EventKind.END: "End",
}
"""Labels of events before a line; other kinds have no label."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One recovery action after a failure. `kind` is set on the first line of each kind."""

    at: float
    text: str
    kind: EventKind | None = None

    @property
    def recovery(self) -> str:
        return LABELS.get(self.kind, "") if self.kind is not None else ""


@dataclass(slots=True, kw_only=True)
class Chapter:
    """A part of the story. `tone`: good, bad, busy or plain. For a failure: `number` counts from 1; `service` is the one that failed;
    `silent` is True while the service has only stopped responding; `situation` is the situation that it left; `lines` are the recovery
    actions, and `result` their result. `waiting_for`: the tasks that the task began to wait for. `unblocking`: work is undone so that a
    plan becomes possible."""

    at: float
    icon: str
    title: str
    tone: str = "plain"
    text: str = ""
    step: str | None = None
    number: int | None = None
    service: str | None = None
    silent: bool = False
    unblocking: bool = False
    situation: str = ""
    waiting_for: WaitsForTasks | None = None
    lines: list[Line] = field(default_factory=list)
    result: str = ""
    result_tone: str = "busy"
    ended: float | None = None

    def add(self, at: float, text: str, kind: EventKind | None = None) -> None:
        """Add a line. Its kind is shown only if it differs from the kind of the line before."""
        last_kind = next((line.kind for line in reversed(self.lines) if line.kind is not None), None)
        self.lines.append(Line(at=at, text=text, kind=kind if kind is not last_kind else None))

    def is_answered_by(self, *kinds: EventKind) -> bool:
        return any(line.kind in kinds for line in self.lines)

    def close(self, result: str, tone: str, at: float) -> None:
        if not self.result:
            self.result, self.result_tone, self.ended = result, tone, at


def failures(chapters: Sequence[Chapter]) -> Iterator[Chapter]:
    return (chapter for chapter in chapters if chapter.number is not None)


def summary(chapters: Sequence[Chapter]) -> str:
    """The number of failures and how the system recovered, in one line."""
    failed_chapters = [*failures(chapters)]
    if not failed_chapters:
        setbacks = sum(line.kind is EventKind.SETBACK for chapter in chapters for line in chapter.lines)
        return count_text(setbacks, "setback") if setbacks else "no failures"
    answers = dict.fromkeys(ANSWERS[line.kind] for failure in failed_chapters for line in failure.lines if line.kind in ANSWERS)
    return count_text(len(failed_chapters), "failure") + (f"; recovery: {', '.join(answers)}" if answers else "")
