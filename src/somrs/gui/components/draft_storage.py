"""Form drafts kept in the browser tab, so that they survive a reload of the page and a restart of the server."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from nicegui.element import Element
from nicegui.events import GenericEventArguments


class DraftStorage(Element, component="draft_storage.js"):
    """An invisible element that stores drafts: JSON objects whose `form` holds the values. The `initial` ones are stored first, by key,
    where the browser has none yet. After the page has loaded, `on_restore` receives the others under `storage_key`."""

    def __init__(self, storage_key: str, on_restore: Callable[[list[Any]], None], initial: Mapping[str, Any] | None = None) -> None:
        super().__init__()
        self._props["shelf"], self._props["initial"] = storage_key, initial

        def handle(event: GenericEventArguments) -> None:
            try:
                on_restore(event.args)
            finally:
                self.run_method("restored")

        self.on("found", handle)

    def save(self, key: str, draft: Any) -> None:
        self.run_method("keep", key, draft)

    def forget(self, key: str) -> None:
        self.run_method("forget", key)

    def mirror(self, element: Element, event: str, key: str, path: str, value: str = "value") -> None:
        """Store the element's value on each `event`. `value`: the JavaScript expression that yields it from the event's `value`."""
        store_script = f"getElement({self.id})?.put({json.dumps(key)}, {json.dumps(path)}, {value})"
        element.on(event, js_handler=f"(value) => {store_script}")
