"""Unsaved edits of objects, kept also in the browser so that they survive reloads and server restarts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
from nicegui.element import Element

from somrs.gui.components.draft_storage import DraftStorage
from somrs.gui.pages.map.fields import Raw
from somrs.ontology.types import Value

PATH_SEPARATOR = "/"
"""Separates the names of an attribute's path in the browser's storage, where a dot has another meaning."""


class ObjectDraft(msgspec.Struct, frozen=True, kw_only=True):
    """Edits of an object by path (`form`, as the browser keeps it), and the map's values when editing began (`map_values`)."""

    name: str
    form: dict[str, Raw] = {}
    map_values: dict[str, Value] = msgspec.field(default_factory=dict, name="known")

    def typed(self) -> dict[str, Raw]:
        return {key.replace(PATH_SEPARATOR, "."): raw for key, raw in self.form.items()}


class ObjectDrafts:
    """`on_restored` is called with the objects that have stored edits after the page was reloaded."""

    def __init__(self, on_restored: Callable[[list[str]], None]) -> None:
        self._on_restored = on_restored
        self._drafts: dict[str, ObjectDraft] = {}
        self._storage = DraftStorage("somrs-map", self._restore)

    def _restore(self, stored_drafts: list[Any]) -> None:
        for stored_draft in stored_drafts:
            draft = msgspec.convert(stored_draft, ObjectDraft)
            if draft.form and not self.draft_of(draft.name).form:
                self._drafts[draft.name] = draft
            elif not draft.form and draft.name not in self._drafts:
                self._storage.forget(draft.name)
        if names := self.names():
            self._on_restored(names)

    def names(self) -> list[str]:
        """The objects with unsaved edits."""
        return [name for name, draft in self._drafts.items() if draft.form]

    def draft_of(self, name: str) -> ObjectDraft:
        return self._drafts.get(name) or ObjectDraft(name=name)

    def save(self, name: str, typed: dict[str, Raw], map_values: dict[str, Value]) -> None:
        """Store the edits of an object."""
        form = {path.replace(".", PATH_SEPARATOR): raw for path, raw in typed.items()}
        self._drafts[name] = ObjectDraft(name=name, form=form, map_values=map_values)
        self._storage.save(name, msgspec.to_builtins(self._drafts[name]))

    def forget(self, name: str) -> None:
        """Drop the entry of a closed form if it has no edits."""
        if not self.draft_of(name).form:
            self._drafts.pop(name, None)
            self._storage.forget(name)

    def mirror(self, name: str, element: Element, path: str) -> None:
        """Store each keystroke of a field, also while the server is away."""
        self._storage.mirror(element, "update:model-value", name, path.replace(".", PATH_SEPARATOR))
