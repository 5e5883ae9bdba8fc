"""Tasks."""

from __future__ import annotations

from nicegui import ui

from somrs.app.desk.desk import Desk
from somrs.app.gui.shell import page


def register(desk: Desk) -> None:
    @ui.page("/tasks")
    async def show() -> None:
        with page("Tasks", "/tasks"):
            ui.label("Tasks").classes("somrs-title")
