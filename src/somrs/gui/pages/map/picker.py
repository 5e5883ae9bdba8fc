"""Choosing an object by typing part of its name; the server searches, so that maps may have thousands of objects."""

from __future__ import annotations

from nicegui import ui
from nicegui.events import GenericEventArguments

from somrs.api.remote import LiveApi
from somrs.gui.shell import focus
from somrs.ontology.types import ROOT

_MAX_OPTIONS = 30


class ObjectPicker:
    """A field for an object that fits an argument of a relation (`place`, counted from 0)."""

    def __init__(self, api: LiveApi, label: str, relation: str, place: int) -> None:
        self._api, self._relation, self._place = api, relation, place
        self._field = ui.select({}, label=label, with_input=True, clearable=True).props("outlined dense options-dense hide-bottom-space")
        self._field.props("input-debounce=100")
        self._field.on("input-value", self._typed)
        self._field.on("focus", lambda: self._load_options(""))

    @property
    def value(self) -> str | None:
        selected_name = self._field.value
        return str(selected_name) if selected_name else None

    def focus(self) -> None:
        focus(self._field)

    async def _typed(self, event: GenericEventArguments) -> None:
        await self._load_options(str(event.args or ""))

    async def _load_options(self, typed: str) -> None:
        result = await self._api.formulas.things(typed=typed, type=ROOT, relation=self._relation, place=self._place, limit=_MAX_OPTIONS)
        options = {thing.name: f"{thing.name} · {thing.type}" + (f" · {thing.label}" if thing.label else "") for thing in result.things}
        if self.value is not None:
            options.setdefault(self.value, self.value)
        self._field.set_options(options, value=self._field.value)
