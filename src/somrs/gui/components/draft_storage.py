"""Keeps what is written in forms in the browser's tab, so that it outlives the page and the server."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from nicegui.element import Element
from nicegui.events import GenericEventArguments


class DraftStorage(Element, component="draft_storage.js"):
    """`on_restore` gets what was kept on the `shelf` when the page was made: JSON objects with the form's values in `form`."""

    def __init__(self, storage_key: str, on_restore: Callable[[list[Any]], None]) -> None:
        super().__init__()
        self._props["shelf"] = storage_key

        def handle(event: GenericEventArguments) -> None:
            on_restore(event.args)

        self.on("found", handle)

    def save(self, key: str, draft: Any) -> None:
        self.run_method("keep", key, draft)

    def forget(self, key: str) -> None:
        self.run_method("forget", key)

    def mirror(self, element: Element, event: str, key: str, path: str, value: str = "value") -> None:
        """Keep what is written into the element as it is written; `value`: how to say it in JavaScript, of the event's `value`."""
        store_script = f"getElement({self.id})?.put({json.dumps(key)}, {json.dumps(path)}, {value})"
        element.on(event, js_handler=f"(value) => {store_script}")
