"""Ontology."""

from __future__ import annotations

from nicegui import ui

from somrs.app.desk.desk import Desk
from somrs.app.gui.shell import page


def register(desk: Desk) -> None:
    @ui.page("/ontology")
    async def show() -> None:
        with page("Ontology", "/ontology"):
            ui.label("Ontology").classes("somrs-title")
