"""What is written on the page, who is told when it changes, and the browser that keeps it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
from nicegui.element import Element

from somrs.api.remote import LiveApi
from somrs.gui.components.draft_storage import Keeper
from somrs.gui.pages.define.draft import Draft

SHELF = "somrs-define"
KEY = "task"


class Form:
    """The rooms of the page change the `draft` and say so; each then shows what the others wrote."""

    def __init__(self, desk: LiveApi, draft: Draft) -> None:
        self.desk, self.draft = desk, draft
        self._showing: list[Callable[[], None]] = []
        self._over = False
        self._restored = False
        self._keeper = Keeper(SHELF, self._found)

    def on_change(self, show: Callable[[], None]) -> None:
        """Have a room show the draft whenever another one changed it."""
        self._showing.append(show)

    def changed(self) -> None:
        """The draft is another one."""
        if not self._over:
            self._keeper.keep(KEY, {"form": msgspec.to_builtins(self.draft)})
        for show in self._showing:
            show()

    def mirror(self, element: Element, path: str) -> None:
        """Keep what is typed into the element as it is typed, also while the server is away."""
        self._keeper.mirror(element, "update:value", KEY, path)

    def begin(self) -> None:
        """Once the page is in its browser: keep what it began with, unless something was kept already."""
        if not self._restored:
            self.changed()

    def end(self) -> None:
        """The task was stated: nothing is to be kept."""
        self._over = True
        self._keeper.forget(KEY)

    def clear(self) -> None:
        self.draft = Draft()
        self.changed()

    def _found(self, kept: list[Any]) -> None:
        try:
            draft = msgspec.convert(kept[0].get("form"), Draft)
        except (msgspec.ValidationError, AttributeError):
            return  # kept by another version of this page
        if not self.draft.link or draft.link == self.draft.link:
            self._restored = True
            self.draft = draft
            self.changed()
