"""What is written on the page, who is told when it changes, and the browser that keeps it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
from nicegui.element import Element

from somrs.api.remote import LiveApi
from somrs.gui.components.draft_storage import DraftStorage
from somrs.gui.pages.define.draft import Draft

STORAGE_KEY = "somrs-define"
KEY = "task"


class Form:
    """The rooms of the page change the `draft` and say so; each then shows what the others wrote."""

    def __init__(self, api: LiveApi, draft: Draft) -> None:
        self.api, self.draft = api, draft
        self._listeners: list[Callable[[], None]] = []
        self._is_submitted = False
        self._restored = False
        self._storage = DraftStorage(STORAGE_KEY, self._restore)

    def on_change(self, refresh: Callable[[], None]) -> None:
        """Have a room show the draft whenever another one changed it."""
        self._listeners.append(refresh)

    def changed(self) -> None:
        """The draft is another one."""
        if not self._is_submitted:
            self._storage.save(KEY, {"form": msgspec.to_builtins(self.draft)})
        for refresh in self._listeners:
            refresh()

    def mirror(self, element: Element, path: str) -> None:
        """Keep what is typed into the element as it is typed, also while the server is away."""
        self._storage.mirror(element, "update:value", KEY, path)

    def begin(self) -> None:
        """Once the page is in its browser: keep what it began with, unless something was kept already."""
        if not self._restored:
            self.changed()

    def end(self) -> None:
        """The task was stated: nothing is to be kept."""
        self._is_submitted = True
        self._storage.forget(KEY)

    def clear(self) -> None:
        self.draft = Draft()
        self.changed()

    def _restore(self, stored_drafts: list[Any]) -> None:
        try:
            draft = msgspec.convert(stored_drafts[0].get("form"), Draft)
        except (msgspec.ValidationError, AttributeError):
            return  # kept by another version of this page
        if not self.draft.link or draft.link == self.draft.link:
            self._restored = True
            self.draft = draft
            self.changed()
