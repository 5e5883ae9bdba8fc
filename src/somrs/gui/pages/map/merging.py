"""Saying which known object a discovered one is: the likely objects, and what would change."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.author import author
from somrs.gui.components.fields.picker import Choice, Picker
from somrs.gui.pages.map.change_text import describe_changes
from somrs.gui.pages.map.moves import X, Y, Z
from somrs.gui.shell import guarded, notify
from somrs.ontology.map import Map
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.protocol.messages.knowledge import MergeObject
from somrs.repository.association import compatible_types

_MAX_LINES = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """An object that a discovered one may be. `distance` in metres; None if the place of either is not known."""

    name: str
    type: str
    missing: bool
    distance: float | None

    @property
    def label(self) -> str:
        where = "nobody knows where it is" if self.missing else f"{self.distance:.1f} m away" if self.distance is not None else ""
        return " · ".join(part for part in (self.name, self.type, where) if part)


def candidates(name: str, map: Map, ontology: Ontology) -> list[Candidate]:
    """The objects that the object may be, the likeliest first: of the same type, missing, near."""
    object = map.objects[name]
    options = [
        Candidate(
            name=other.name, type=other.type, missing=other.values.get(UNKNOWN) is True, distance=_distance(object.values, other.values)
        )
        for type in compatible_types(object.type, ontology)
        for other in (map.objects[other_name] for other_name in map.of_type(type))
        if other.name != name and not ontology.is_device(other.type)
    ]
    return sorted(options, key=lambda option: (option.type != object.type, not option.missing, _or_far(option.distance), option.name))


def _distance(values: dict[str, float | str | bool], other_values: dict[str, float | str | bool]) -> float | None:
    pairs = [(values.get(path), other_values.get(path)) for path in (X, Y, Z)]
    gaps = [a - b for a, b in pairs if isinstance(a, int | float) and isinstance(b, int | float)]
    return math.hypot(*gaps) if len(gaps) == len(pairs) else None


def _or_far(distance: float | None) -> float:
    return distance if distance is not None else math.inf


class MergeDialog:
    """The dialog that asks which object of the map `name` is, and shows what would change. `ask` returns the new version and the name."""

    def __init__(self, api: LiveApi, name: str) -> None:
        self._api, self.name = api, name
        self._candidates = candidates(name, api.context.map, api.context.ontology)

    async def ask(self) -> tuple[int, str] | None:
        """Ask the user, and state that the objects are one. Returns the version and the object's name; None if the user cancels."""
        title = f"Which object is {self.name}?"
        with ui.dialog().props(f'aria-label="{title}"') as dialog, ui.card().classes("somrs-map-dialog"):
            ui.label(title).classes("somrs-title")
            if self._candidates:
                choices = [Choice(value=option.name, text=option.label) for option in self._candidates]
                self._choice = Picker("Known object", value=choices[0]["value"], options=choices, on_pick=guarded(self._show_consequences))
                self._consequences = ui.element("div").props('role="status"')
            else:
                ui.label(f"The map has no other object that {self.name} could be.").classes("somrs-soft")
            with ui.element("div").classes("somrs-map-buttons"):
                if self._candidates:
                    self._confirm = ui.button(
                        f"It is {self._choice.value}", icon="check", on_click=lambda: dialog.submit(self._choice.value)
                    )
                    self._confirm.props("unelevated no-caps")
                ui.button("Cancel", on_click=dialog.close).props("flat no-caps")
            if self._candidates:
                ui.timer(0, partial(guarded(self._show_consequences), self._choice.value), once=True)
        dialog.on("hide", dialog.delete)
        into = await dialog
        if not into:
            return None
        merge = MergeObject(name=self.name, into=into, author=author())
        result = await self._api.map.merge(merge)
        notify(f"{self.name} is {into}")
        return result.version, into

    async def _show_consequences(self, into: str) -> None:
        self._confirm.set_enabled(False)
        self._consequences.clear()
        considered = await self._api.map.consider_merge(MergeObject(name=self.name, into=into))
        if into != self._choice.value:
            return  # the user chose another one meanwhile
        self._consequences.clear()
        self._confirm.set_text(f"It is {into}")
        self._confirm.set_enabled(not considered.broken)
        with self._consequences:
            if considered.broken:
                ui.label("They cannot be one object:").classes("somrs-map-wrong")
            lines = [f"{rule.subject} {rule.message}" for rule in considered.broken[:_MAX_LINES]]
            lines = lines or [
                line for line in describe_changes(considered.changes, self._api.context.ontology) if line != f"{self.name} removed"
            ]
            with ui.element("ul").classes("somrs-map-consequences"):
                for line in lines or [f"{into} stays as it is"]:
                    with ui.element("li"):
                        ui.label(line)
            if not considered.broken:
                ui.label(f"{self.name} leaves the map. Later reports about it are about {into}. This can be undone.").classes("somrs-soft")
