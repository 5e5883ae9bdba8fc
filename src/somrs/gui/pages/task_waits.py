"""What a task waits for: other tasks, each with a link to its page, or services."""

from __future__ import annotations

from nicegui import ui

from somrs.gui.icons import format_time
from somrs.gui.pages.task_text import count_text, hindrance_texts, wait_texts
from somrs.protocol.messages.waits import WaitsForTasks, WaitsToRetry


def show_waits(waiting_for: WaitsForTasks, verb: str) -> None:
    """Show a sentence for each of these tasks. `verb`: `Waits for`, for example."""
    for wait in wait_texts(waiting_for):
        with ui.element("div").classes("somrs-waits"):
            ui.label(f"{verb} ")
            ui.link(wait["goal"], wait["href"]).classes("somrs-formula")
            ui.label(f", which {wait['reserved']}.")


def show_hindrances(wait: WaitsToRetry) -> None:
    """Show list items: why there is no way to do the task now, since when, and when it is tried again."""
    for text in hindrance_texts(wait):
        with ui.element("li"):
            ui.label(text)
    with ui.element("li").classes("somrs-soft"):
        attempts = count_text(wait.attempts, "attempt")
        ui.label(f"{attempts} since {format_time(wait.since)}; next attempt at {format_time(wait.next_attempt)}, or on news.")
