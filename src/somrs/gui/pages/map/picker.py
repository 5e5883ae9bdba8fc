"""Choosing an object by typing part of its name: what fits comes from the server, so that a map may have thousands of them."""

from __future__ import annotations

from nicegui import ui
from nicegui.events import GenericEventArguments

from somrs.api.remote import LiveApi
from somrs.gui.shell import focus
from somrs.ontology.types import ROOT

MOST = 30


class ObjectPicker:
    """A field for an object that fits a place of a relation, counted from 0."""

    def __init__(self, desk: LiveApi, label: str, relation: str, place: int) -> None:
        self._desk, self._relation, self._place = desk, relation, place
        self._field = ui.select({}, label=label, with_input=True, clearable=True).props("outlined dense options-dense hide-bottom-space")
        self._field.props("input-debounce=100")
        self._field.on("input-value", self._typed)
        self._field.on("focus", lambda: self._find(""))

    @property
    def value(self) -> str | None:
        found = self._field.value
        return str(found) if found else None

    def focus(self) -> None:
        focus(self._field)

    async def _typed(self, event: GenericEventArguments) -> None:
        await self._find(str(event.args or ""))

    async def _find(self, typed: str) -> None:
        found = await self._desk.formulas.things(typed=typed, type=ROOT, relation=self._relation, place=self._place, limit=MOST)
        options = {one.name: f"{one.name} · {one.type}" + (f" · {one.label}" if one.label else "") for one in found.things}
        if self.value is not None:
            options.setdefault(self.value, self.value)
        self._field.set_options(options, value=self._field.value)
