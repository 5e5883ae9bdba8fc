"""The dialog in which an operator puts a simulated robot somewhere else on the map."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.author import author
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.shell import guarded, notify


class PlacingDialog:
    """Opens at once. The user clicks the place on the floor plan, and confirms."""

    def __init__(self, api: LiveApi, robot: str) -> None:
        self._api, self._robot = api, robot
        self._point: tuple[float, float] | None = None
        self._storey = ""
        with ui.dialog().props(f'aria-label="Put {robot} elsewhere"') as self._dialog, ui.card().classes("somrs-dialog somrs-placing"):
            ui.label(f"Put {robot} elsewhere").classes("somrs-title").props('role="heading" aria-level="2"')
            ui.label(
                f"{robot} is put there at once, as if somebody carried it. It gives up what it does, and its task goes on from there. "
                "This is for simulated robots only."
            )
            self._plan = FloorPlan(mode="pick").classes("somrs-placing-plan")
            self._place_label = ui.label("Click the place on the floor plan.").props('role="status"')
            with ui.element("div").classes("somrs-dialog-ways"):
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
                self._button = ui.button("Put it there", on_click=guarded(self._put)).props("unelevated no-caps color=negative")
        self._button.disable()
        self._plan.highlight([robot])
        self._plan.on_picked(self._pick)
        self._plan.on_dropped(lambda event: self._pick(event) if event["thing"] == robot else None)
        self._plan.on_storey(self._show_storey)
        self._plan.on_loaded(lambda event: self._plan.show_object(robot))
        self._dialog.on("hide", self._dialog.delete)
        self._dialog.open()

    def _show_storey(self, event: dict[str, Any]) -> None:
        self._storey = str(event["name"] or "")

    def _pick(self, event: dict[str, Any]) -> None:
        if event.get("x") is None:
            return
        self._point = float(event["x"]), float(event["y"])
        x, y = self._point
        self._place_label.set_text(f"To x {x:.2f} m, y {y:.2f} m{f' on {self._storey}' if self._storey else ''}")
        self._plan.point([(self._robot, self._point)])
        self._button.enable()

    async def _put(self) -> None:
        assert self._point is not None, "the button is disabled before"
        x, y = self._point
        await self._api.fleet.put(self._robot, x=x, y=y, storey=self._storey or None, by=author())
        self._dialog.close()
        notify(f"{self._robot} was put at x {x:.2f} m, y {y:.2f} m")
