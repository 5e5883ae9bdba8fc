"""The parts of which the story of a task is made: its chapters and the lines in them. `task_story.py` makes them of events."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from somrs.gui.pages.task_text import count_text
from somrs.protocol.messages.events import EventKind

ANSWERS = {
    EventKind.HANDLER: "as laid down",
    EventKind.LOOK: "look",
    EventKind.REPLACE: "replace",
    EventKind.REPLAN: "plan anew",
    EventKind.UNDO: "undo",
}
"""The rungs of the ladder (docs/explanation/recovery.md), and what goes before them, in a sentence."""

LABELS = {
    EventKind.HANDLER: "As laid down",
    EventKind.LOOK: "Look",
    EventKind.REPLACE: "Rung 1: replace",
    EventKind.REPLAN: "Rung 2: plan anew",
    EventKind.UNDO: "Rung 3: undo",
    EventKind.SETBACK: "Setback",
    EventKind.WAIT: "Wait",
    EventKind.END: "End",
}
"""What kinds of events are called before a line; plain news need no name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Something that was done about a failure. `kind`: what kind of thing, in the first line of each kind."""

    at: float
    text: str
    kind: EventKind | None = None

    @property
    def rung(self) -> str:
        return LABELS.get(self.kind, "") if self.kind is not None else ""


@dataclass(slots=True, kw_only=True)
class Chapter:
    """A part of the story. `tone`: good, bad, busy or plain. Of a failure, `number` counts from 1, `service` is the one that failed,
    `silent` that it has only been silent so far, `situation` the situation that it left, `lines` what was done about it, and `result` what
    came of that. `unblocking`: what failures left is undone so that there may be a plan."""

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
    lines: list[Line] = field(default_factory=list)
    result: str = ""
    result_tone: str = "busy"
    ended: float | None = None

    def add(self, at: float, text: str, kind: EventKind | None = None) -> None:
        """A line. Its kind is said unless the lines before are of that kind."""
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
    """In a line: how much went wrong, and how that was answered."""
    failed_chapters = [*failures(chapters)]
    if not failed_chapters:
        setbacks = sum(line.kind is EventKind.SETBACK for chapter in chapters for line in chapter.lines)
        return count_text(setbacks, "setback") if setbacks else "no failures"
    answers = dict.fromkeys(ANSWERS[line.kind] for failure in failed_chapters for line in failure.lines if line.kind in ANSWERS)
    return count_text(len(failed_chapters), "failure") + (f", answered by: {', '.join(answers)}" if answers else "")
