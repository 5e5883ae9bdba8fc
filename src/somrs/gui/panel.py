"""A collapsible part of a page with a title; its state is kept in the browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from nicegui import app, ui
from nicegui.events import GenericEventArguments

FOLDED = "folded"
"""Key in the browser's settings: the panels that are collapsed."""


@dataclass(frozen=True, slots=True)
class Panel:
    """`note` is shown beside the title, also when the panel is collapsed."""

    element: ui.element
    note: ui.label


@contextmanager
def panel(title: str, icon: str, key: str, classes: str = "") -> Iterator[Panel]:
    """Add a panel; the elements made inside are its content. `key` identifies the panel in the browser's settings."""
    folded = key in app.storage.user.get(FOLDED, ())
    with ui.element("details").classes(f"somrs-sheet somrs-panel {classes}").props("" if folded else "open") as element:
        with ui.element("summary").classes("somrs-panel-head"):
            ui.icon(icon).props('aria-hidden="true"')
            ui.label(title).props('role="heading" aria-level="2"').classes("somrs-panel-title")
            note = ui.label().classes("somrs-panel-note")
            ui.icon("expand_more").classes("somrs-panel-turn").props('aria-hidden="true"')
        with ui.element("div").classes("somrs-panel-body"):
            yield Panel(element, note)

    def save_folded(event: GenericEventArguments) -> None:
        folded_keys = [folded_key for folded_key in app.storage.user.get(FOLDED, ()) if folded_key != key]
        app.storage.user[FOLDED] = folded_keys if event.args else [*folded_keys, key]

    element.on("toggle", save_folded, js_handler="(event) => emit(event.target.open)")
