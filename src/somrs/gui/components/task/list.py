"""The list of tasks as a table. Updates keep the row elements, so that focus and clicks stay on the intended row."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from nicegui.element import Element


class TaskList(Element, component="list.js"):
    """`empty_text`: shown while there are no rows. `on_retry`: called with the id of an ended task that the user retries, and a key that is
    the same for all clicks on its button."""

    def __init__(self, columns: Sequence[dict[str, Any]], empty_text: str, on_retry: Callable[[str, str], Awaitable[object]]) -> None:
        super().__init__()
        self.on("retry", lambda event: on_retry(str(event.args["task"]), str(event.args["once"])))
        self._props["columns"] = list(columns)
        self._props["rows"] = []
        self._props["nothing"] = empty_text

    def show_rows(self, rows: Sequence[dict[str, Any]]) -> None:
        self._set_prop("rows", list(rows))

    def set_empty_text(self, empty_text: str) -> None:
        self._set_prop("nothing", empty_text)

    def _set_prop(self, key: str, value: object) -> None:
        if self._props[key] != value:
            self._props[key] = value
            self.update()
