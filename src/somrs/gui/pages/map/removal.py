"""Removing an object after showing the consequences."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.author import author
from somrs.gui.pages.map.moves import IN_RELATION, ON_RELATION
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, ObjectRemoved
from somrs.ontology.types import PART_OF
from somrs.protocol.messages.knowledge import UpdateMap

ChangeMap = Callable[[tuple[Change, ...], str], Awaitable[int | None]]
_MAX_NAMES = 8


async def remove(api: LiveApi, name: str, change: ChangeMap) -> bool:
    """Ask the user to confirm, and remove the object. Returns whether it was removed."""
    map = api.context.map
    if name not in map.objects:
        return False
    parts = _parts(map, name)
    object_removal: tuple[Change, ...] = (ObjectRemoved(name),)
    full_removal: tuple[Change, ...] = (*(ObjectRemoved(part) for part in reversed(parts)), *object_removal)
    changes = full_removal if parts else object_removal
    considered = await api.map.consider(UpdateMap(changes=changes, author=author()))
    standing = [thing for relation in (ON_RELATION, IN_RELATION) for thing, *_ in map.facts_with(relation, 1, name)]
    facts = [
        fact for fact in map.facts_about(name) if fact.relation not in (PART_OF, ON_RELATION, IN_RELATION) or fact.arguments[0] == name
    ]
    title = f"Remove {name}?"
    with ui.dialog().props(f'role="alertdialog" aria-label="{title}"') as dialog, ui.card().classes("somrs-map-dialog"):
        ui.label(title).classes("somrs-title")
        with ui.element("ul").classes("somrs-map-consequences"):
            _line(f"a {map.objects[name].type} of the map")
            if parts:
                _line(f"its {_count_text(len(parts), 'part')} with it: {_join_names(parts)}")
            if standing:
                _line(f"{_join_names(standing)} {'stands' if len(standing) == 1 else 'stand'} on it, and would lose support")
            if facts:
                _line(f"it is in {_count_text(len(facts), 'relation')}: {_join_names([str(fact) for fact in facts])}")
        if considered.broken:
            ui.label("It cannot be removed, because the map would break these rules:").classes("somrs-map-wrong").props('role="alert"')
            with ui.element("ul").classes("somrs-map-consequences"):
                for broken in considered.broken[:_MAX_NAMES]:
                    _line(f"{broken.subject}: {broken.message}")
        with ui.element("div").classes("somrs-map-buttons"):
            if not considered.broken:
                ui.button("Remove", icon="delete", on_click=lambda: dialog.submit(True)).props(
                    "unelevated no-caps color=negative autofocus"
                )
            keep_button = ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("flat no-caps")
            if considered.broken:
                keep_button.props("autofocus")
    dialog.on("hide", dialog.delete)
    answer = await dialog
    return bool(answer) and await change(changes, f"{name} removed") is not None


def _parts(map: Map, name: str) -> list[str]:
    """The parts of an object and their parts, each whole before its parts."""
    part_names: list[str] = []
    waiting = [name]
    while waiting:
        for part in map.parts(waiting.pop()):
            if part.name not in part_names and part.name != name:
                part_names.append(part.name)
                waiting.append(part.name)
    return part_names


def _line(text: str) -> None:
    with ui.element("li"):
        ui.label(text)


def _join_names(names: list[str]) -> str:
    return ", ".join(names[:_MAX_NAMES]) + (f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else "")


def _count_text(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
