"""The tasks that a task waits for, each with a link to its page."""

from __future__ import annotations

from nicegui import ui

from somrs.gui.pages.task_text import wait_texts
from somrs.protocol.messages.events import WaitsForTasks


def show_waits(waiting_for: WaitsForTasks, verb: str) -> None:
    """Show a sentence for each of these tasks. `verb`: `Waits for`, for example."""
    for wait in wait_texts(waiting_for):
        with ui.element("div").classes("somrs-waits"):
            ui.label(f"{verb} ")
            ui.link(wait["goal"], wait["href"]).classes("somrs-formula")
            ui.label(f", which {wait['reserved']}.")
