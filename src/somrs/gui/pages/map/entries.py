"""Events of the map as a list: time, author, changes; with buttons to show a version on the plan and to undo it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from functools import partial

from nicegui import ui

from somrs.gui.pages.map.change_text import describe_event, format_time
from somrs.gui.shell import guarded
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Event
from somrs.protocol.messages.people import person_name


def show_events(
    events: Iterable[Event],
    ontology: Ontology,
    show_version: Callable[[int], Awaitable[None] | None],
    undo: Callable[[int], Awaitable[None]] | None = None,
) -> None:
    """Add the events to the current element."""
    event_list = [*events]
    undone = {event.undoes for event in event_list}
    for event in event_list:
        with ui.element("li").classes("somrs-map-event"):
            with ui.element("div").classes("somrs-map-event-head"):
                ui.label(format_time(event.at)).classes("somrs-map-when")
                ui.label(person_name(event.author)).classes("somrs-map-who")
                if event.undoes is not None:
                    ui.label(f"undid {event.undoes}").classes("somrs-soft")
                if event.version in undone:
                    ui.label("undone").classes("somrs-soft")
                ui.space()
                _button("visibility", f"Show the map at version {event.version}", partial(show_version, event.version))
                if undo is not None and event.version not in undone:
                    _button("undo", f"Undo version {event.version}", partial(guarded(undo), event.version))
            for line in describe_event(event, ontology):
                ui.label(line).classes("somrs-map-what")


def list_note(text: str) -> None:
    """Add a text to a list, such as that it is empty."""
    with ui.element("li"):
        ui.label(text).classes("somrs-soft")


def _button(icon: str, label: str, action: Callable[..., object]) -> None:
    button = ui.button(icon=icon, on_click=action).props(f'flat round dense size=sm aria-label="{label}"')
    button.tooltip(label)
