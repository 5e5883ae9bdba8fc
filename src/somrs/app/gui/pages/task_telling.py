"""The story of a task on its page: chapters that are added as it goes on, each made anew only when it changed; and a list of all events."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from somrs.app.gui.pages.task_story import Chapter, story, summary
from somrs.app.gui.panel import Panel
from somrs.app.gui.signs import clock, lasted
from somrs.protocol.clients import EventKind, TaskEvent, TaskView

ICONS = {
    EventKind.NEWS: "chevron_right",
    EventKind.SETBACK: "error",
    EventKind.HANDLER: "rule",
    EventKind.REPLACE: "sync",
    EventKind.REPLAN: "alt_route",
    EventKind.WAIT: "hourglass_empty",
    EventKind.LOOK: "visibility",
    EventKind.UNDO: "undo",
    EventKind.END: "flag",
}
TONES = {"good": "check_circle", "bad": "cancel", "busy": "pending", "plain": "info"}

MOST = 400
"""Events that the list shows, the latest: all of them are in the record."""


class Telling:
    """In `panel`, beside whose title stands how much went wrong."""

    def __init__(self, panel: Panel) -> None:
        self._panel = panel
        self._shown: list[tuple[str, ui.element]] = []
        self._listed = 0
        with ui.tabs().props("dense no-caps align=left inline-label").classes("somrs-tabs") as tabs:
            told = ui.tab("Story", icon="auto_stories")
            self._tab = ui.tab("All events", icon="list")
        with ui.tab_panels(tabs, value=told).props("keep-alive").classes("somrs-tab-panels"):
            with ui.tab_panel(told):
                self._chapters = ui.element("ol").classes("somrs-story").props('aria-label="The story of the task"')
            with ui.tab_panel(self._tab):
                self._list = ui.element("ol").classes("somrs-events").props('aria-label="All events"')

    def show(self, view: TaskView, events: Sequence[TaskEvent]) -> None:
        chapters = story(view, events)
        self._panel.note.set_text(summary(chapters))
        told = [repr(chapter) for chapter in chapters]
        same = next(
            (index for index, (was, now) in enumerate(zip(self._shown, told, strict=False)) if was[0] != now),
            min(len(self._shown), len(told)),
        )
        for _, element in self._shown[same:]:
            element.delete()
        del self._shown[same:]
        with self._chapters:
            for chapter, words in zip(chapters[same:], told[same:], strict=True):
                self._shown.append((words, _chapter(chapter, view.submitted_at)))
        self._list_more(events, view.submitted_at)

    def _list_more(self, events: Sequence[TaskEvent], start: float) -> None:
        self._tab.props(f'label="All events ({len(events)})"')
        if len(events) < self._listed:
            self._list.clear()
            self._listed = 0
        with self._list:
            for event in events[max(self._listed, len(events) - MOST) :]:
                _event(event, start)
        self._listed = len(events)
        for old in [*self._list][:-MOST]:
            old.delete()


def _chapter(chapter: Chapter, start: float) -> ui.element:
    failure = chapter.number is not None
    with ui.element("li").classes(f"somrs-chapter somrs-tone-{chapter.tone}{' somrs-failure' if failure else ''}") as element:
        ui.icon(chapter.icon).classes("somrs-chapter-icon").props('aria-hidden="true"')
        with ui.element("div").classes("somrs-chapter-head"):
            ui.label(chapter.title).classes("somrs-chapter-title")
            _moment(chapter.at, start)
        if chapter.text:
            where = f"{chapter.step}: " if failure and chapter.step else ""
            ui.label(f"{where}{chapter.text}").classes("somrs-chapter-text")
        if chapter.left:
            with ui.element("div").classes("somrs-chapter-text"):
                ui.label("It left: ").classes("somrs-soft somrs-inline")
                ui.label(chapter.left).classes("somrs-formula somrs-inline")
        if chapter.lines:
            with ui.element("ul").classes("somrs-answers"):
                for line in chapter.lines:
                    with ui.element("li"):
                        if line.rung:
                            ui.label(line.rung).classes("somrs-rung")
                        ui.label(line.text)
                        if line.at != chapter.at or line.rung:
                            _moment(line.at, start)
        if failure:
            with ui.element("div").classes(f"somrs-result somrs-tone-{chapter.result_tone}"):
                ui.icon(TONES[chapter.result_tone]).props('aria-hidden="true"')
                ui.label(chapter.result or "Something is being done about it.")
                if chapter.ended is not None:
                    _moment(chapter.ended, start, since=chapter.at)
    return element


def _moment(at: float, start: float, since: float | None = None) -> None:
    text = f"+{lasted(at - start)}" if since is None else f"after {lasted(at - since)}"
    ui.label(text).classes("somrs-moment").props(f'title="{clock(at)}"')


def _event(event: TaskEvent, start: float) -> None:
    tone = {EventKind.SETBACK: "bad", EventKind.NEWS: "plain", EventKind.END: "plain"}.get(event.kind, "busy")
    with ui.element("li").classes(f"somrs-event somrs-tone-{tone}"):
        _moment(event.at, start)
        ui.icon(ICONS[event.kind]).props(f'title="{event.kind.value}" aria-label="{event.kind.value}"')
        ui.label(f"{event.step}: {event.text}" if event.step else event.text)
