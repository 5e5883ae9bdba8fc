"""The story of a task in chapters, and all its events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

from nicegui.element import Element

from somrs.gui.components import LIVE
from somrs.gui.components.task.waits import WaitText


class RecoveryLine(TypedDict):
    """One recovery action after a failure, as texts."""

    recovery: str
    text: str
    moment: str
    clock: str


class Part(TypedDict):
    """A chapter of the story, as texts."""

    icon: str
    title: str
    tone: str
    text: str
    waits: list[WaitText]
    left: str
    moment: str
    clock: str
    failure: bool
    lines: list[RecoveryLine]
    result: str
    result_tone: str
    result_icon: str
    took: str


class StoryBook(Element, component="story.js", dependencies=[LIVE]):
    """`show_chapters` sets the chapters. The element follows the task's events itself."""

    def __init__(self, task: str) -> None:
        super().__init__()
        self._props["task"] = task
        self._props["chapters"] = []

    def show_chapters(self, chapters: Sequence[Part]) -> None:
        if chapters != self._props["chapters"]:
            self._props["chapters"] = list(chapters)
