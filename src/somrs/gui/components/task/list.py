"""The list of tasks as a table. Its rows stay the same elements while what is in them changes, so that whoever is about to click or press
a key meets what they aimed at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nicegui.element import Element


class TaskList(Element, component="list.js"):
    """`nothing`: what is said as long as there are no rows."""

    def __init__(self, columns: Sequence[dict[str, Any]], nothing: str) -> None:
        super().__init__()
        self._props["columns"] = list(columns)
        self._props["rows"] = []
        self._props["nothing"] = nothing

    def show(self, rows: Sequence[dict[str, Any]]) -> None:
        self._change("rows", list(rows))

    def say(self, nothing: str) -> None:
        self._change("nothing", nothing)

    def _change(self, key: str, value: object) -> None:
        if self._props[key] != value:
            self._props[key] = value
            self.update()
