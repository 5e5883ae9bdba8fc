"""The story of a task, made of its events: what was begun, each failure with what was done about it and what came of that, what was
undone, and the end. Its parts are in `task_chapters.py`, how it looks in `task_telling.py`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from somrs.client import state_labels
from somrs.client.task_report import reasons
from somrs.gui.pages.task_chapters import ANSWERS, LABELS, Chapter, Line
from somrs.gui.pages.task_words import counted, gist
from somrs.protocol.messages import events
from somrs.protocol.messages.clients import Phase, TaskEvent, TaskView
from somrs.protocol.messages.event_text import failure_text
from somrs.protocol.messages.events import Event, EventKind, kind_of
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.people import person_name

LOST = (State.FAILED, State.STOPPED, State.UNREACHABLE)

ENDINGS = {
    Outcome.ACCOMPLISHED: (state_labels.OUTCOMES[Outcome.ACCOMPLISHED], "good", "The task was accomplished all the same."),
    Outcome.FAILED: (state_labels.OUTCOMES[Outcome.FAILED], "bad", "Nothing helped: rung 4, the task was given up."),
    Outcome.CANCELLED: (state_labels.OUTCOMES[Outcome.CANCELLED], "plain", "The task was cancelled before anything came of it."),
}
"""For each outcome the title of the last chapter, its tone, and what came of failures that were not answered until then."""


class _Story:
    """Takes a task's events one by one. `told` in its methods is an event as it was noted, `event` what happened."""

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

    def take(self, told: TaskEvent, event: Event) -> None:
        match event:
            case events.WaitsForDevice():
                pass  # it is said of every second step, and means that devices are busy
            case events.WaitsForTasks():
                self._add(told, "hourglass_empty", "It waits", "busy", told.text)
            case events.GoesOn():
                self._add(told, "hourglass_empty", "It goes on", "busy", told.text)
            case events.TaskEnded(outcome=outcome, reasons=why):
                self.end(told, outcome, why)
            case events.Planned(steps=steps):
                self._planned(told, steps)
            case _ if kind_of(event) is EventKind.SETBACK:
                self._setback(told, event)
            case _ if kind_of(event) in ANSWERS:
                self._answer(told, event)
            case _:
                self._news(told, event)

    def take_text(self, told: Sequence[TaskEvent]) -> None:
        """Events of which a record has the sentences only."""
        chapter = self._add(told[0], "history", "What was kept of it", "plain")
        for event in told:
            chapter.lines.append(Line(at=event.at, text=_of_step(event), kind=event.kind if event.kind in LABELS else None))

    # Failures

    def _setback(self, told: TaskEvent, event: Event) -> None:
        if self._undoing is not None:
            self._undo(told)
            self._undoing.tone = "bad"
            return
        known = self._part_of(event)
        if known is not None:
            known.add(told.at, told.text)
            known.step = known.step or told.step
            known.left = known.left or self._left(told, event)
            return
        for earlier in [chapter for chapter in self._open if chapter.step == told.step and told.step is not None]:
            self._close(earlier, "It failed again.", "bad", told.at)
        self._open.append(self._failure(told, event))

    def _failure(self, told: TaskEvent, event: Event) -> Chapter:
        number = sum(chapter.number is not None for chapter in self.chapters) + 1
        if isinstance(event, events.ServiceFailure):
            chapter = self._add(told, "error", f"Failure {number}: {event.service}", "bad", failure_text(event))
            chapter.service, chapter.silent = event.service, isinstance(event, events.ServiceSilent)
        else:
            chapter = self._add(told, "error", f"Failure {number}", "bad", told.text)
        chapter.number, chapter.left = number, self._left(told, event)
        return chapter

    def _part_of(self, event: Event) -> Chapter | None:
        """The failure that the setback is part of: one more sign of it, or that what was tried about it did not help."""
        match event:
            case events.GoalFailed(step=step):
                return next((chapter for chapter in reversed(self._open) if chapter.step == step), None)
            case events.CompensationFailed() | events.WorkStranded() | events.ServiceOverdue(undoing=True):
                return self._open[-1] if self._open else None
            case _ if isinstance(event, events.ServiceFailure):
                return self._silence(event.service)
        return None

    def _silence(self, service: str) -> Chapter | None:
        """The failure that was only a silence of the service so far."""
        return next((chapter for chapter in self._open if chapter.silent and not chapter.step and chapter.service == service), None)

    def _left(self, told: TaskEvent, event: Event) -> str:
        """What the service that failed left, if it is known."""
        if not isinstance(event, events.ServiceFailure):
            return ""
        for work in reversed(self._view.work):
            is_lost = work.step == told.step and work.began <= told.at and (work.result or work.state) in LOST
            if is_lost and work.service == event.service:
                return gist(work.situation) if work.situation and work.state is not State.UNREACHABLE else ""
        return ""

    # What is done about them

    def _answer(self, told: TaskEvent, event: Event) -> None:
        kind = kind_of(event)
        self._plans_aside |= isinstance(event, events.HandlerBegun | events.UndoneByHandler | events.UndoneByOthers)
        if kind is EventKind.UNDO and not self._is_to_go_on(event):
            self._undo(told)
            return
        for chapter in self._answered(told, kind):
            text = gist(told.text) if told.step == chapter.step else _of_step(told)
            chapter.add(told.at, text, kind)
            chapter.unblocking |= isinstance(event, events.FailuresUndone)
            if kind in (EventKind.HANDLER, EventKind.LOOK):
                self._aside = chapter

    def _answered(self, told: TaskEvent, kind: EventKind) -> list[Chapter]:
        """The failures about which this is done; if there is none, a chapter for it."""
        about = [chapter for chapter in self._open if told.step is None or chapter.step == told.step]
        if not about and self._open and kind is EventKind.UNDO:
            about = self._open[-1:]  # what stands in the way may be of another step
        if not about:
            about = [self._add(told, "alt_route" if kind is EventKind.REPLAN else "sync", LABELS[kind], "busy")]
            self._open += about
        return about

    def _is_to_go_on(self, event: Event) -> bool:
        """Whether a failure is undone so that the task can go on, and not because it ends."""
        if self._undoing is not None:
            return False
        begun = any(chapter.unblocking for chapter in self._open)
        return isinstance(event, events.FailuresUndone) or (begun and not isinstance(event, events.UndoneByOthers))

    def _undo(self, told: TaskEvent) -> None:
        if self._undoing is None:
            self._undoing = self._add(told, "undo", "Undoing what was done", "busy")
        self._undoing.add(told.at, _of_step(told))

    def _close(self, chapter: Chapter, result: str, tone: str, at: float) -> None:
        chapter.close(result, tone, at)
        self._open.remove(chapter)

    # All else

    def _news(self, told: TaskEvent, event: Event) -> None:
        match event:
            case (
                events.TermsOffered(service=service)
                | events.ServiceRefused(service=service)
                | events.ProgressNoted(service=service)
                | events.StepCompleted(service=service)
                | events.StepStopped(service=service)
            ) if (silence := self._silence(service)) is not None:
                self._close(silence, "It was heard again.", "good", told.at)
        about = self._concerned(told)
        match event:
            case events.StepCompleted():
                self._completed(told, event, about)
            case events.FoundSo():
                for chapter in [chapter for chapter in self._open if chapter.step == told.step]:
                    self._close(chapter, "It was done after all.", "good", told.at)
            case events.StepStopped(service=service) if not about:
                self._add(told, "stop_circle", f"{service} stopped", "plain", told.step or "")
            case events.ServiceChosen() | events.MayTryAgain() | events.ServiceRefused() | events.StepStopped():
                for chapter in about:
                    chapter.add(told.at, told.text)

    def _concerned(self, told: TaskEvent) -> list[Chapter]:
        """The failures that are being answered, of which this news is."""
        about = [chapter for chapter in self._open if chapter.step == told.step and chapter.lines]
        return [self._aside] if not about and _is_aside(told) and self._aside is not None else about

    def _completed(self, told: TaskEvent, event: events.StepCompleted, about: Sequence[Chapter]) -> None:
        done = gist(event.situation)
        if _is_aside(told):
            if self._undoing is not None:
                self._undo(told)
                return
            if about:
                about[0].add(told.at, f"{event.service}: {done}")
        else:
            for chapter in [chapter for chapter in about if chapter in self._open]:
                self._close(chapter, f"{event.service} did it: {done}", "good", told.at)
        if not about:
            self._add(told, "check_circle", f"{told.step} is done", "good", f"by {event.service}: {done}")

    def _planned(self, told: TaskEvent, steps: int) -> None:
        if self._plans_aside:
            self._plans_aside = False
            return
        again = [chapter for chapter in self._open if chapter.is_answered_by(EventKind.REPLAN, EventKind.UNDO)]
        result = (
            f"The task goes on by a new plan of {counted(steps, 'step')}." if steps else "There is nothing left to do: it is so already."
        )
        for chapter in again:
            self._close(chapter, result, "good", told.at)
        if not again:
            self._add(told, "schema", _capital(told.text), "plain")

    def end(self, told: TaskEvent, outcome: Outcome | None, why: Sequence[str]) -> None:
        title, tone, result = ENDINGS[outcome] if outcome is not None else (state_labels.PHASES[Phase.ENDED], "plain", "")
        for chapter in [*self._open]:
            self._close(chapter, result, tone, told.at)
        last = self._add(told, "flag", title, tone)
        last.lines = [Line(at=told.at, text=gist(_capital(reason))) for reason in why]
        if self._undoing is not None and self._undoing.tone != "bad":
            self._undoing.tone = "plain"

    def _add(self, told: TaskEvent, icon: str, title: str, tone: str, text: str = "") -> Chapter:
        chapter = Chapter(at=told.at, icon=icon, title=title, tone=tone, text=text, step=told.step)
        self.chapters.append(chapter)
        return chapter


def story(view: TaskView, happened: Sequence[TaskEvent]) -> list[Chapter]:
    """The chapters in the order in which they began."""
    made = _Story(view)
    for is_text, group in groupby(happened[1:], lambda told: told.event is None and told.kind is not EventKind.END):
        if is_text:
            made.take_text([*group])
            continue
        for told in group:
            if told.event is not None:
                made.take(told, told.event)
            else:
                made.end(told, view.outcome, reasons(view))
    began = Chapter(at=view.submitted_at, icon="add_task", title=f"{person_name(view.client)} stated the task", text=view.effect)
    return [began, *made.chapters]


def _is_aside(told: TaskEvent) -> bool:
    """Whether it is of a step that is not of the task's own plan."""
    return told.goal not in (None, events.GoalKind.TASK)


def _of_step(told: TaskEvent) -> str:
    """The event with its step, and the gist of a situation in it."""
    return f"{told.step}: {gist(told.text)}" if told.step else gist(told.text)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
