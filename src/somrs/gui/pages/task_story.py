"""The story of a task, made from its events: plans, each failure with the recovery actions and their result, compensation, and the end. The
parts are defined in `task_chapters.py` and shown by `task_story_panel.py`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from somrs.client import state_labels
from somrs.client.task_report import reasons
from somrs.gui.pages.task_chapters import ANSWERS, LABELS, Chapter, Line
from somrs.gui.pages.task_text import count_text, gist
from somrs.protocol.messages import events, goal_kinds, waits
from somrs.protocol.messages.event_kinds import EventKind, kind_of
from somrs.protocol.messages.event_text import failure_text
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.people import person_name
from somrs.protocol.messages.task_views import Phase, TaskEvent, TaskView

_LOST = (State.FAILED, State.STOPPED, State.UNREACHABLE)

ENDINGS = {
    Outcome.ACCOMPLISHED: (state_labels.OUTCOMES[Outcome.ACCOMPLISHED], "good", "The task was accomplished nevertheless."),
    Outcome.FAILED: (state_labels.OUTCOMES[Outcome.FAILED], "bad", "Recovery failed: the task was given up."),
    Outcome.CANCELLED: (state_labels.OUTCOMES[Outcome.CANCELLED], "plain", "The task was cancelled before recovery was complete."),
}
"""For each outcome: the title of the last chapter, its tone, and the result of failures that are still open then."""


class _StoryBuilder:
    """Processes a task's events one by one. In its methods, `entry` is an event of the log and `event` its data."""

    def __init__(self, view: TaskView) -> None:
        self._view = view
        self.chapters: list[Chapter] = []
        self._open: list[Chapter] = []
        """Failures without a result so far."""
        self._undoing: Chapter | None = None
        """The chapter for what is undone because the task ends."""
        self._aside: Chapter | None = None
        """The failure for which an additional goal is executed: an observation or a handler."""
        self._plans_aside = False
        """Whether the next plan is for that or for compensation, and not for the task's goal."""

    def add_event(self, entry: TaskEvent, event: Event) -> None:
        match event:
            case waits.WaitsForDevice():
                pass  # ordinary: devices are often busy
            case waits.WaitsForTasks():
                self._add_chapter(entry, "hourglass_empty", "Waiting", "busy").waiting_for = event
            case waits.WaitsForRepository():
                self._add_chapter(entry, "hourglass_empty", "Waiting", "busy", entry.text)
            case waits.GoesOn() | waits.RepositoryAnswered():
                self._add_chapter(entry, "hourglass_empty", "Continuing", "busy", entry.text)
            case events.TaskEnded(outcome=outcome, reasons=end_reasons):
                self.end(entry, outcome, end_reasons)
            case events.Planned(steps=steps):
                self._add_plan(entry, steps)
            case _ if kind_of(event) is EventKind.SETBACK:
                self._add_setback(entry, event)
            case _ if kind_of(event) in ANSWERS:
                self._add_answer(entry, event)
            case _:
                self._add_news(entry, event)

    def add_text_entries(self, entries: Sequence[TaskEvent]) -> None:
        """Add events of which a record has only the texts."""
        chapter = self._add_chapter(entries[0], "history", "Recorded events", "plain")
        for event in entries:
            chapter.lines.append(Line(at=event.at, text=_of_step(event), kind=event.kind if event.kind in LABELS else None))

    # Failures

    def _add_setback(self, entry: TaskEvent, event: Event) -> None:
        if self._undoing is not None:
            self._add_undoing(entry)
            self._undoing.tone = "bad"
            return
        known_failure = self._related_failure(event)
        if known_failure is not None:
            known_failure.add(entry.at, entry.text)
            known_failure.step = known_failure.step or entry.step
            known_failure.situation = known_failure.situation or self._situation_left(entry, event)
            return
        for earlier in [chapter for chapter in self._open if chapter.step == entry.step and entry.step is not None]:
            self._close(earlier, "The step failed again.", "bad", entry.at)
        self._open.append(self._add_failure(entry, event))

    def _add_failure(self, entry: TaskEvent, event: Event) -> Chapter:
        number = sum(chapter.number is not None for chapter in self.chapters) + 1
        if isinstance(event, events.ServiceFailure):
            chapter = self._add_chapter(entry, "error", f"Failure {number}: {event.service}", "bad", failure_text(event))
            chapter.service, chapter.silent = event.service, isinstance(event, events.ServiceSilent)
        else:
            chapter = self._add_chapter(entry, "error", f"Failure {number}", "bad", entry.text)
        chapter.number, chapter.situation = number, self._situation_left(entry, event)
        return chapter

    def _related_failure(self, event: Event) -> Chapter | None:
        """The earlier failure that this setback belongs to: the same failure observed again, or a recovery action for it that failed."""
        match event:
            case events.GoalFailed(step=step):
                return next((chapter for chapter in reversed(self._open) if chapter.step == step), None)
            case events.CompensationFailed() | events.WorkStranded() | events.ServiceOverdue(undoing=True):
                return self._open[-1] if self._open else None
            case _ if isinstance(event, events.ServiceFailure):
                return self._silent_failure(event.service)
        return None

    def _silent_failure(self, service: str) -> Chapter | None:
        """The open failure in which the service has only stopped responding."""
        return next((chapter for chapter in self._open if chapter.silent and not chapter.step and chapter.service == service), None)

    def _situation_left(self, entry: TaskEvent, event: Event) -> str:
        """The situation that the failed service left; empty if it is unknown."""
        if not isinstance(event, events.ServiceFailure):
            return ""
        for work in reversed(self._view.work):
            is_lost = work.step == entry.step and work.began <= entry.at and (work.result or work.state) in _LOST
            if is_lost and work.service == event.service:
                return gist(work.situation) if work.situation and work.state is not State.UNREACHABLE else ""
        return ""

    # Recovery actions

    def _add_answer(self, entry: TaskEvent, event: Event) -> None:
        kind = kind_of(event)
        self._plans_aside |= isinstance(event, events.HandlerBegun | events.UndoneByHandler | events.UndoneByOthers)
        if kind is EventKind.UNDO and not self._is_unblocking(event):
            self._add_undoing(entry)
            return
        for chapter in self._answered_failures(entry, kind):
            text = gist(entry.text) if entry.step == chapter.step else _of_step(entry)
            chapter.add(entry.at, text, kind)
            chapter.unblocking |= isinstance(event, events.FailuresUndone)
            if kind in (EventKind.HANDLER, EventKind.LOOK):
                self._aside = chapter

    def _answered_failures(self, entry: TaskEvent, kind: EventKind) -> list[Chapter]:
        """The failures for which this action is taken; if there are none, a new chapter for it."""
        chapters = [chapter for chapter in self._open if entry.step is None or chapter.step == entry.step]
        if not chapters and self._open and kind is EventKind.UNDO:
            chapters = self._open[-1:]  # the obstacle may be the work of another step
        if not chapters:
            chapters = [self._add_chapter(entry, "alt_route" if kind is EventKind.REPLAN else "sync", LABELS[kind], "busy")]
            self._open += chapters
        return chapters

    def _is_unblocking(self, event: Event) -> bool:
        """Whether work is undone so that the task can continue, not because it ends."""
        if self._undoing is not None:
            return False
        is_unblocking = any(chapter.unblocking for chapter in self._open)
        return isinstance(event, events.FailuresUndone) or (is_unblocking and not isinstance(event, events.UndoneByOthers))

    def _add_undoing(self, entry: TaskEvent) -> None:
        if self._undoing is None:
            self._undoing = self._add_chapter(entry, "undo", "Compensation", "busy")
        self._undoing.add(entry.at, _of_step(entry))

    def _close(self, chapter: Chapter, result: str, tone: str, at: float) -> None:
        chapter.close(result, tone, at)
        self._open.remove(chapter)

    # Other events

    def _add_news(self, entry: TaskEvent, event: Event) -> None:
        match event:
            case (
                events.TermsOffered(service=service)
                | events.ServiceRefused(service=service)
                | events.ProgressNoted(service=service)
                | events.StepCompleted(service=service)
                | events.StepStopped(service=service)
            ) if (silent_failure := self._silent_failure(service)) is not None:
                self._close(silent_failure, "The service responded again.", "good", entry.at)
        chapters = self._concerned_failures(entry)
        match event:
            case events.StepCompleted():
                self._add_completion(entry, event, chapters)
            case events.FoundSo():
                for chapter in [chapter for chapter in self._open if chapter.step == entry.step]:
                    self._close(chapter, "The step was completed after all.", "good", entry.at)
            case events.StepStopped(service=service) if not chapters:
                self._add_chapter(entry, "stop_circle", f"{service} stopped", "plain", entry.step or "")
            case events.PlansCompared():
                self._add_chapter(entry, "compare_arrows", "Compared plans", "plain", entry.text)
            case events.ServiceChosen() | events.MayTryAgain() | events.ServiceRefused() | events.StepStopped():
                for chapter in chapters:
                    chapter.add(entry.at, entry.text)

    def _concerned_failures(self, entry: TaskEvent) -> list[Chapter]:
        """The failures under recovery that this event belongs to."""
        chapters = [chapter for chapter in self._open if chapter.step == entry.step and chapter.lines]
        return [self._aside] if not chapters and _is_aside(entry) and self._aside is not None else chapters

    def _add_completion(self, entry: TaskEvent, event: events.StepCompleted, chapters: Sequence[Chapter]) -> None:
        situation = gist(event.situation)
        if _is_aside(entry):
            if self._undoing is not None:
                self._add_undoing(entry)
                return
            if chapters:
                chapters[0].add(entry.at, f"{event.service}: {situation}")
        else:
            for chapter in [chapter for chapter in chapters if chapter in self._open]:
                self._close(chapter, f"{event.service} completed the step: {situation}", "good", entry.at)
        if not chapters:
            self._add_chapter(entry, "check_circle", f"{entry.step} is done", "good", f"by {event.service}: {situation}")

    def _add_plan(self, entry: TaskEvent, steps: int) -> None:
        if self._plans_aside:
            self._plans_aside = False
            return
        replanned_chapters = [chapter for chapter in self._open if chapter.is_answered_by(EventKind.REPLAN, EventKind.UNDO)]
        result = f"The task continues with a plan of {count_text(steps, 'step')}." if steps else "Nothing is left to do: the goal holds."
        for chapter in replanned_chapters:
            self._close(chapter, result, "good", entry.at)
        if not replanned_chapters:
            self._add_chapter(entry, "schema", _capital(entry.text), "plain")

    def end(self, entry: TaskEvent, outcome: Outcome | None, end_reasons: Sequence[str]) -> None:
        title, tone, result = ENDINGS[outcome] if outcome is not None else (state_labels.PHASES[Phase.ENDED], "plain", "")
        for chapter in [*self._open]:
            self._close(chapter, result, tone, entry.at)
        last_chapter = self._add_chapter(entry, "flag", title, tone)
        last_chapter.lines = [Line(at=entry.at, text=gist(_capital(reason))) for reason in end_reasons]
        if self._undoing is not None and self._undoing.tone != "bad":
            self._undoing.tone = "plain"

    def _add_chapter(self, entry: TaskEvent, icon: str, title: str, tone: str, text: str = "") -> Chapter:
        chapter = Chapter(at=entry.at, icon=icon, title=title, tone=tone, text=text, step=entry.step)
        self.chapters.append(chapter)
        return chapter


def story(view: TaskView, entries: Sequence[TaskEvent]) -> list[Chapter]:
    """The chapters of a task's story, in order of their beginning."""
    builder = _StoryBuilder(view)
    for is_text, group in groupby(entries[1:], lambda entry: entry.event is None and entry.kind is not EventKind.END):
        if is_text:
            builder.add_text_entries([*group])
            continue
        for entry in group:
            if entry.event is not None:
                builder.add_event(entry, entry.event)
            else:
                builder.end(entry, view.outcome, reasons(view))
    first_chapter = Chapter(at=view.submitted_at, icon="add_task", title=f"{person_name(view.client)} submitted the task", text=view.effect)
    return [first_chapter, *builder.chapters]


def _is_aside(entry: TaskEvent) -> bool:
    """Whether the event belongs to a goal other than the task's own."""
    return entry.goal not in (None, goal_kinds.GoalKind.TASK)


def _of_step(entry: TaskEvent) -> str:
    """The event's text with its step, and situations shortened."""
    return f"{entry.step}: {gist(entry.text)}" if entry.step else gist(entry.text)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
