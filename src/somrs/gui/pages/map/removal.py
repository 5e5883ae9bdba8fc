"""Removing an object, with what would come of it shown before."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.pages.map.moves import IN, ON
from somrs.gui.shell import author
from somrs.ontology.objects import Change, Map, ObjectRemoved
from somrs.ontology.types import PART_OF
from somrs.protocol.messages.knowledge import UpdateMap

Change_ = Callable[[tuple[Change, ...], str], Awaitable[int | None]]
MOST = 8


async def remove(desk: LiveApi, name: str, change: Change_) -> bool:
    """Ask whether an object is to go, and remove it. Whether it is gone."""
    map = desk.context.map
    if name not in map.objects:
        return False
    parts = _parts(map, name)
    alone: tuple[Change, ...] = (ObjectRemoved(name),)
    whole: tuple[Change, ...] = (*(ObjectRemoved(part) for part in reversed(parts)), *alone)
    changes = whole if parts else alone
    considered = await desk.map.consider(UpdateMap(changes=changes, author=author()))
    standing = [one for relation in (ON, IN) for one, *_ in map.facts_with(relation, 1, name)]
    facts = [fact for fact in map.facts_about(name) if fact.relation not in (PART_OF, ON, IN) or fact.arguments[0] == name]
    title = f"Remove {name}?"
    with ui.dialog() as dialog, ui.card().classes("somrs-map-dialog").props(f'role="alertdialog" aria-label="{title}"'):
        ui.label(title).classes("somrs-title")
        with ui.element("ul").classes("somrs-map-consequences"):
            _line(f"a {map.objects[name].type} of the map")
            if parts:
                _line(f"its {_count(len(parts), 'part')} with it: {_listed(parts)}")
            if standing:
                _line(f"{_listed(standing)} {'stands' if len(standing) == 1 else 'stand'} on it, and would stand on nothing")
            if facts:
                _line(f"it is in {_count(len(facts), 'relation')}: {_listed([str(fact) for fact in facts])}")
        if considered.broken:
            ui.label("It has to stay, for the map would break its rules:").classes("somrs-map-wrong").props('role="alert"')
            with ui.element("ul").classes("somrs-map-consequences"):
                for broken in considered.broken[:MOST]:
                    _line(f"{broken.subject}: {broken.message}")
        with ui.element("div").classes("somrs-map-buttons"):
            if not considered.broken:
                ui.button("Remove", icon="delete", on_click=lambda: dialog.submit(True)).props(
                    "unelevated no-caps color=negative autofocus"
                )
            back = ui.button("Keep it", on_click=lambda: dialog.submit(False)).props("flat no-caps")
            if considered.broken:
                back.props("autofocus")
    dialog.on("hide", dialog.delete)
    answer = await dialog
    return bool(answer) and await change(changes, f"{name} was removed") is not None


def _parts(map: Map, name: str) -> list[str]:
    """The parts, and their parts, wholes before parts."""
    found: list[str] = []
    waiting = [name]
    while waiting:
        for part in map.parts(waiting.pop()):
            if part.name not in found and part.name != name:
                found.append(part.name)
                waiting.append(part.name)
    return found


def _line(text: str) -> None:
    with ui.element("li"):
        ui.label(text)


def _listed(names: list[str]) -> str:
    return ", ".join(names[:MOST]) + (f" and {len(names) - MOST} more" if len(names) > MOST else "")


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
