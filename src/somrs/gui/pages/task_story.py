"""The story of a task, told from its events: what was begun, each failure with what was done about it and what came of that, what was
undone, and the end. How it looks is `task_telling.py`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from somrs.gui.pages.task_words import counted, gist
from somrs.protocol.messages.clients import TaskEvent, TaskView
from somrs.protocol.messages.events import EventKind
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.people import person

RUNGS = {
    EventKind.HANDLER: "As laid down",
    EventKind.LOOK: "Look",
    EventKind.REPLACE: "Rung 1: replace",
    EventKind.REPLAN: "Rung 2: plan anew",
    EventKind.UNDO: "Rung 3: undo",
}
"""What the rungs of the ladder are called (docs/recovery.md), and what goes before them."""

LOST = (State.FAILED, State.STOPPED, State.UNREACHABLE)
OTHERS = "others are to restore"
PURSUED = (OTHERS, "undoing it by what was laid down")
"""How undoing is told of for which there is a plan."""
BLOCKED = "undoing what failed"
UNDOING = re.compile("could not undo it|could not be undone|is not undone")
TURN = "waiting for its turn"
SILENT = "is silent; asking for its state"


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Something that was done about a failure. `rung`: its name, for the first line of each."""

    at: float
    text: str
    rung: str = ""


@dataclass(slots=True, kw_only=True)
class Chapter:
    """A part of the story. `tone`: good, bad, busy or plain. Of a failure, `number` counts from 1, `left` is the situation that it left,
    `lines` are what was done about it, and `result` what came of that."""

    at: float
    icon: str
    title: str
    tone: str = "plain"
    text: str = ""
    step: str | None = None
    number: int | None = None
    left: str = ""
    lines: list[Line] = field(default_factory=list)
    result: str = ""
    result_tone: str = "busy"
    ended: float | None = None

    def close(self, result: str, tone: str, at: float) -> None:
        if not self.result:
            self.result, self.result_tone, self.ended = result, tone, at


class _Teller:
    def __init__(self, view: TaskView) -> None:
        self._view = view
        self.chapters: list[Chapter] = []
        self._open: list[Chapter] = []
        """Failures of which nothing came yet."""
        self._undoing: Chapter | None = None
        """What is undone because the task ends."""
        self._aside: Chapter | None = None
        """The failure for which something beside the plan is pursued: a look, or what was laid down."""
        self._plans_aside = False
        """The next plan is for that, or for undoing, and not the task's."""

    def hear(self, event: TaskEvent) -> None:
        match event.kind:
            case EventKind.SETBACK:
                self._setback(event)
            case EventKind.HANDLER | EventKind.LOOK | EventKind.REPLACE | EventKind.REPLAN | EventKind.UNDO:
                self._answer(event)
            case EventKind.WAIT if event.text.startswith(TURN):
                pass  # it is said of every second step, and means that devices are busy
            case EventKind.WAIT:
                waits = event.text.startswith("waiting")
                self._add(event, "hourglass_empty", "It waits" if waits else "It goes on", "busy", event.text)
            case EventKind.END:
                self._end(event)
            case EventKind.NEWS:
                self._news(event)

    # Failures

    def _setback(self, event: TaskEvent) -> None:
        if self._undoing is not None:
            self._undo(event)
            self._undoing.tone = "bad"
            return
        failure = self._concerned(event)
        if failure is not None:
            failure.lines.append(Line(at=event.at, text=event.text))
            failure.step = failure.step or event.step
            failure.left = failure.left or self._left(event)
            return
        for earlier in [one for one in self._open if one.step == event.step and event.step is not None]:
            self._close(earlier, "It failed again.", "bad", event.at)
        number = sum(one.number is not None for one in self.chapters) + 1
        service, _, told = event.text.partition(" ")
        title, text = (f"Failure {number}: {service}", told) if "." in service else (f"Failure {number}", event.text)
        made = self._add(event, "error", title, "bad", text)
        made.number, made.left = number, self._left(event)
        self._open.append(made)

    def _concerned(self, event: TaskEvent) -> Chapter | None:
        """The failure that the setback is part of: one more sign of it, or that what was tried about it did not help."""
        if (named := re.match(r"(?:look|handler|undo) for (\S+):", event.text)) is not None:
            return next((one for one in reversed(self._open) if one.step == named[1]), None)
        if UNDOING.search(event.text) is not None:
            return self._open[-1] if self._open else None
        return self._silent(event)

    def _silent(self, event: TaskEvent) -> Chapter | None:
        """The failure that was only a silence so far, of the service of which the event tells."""
        service = event.text.partition(" ")[0]
        return next((one for one in self._open if one.text == SILENT and not one.step and one.title.endswith(f" {service}")), None)

    def _left(self, event: TaskEvent) -> str:
        works = [
            work for work in self._view.work if work.step == event.step and work.began <= event.at and (work.result or work.state) in LOST
        ]
        work = next((work for work in reversed(works) if event.text.startswith(work.service)), None)
        return gist(work.situation) if work is not None and work.situation and work.state is not State.UNREACHABLE else ""

    def _answer(self, event: TaskEvent) -> None:
        self._plans_aside = self._plans_aside or event.kind is EventKind.HANDLER or event.text.startswith(PURSUED)
        if event.kind is EventKind.UNDO and not self._to_go_on(event):
            self._undo(event)
            return
        about = [one for one in self._open if event.step is None or one.step == event.step]
        if not about and self._open and event.kind is EventKind.UNDO:
            about = self._open[-1:]  # what stands in the way may be of another step
        if not about:
            about = [self._add(event, "alt_route" if event.kind is EventKind.REPLAN else "sync", _capital(RUNGS[event.kind]), "busy")]
            about[0].step = event.step
            self._open += about
        for failure in about:
            rung = RUNGS[event.kind]
            last = next((line.rung for line in reversed(failure.lines) if line.rung), "")
            said = "" if last == rung else rung
            failure.lines.append(Line(at=event.at, text=_said(event).removeprefix(f"{failure.step}: "), rung=said))
            if event.kind in (EventKind.HANDLER, EventKind.LOOK):
                self._aside = failure

    def _to_go_on(self, event: TaskEvent) -> bool:
        """Whether a failure is undone so that the task can go on, and not because it ends."""
        begun = any(BLOCKED in line.text for one in self._open for line in one.lines)
        return self._undoing is None and (BLOCKED in event.text or (begun and not event.text.startswith(OTHERS)))

    def _undo(self, event: TaskEvent) -> None:
        if self._undoing is None:
            self._undoing = self._add(event, "undo", "Undoing what was done", "busy")
        self._undoing.lines.append(Line(at=event.at, text=_said(event)))

    def _close(self, failure: Chapter, result: str, tone: str, at: float) -> None:
        failure.close(result, tone, at)
        self._open.remove(failure)

    # All else

    def _news(self, event: TaskEvent) -> None:
        if event.text.startswith(("planned: ", "nothing to do")):
            self._planned(event)
            return
        beside = event.step is not None and "." in event.step
        about = [one for one in self._open if one.step == event.step and one.lines]
        if beside and not about and self._aside is not None:
            about = [self._aside]
        service, _, rest = event.text.partition(" ")
        if (silent := self._silent(event)) is not None:
            self._close(silent, "It was heard again.", "good", event.at)
        if rest.startswith("does it for"):
            for failure in about:
                failure.lines.append(Line(at=event.at, text=event.text))
        elif rest.startswith("completed: ") and beside and self._undoing is not None:
            self._undo(event)
        elif rest.startswith("completed: "):
            done = gist(rest.removeprefix("completed: "))
            if not beside:
                for failure in [one for one in about if one in self._open]:
                    self._close(failure, f"{service} did it: {done}", "good", event.at)
            elif about:
                about[0].lines.append(Line(at=event.at, text=f"{service}: {done}"))
            if not about:
                self._add(event, "check_circle", f"{event.step} is done", "good", f"by {service}: {done}")
        elif event.text == "what it was to bring about is so":
            for failure in [one for one in self._open if one.step == event.step]:
                self._close(failure, "It was done after all.", "good", event.at)
        elif event.text.startswith(("there is no plan without", "nobody else can do it")) or rest.startswith(("refuses", "stopped")):
            for failure in about:
                failure.lines.append(Line(at=event.at, text=event.text))
            if not about and rest.startswith("stopped"):
                self._add(event, "stop_circle", f"{service} stopped", "plain", event.step or "")

    def _planned(self, event: TaskEvent) -> None:
        if self._plans_aside:
            self._plans_aside = False
            return
        again = [one for one in self._open if any(line.rung in (RUNGS[EventKind.REPLAN], RUNGS[EventKind.UNDO]) for line in one.lines)]
        steps = event.text.removeprefix("planned: ")
        for failure in again:
            result = (
                "The task goes on by a new plan" if event.text.startswith("planned") else "There is nothing left to do: it is so already"
            )
            self._close(failure, f"{result}{f' of {steps}' if steps != event.text else ''}.", "good", event.at)
        if not again:
            self._add(event, "schema", _capital(event.text), "plain")

    def _end(self, event: TaskEvent) -> None:
        outcome = self._view.outcome
        result, tone = {
            Outcome.ACCOMPLISHED: ("The task was accomplished all the same.", "good"),
            Outcome.FAILED: ("Nothing helped: rung 4, the task was given up.", "bad"),
            Outcome.CANCELLED: ("The task was cancelled before anything came of it.", "plain"),
        }.get(outcome or Outcome.ACCOMPLISHED, ("", "plain"))
        for failure in [*self._open]:
            self._close(failure, result, tone, event.at)
        icon, title, tone = {
            Outcome.ACCOMPLISHED: ("flag", "Accomplished", "good"),
            Outcome.FAILED: ("flag", "Failed", "bad"),
            Outcome.CANCELLED: ("flag", "Cancelled", "plain"),
        }.get(outcome or Outcome.ACCOMPLISHED, ("flag", "Over", "plain"))
        made = self._add(event, icon, title, tone)
        _, _, why = event.text.partition(": ")
        made.lines = [Line(at=event.at, text=gist(_capital(reason))) for reason in why.split("; ") if reason]
        if self._undoing is not None and self._undoing.tone != "bad":
            self._undoing.tone = "plain"

    def _add(self, event: TaskEvent, icon: str, title: str, tone: str, text: str = "") -> Chapter:
        made = Chapter(at=event.at, icon=icon, title=title, tone=tone, text=text, step=event.step)
        self.chapters.append(made)
        return made


def story(view: TaskView, events: Sequence[TaskEvent]) -> list[Chapter]:
    """The chapters in the order in which they began."""
    teller = _Teller(view)
    for event in events[1:]:
        teller.hear(event)
    began = Chapter(at=view.submitted_at, icon="add_task", title=f"{person(view.client)} stated the task", text=view.effect)
    return [began, *teller.chapters]


def failures(chapters: Sequence[Chapter]) -> Iterator[Chapter]:
    return (one for one in chapters if one.number is not None)


def summary(chapters: Sequence[Chapter]) -> str:
    """In a line: how much went wrong, and how that was answered."""
    found = [*failures(chapters)]
    if not found:
        return "no failures"
    rungs = dict.fromkeys(line.rung.partition(": ")[2] or line.rung.lower() for one in found for line in one.lines if line.rung)
    return counted(len(found), "failure") + (f", answered by: {', '.join(rungs)}" if rungs else "")


def _said(event: TaskEvent) -> str:
    """What an event says, with the gist of a situation in it."""
    return f"{event.step}: {gist(event.text)}" if event.step else gist(event.text)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
