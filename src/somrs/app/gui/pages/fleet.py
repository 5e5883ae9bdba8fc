"""Fleet."""

from __future__ import annotations

from nicegui import ui

from somrs.app.desk.desk import Desk
from somrs.app.gui.shell import page


def register(desk: Desk) -> None:
    @ui.page("/fleet")
    async def show() -> None:
        with page("Fleet", "/fleet"):
            ui.label("Fleet").classes("somrs-title")
