"""Drawing zones on the Map page: the corners are clicked on the plan, then a dialog asks for the name, and for what robots do there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.api.zones import ZoneDrawing
from somrs.errors import InputError
from somrs.gui.author import author
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.pages.map.value_input import read
from somrs.gui.shell import notify
from somrs.gui.submission import submit_once
from somrs.ontology.types import Value

_NO_ENTRY, _SLOW = "No robot enters it", "Robots drive slowly"
_SPEED = "0.3"
"""The speed that is proposed for a slow zone, m/s."""


class ZoneTool:
    """The button that begins a zone. `on_drawn` is called with the version of the map that has a new one."""

    def __init__(self, api: LiveApi, on_drawn: Callable[[int], None]) -> None:
        self._api, self._on_drawn = api, on_drawn
        self.button = ui.button("Zone", icon="highlight_alt").props("flat dense no-caps")
        self.button.tooltip("Draw a zone that robots do not enter, or in which they drive slowly")

    def ask(self, event: dict[str, Any]) -> None:
        """Ask for the name of the zone with these corners, and draw it."""
        corners, storey = tuple((float(x), float(y)) for x, y in event["corners"]), event["storey"] or None
        with ui.dialog().props('aria-label="New zone"') as dialog, ui.card().classes("somrs-map-dialog"):
            ui.label("New zone").classes("somrs-title")
            with ui.element("form").props('aria-label="New zone" novalidate').classes("somrs-map-form") as form:
                name = ui.input("Name", value=self._free_name()).props("outlined dense autofocus autocomplete=off hide-bottom-space")
                kind = shown_at_once(ui.radio([_NO_ENTRY, _SLOW], value=_NO_ENTRY)).props('dense aria-label="What robots do"')
                speed = ui.input("Highest speed, m/s", value=_SPEED).props("outlined dense autocomplete=off hide-bottom-space")
                speed.bind_visibility_from(kind, "value", value=_SLOW)
                with ui.element("div").classes("somrs-map-buttons"):
                    draw_button = ui.button("Draw", icon="check").props("unelevated no-caps type=submit")
                    ui.button("Cancel", on_click=dialog.close).props("flat no-caps")

            async def draw() -> bool:
                limit: Value | None = None
                if kind.value == _SLOW:
                    try:
                        limit = read(str(speed.value or ""), self._api.context.ontology.attributes["SpeedLimit"])
                    except InputError as error:
                        speed.error = str(error)
                        return False
                highest = float(limit) if isinstance(limit, int | float) else None
                drawing = ZoneDrawing(
                    name=str(name.value or "").strip() or None, corners=corners, storey=storey, limit=highest, by=author()
                )
                drawn = await self._api.zones.draw(drawing)
                dialog.close()
                notify(f"{drawn.zone.name} was drawn; robots obey it")
                self._on_drawn(drawn.version)
                return True

            submit_once(form, draw_button, draw)
        dialog.on("hide", dialog.delete)
        dialog.open()

    def _free_name(self) -> str:
        objects = self._api.context.map.objects
        return next(name for number in range(1, len(objects) + 2) if (name := f"Zone{number:03d}") not in objects)
