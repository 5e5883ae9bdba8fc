"""The head of a table."""

from __future__ import annotations

from collections.abc import Iterable

from nicegui import ui


def table_head(names: Iterable[str]) -> None:
    """Add the row with the names of the columns to a table."""
    with ui.element("thead"), ui.element("tr"):
        for name in names:
            with ui.element("th").props('scope="col"'):
                ui.label(name)
