"""The selected object at a past version of the map, read-only."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.pages.map.change_text import format_value
from somrs.gui.shell import guarded


class PastSheet:
    """Added to the current element. `open_object` opens another object."""

    def __init__(self, api: LiveApi, name: str, version: int, open_object: Callable[[str | None], None]) -> None:
        self._api, self._name, self._version, self._open_object = api, name, version, open_object
        with ui.element("div").classes("somrs-map-title"):
            ui.label(name).classes("somrs-title").props('role="heading" aria-level="2"')
            self._type = ui.label().classes("somrs-soft")
            ui.space()
            close = ui.button(icon="close", on_click=lambda: open_object(None))
            close.props('flat round dense size=sm aria-label="Close"').tooltip("Close")
        ui.label(f"As it was at version {version}").classes("somrs-soft")
        self._body = ui.element("div")
        ui.timer(0, guarded(self._read), once=True)

    async def _read(self) -> None:
        map_state = await self._api.map.read(self._version)
        object = next((candidate for candidate in map_state.objects if candidate.name == self._name), None)
        facts = [fact for fact in map_state.facts if self._name in fact.arguments]
        with self._body:
            if object is None:
                ui.label(f"{self._name} was not on the map at this version.").props('role="status"')
                return
            self._type.text = object.type
            attributes = self._api.context.ontology.attributes
            with ui.element("dl").classes("somrs-map-values").props('aria-label="Attributes"'):
                for path, value in object.values.items():
                    with ui.element("dt"):
                        ui.label(path)
                    with ui.element("dd"):
                        ui.label(format_value(value, attributes.get(path.rpartition(".")[2])))
            with ui.element("section").classes("somrs-map-part").props('aria-label="Relations"'):
                ui.label("Relations").classes("somrs-map-head")
                with ui.element("ul").classes("somrs-map-facts"):
                    for fact in facts:
                        with ui.element("li").classes("somrs-map-fact"):
                            ui.label(str(fact))
                if not facts:
                    ui.label("No relations.").classes("somrs-soft")
