"""The first page: where one is, what runs, and the ways on."""

from __future__ import annotations

from nicegui import ui

from somrs.app.desk.desk import Desk
from somrs.app.gui.shell import PLACES, page


def register(desk: Desk) -> None:
    @ui.page("/")
    async def start() -> None:
        with page("Start", "/"):
            ui.label("SO-MRS").classes("somrs-title")
            with ui.row():
                for place in PLACES:
                    ui.link(place.label, place.path)
