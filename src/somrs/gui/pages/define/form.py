"""The state of the page: the draft, its change callbacks, and its copy in the browser."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
from nicegui.element import Element

from somrs.api.remote import LiveApi
from somrs.gui.components.draft_storage import DraftStorage
from somrs.gui.examples import Examples, examples
from somrs.gui.pages.define.draft import Draft

_STORAGE_KEY = "somrs-define"
_KEY = "task"


class Form:
    """The panels of the page edit `draft` and call `changed`; each panel then shows the new draft."""

    def __init__(self, api: LiveApi, draft: Draft) -> None:
        self.api, self.draft = api, draft
        self._listeners: list[Callable[[], None]] = []
        self._is_submitted = False
        self._restored_goal = ""
        """The goal of a draft that the browser kept, until the user decides about it."""
        self._storage = DraftStorage(_STORAGE_KEY, self._restore, {_KEY: self._stored()})

    @property
    def examples(self) -> Examples:
        """Examples of formulas about objects on the map."""
        return examples(self.api.context.map, self.api.context.ontology)

    def on_change(self, refresh: Callable[[], None]) -> None:
        """Call `refresh` whenever the draft changes."""
        self._listeners.append(refresh)

    def changed(self) -> None:
        """Report a change of the draft to all panels."""
        if not self._is_submitted:
            self._storage.save(_KEY, self._stored())
        for refresh in self._listeners:
            refresh()

    def _stored(self) -> dict[str, Any]:
        return {"form": msgspec.to_builtins(self.draft)}

    @property
    def has_earlier_goal(self) -> bool:
        """Whether the goal is of an earlier visit, and the user has neither changed it nor decided to keep it."""
        return bool(self._restored_goal) and self.draft.effect == self._restored_goal

    def keep_earlier_goal(self) -> None:
        self._restored_goal = ""
        self.changed()

    def mirror(self, element: Element, path: str) -> None:
        """Store the element's input in the browser as it is typed, also while the server is away."""
        self._storage.mirror(element, "update:value", _KEY, path)

    def end(self) -> None:
        """Remove the stored draft: the task was submitted."""
        self._is_submitted = True
        self._storage.forget(_KEY)

    def clear(self) -> None:
        self.draft = Draft()
        self.changed()

    def _restore(self, stored_drafts: list[Any]) -> None:
        try:
            draft = msgspec.convert(stored_drafts[0].get("form"), Draft)
        except (msgspec.ValidationError, AttributeError):
            draft = None  # stored by another version of this page
        if draft is not None and (not self.draft.link or draft.link == self.draft.link):
            self._restored_goal = draft.effect if draft.effect != self.draft.effect else ""
            self.draft = draft
        self.changed()
