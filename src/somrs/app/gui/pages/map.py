"""Map."""

from __future__ import annotations

from nicegui import ui

from somrs.app.desk.desk import Desk
from somrs.app.gui.parts.floorplan import FloorPlan
from somrs.app.gui.shell import page


def register(desk: Desk) -> None:
    @ui.page("/map")
    async def show() -> None:
        with page("Map", "/map"), ui.element("div").style("height: calc(100vh - 80px)"):
            plan = FloorPlan(mode="edit", snap=0.05)
            plan.on_select(lambda at: plan.choose(at["name"]))
