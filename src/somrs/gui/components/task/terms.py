"""The services asked for each step of a task, their terms, and the result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

from nicegui.element import Element


class Bid(TypedDict):
    """A row of the table, as texts."""

    key: str
    step: str
    service: str
    chosen: bool
    icon: str
    tone: str
    word: str
    why: str
    price: str
    takes: str
    window: str
    valid: str


class TermsTable(Element, component="terms.js"):
    def __init__(self) -> None:
        super().__init__()
        self._props["rows"] = []

    def show_rows(self, rows: Sequence[Bid]) -> None:
        if rows != self._props["rows"]:
            self._props["rows"] = list(rows)
