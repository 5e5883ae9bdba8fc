"""New task."""

from __future__ import annotations

from nicegui import ui

from somrs.app.desk.desk import Desk
from somrs.app.gui.parts.formula import FormulaField
from somrs.app.gui.shell import page


def register(desk: Desk) -> None:
    @ui.page("/define")
    async def show() -> None:
        with page("New task", "/define"):
            ui.label("New task").classes("somrs-title")
            FormulaField("What is to be", placeholder="Jar002 isOn Platform001", good="This fits the map.")
