"""The story of a task as a panel of its page."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.client.durations import format_duration
from somrs.gui.components.task.story import Part, RecoveryLine, StoryBook
from somrs.gui.icons import format_time
from somrs.gui.pages.task_chapters import Chapter, summary
from somrs.gui.pages.task_story import story
from somrs.gui.pages.task_text import wait_texts
from somrs.gui.panel import Panel
from somrs.protocol.messages.task_views import TaskEvent, TaskView

_TONES = {"good": "check_circle", "bad": "cancel", "busy": "pending", "plain": "info"}


class StoryPanel:
    """Contents of `panel`; the panel's note shows the number of failures."""

    def __init__(self, panel: Panel, task: str) -> None:
        self._panel = panel
        self._book = StoryBook(task)

    def render(self, view: TaskView, events: Sequence[TaskEvent]) -> None:
        chapters = story(view, events)
        self._panel.note.set_text(summary(chapters))
        self._book.show_chapters([_part(chapter, view.submitted_at) for chapter in chapters])


def _part(chapter: Chapter, start: float) -> Part:
    failure = chapter.number is not None
    return Part(
        icon=chapter.icon,
        title=chapter.title,
        tone=chapter.tone,
        text=f"{chapter.step}: {chapter.text}" if failure and chapter.step else chapter.text,
        waits=wait_texts(chapter.waiting_for),
        left=chapter.situation,
        moment=f"+{format_duration(chapter.at - start)}",
        clock=format_time(chapter.at),
        failure=failure,
        lines=[
            RecoveryLine(
                recovery=line.recovery,
                text=line.text,
                moment=f"+{format_duration(line.at - start)}" if line.recovery or line.at != chapter.at else "",
                clock=format_time(line.at),
            )
            for line in chapter.lines
        ],
        result=chapter.result or "Recovery is under way.",
        result_tone=chapter.result_tone,
        result_icon=_TONES[chapter.result_tone],
        took=f"after {format_duration(chapter.ended - chapter.at)}" if chapter.ended is not None else "",
    )
