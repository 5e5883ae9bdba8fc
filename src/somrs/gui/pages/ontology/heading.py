"""What stands above a definition: its name, where it belongs, what it means, and what can be done with it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from nicegui import ui

from somrs.gui.pages.ontology.pieces import Go, Word, note, way
from somrs.gui.pages.ontology.sections import SECTIONS, SERVICES, TYPES, Section, section_of
from somrs.gui.pages.ontology.seen import Seen
from somrs.ontology.types import ROOT, Definition

Act = Callable[[Section, str], Awaitable[object] | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ways:
    """What can be done with a definition. `below`: something new below it."""

    edit: Act
    below: Act
    rename: Act
    move: Act
    remove: Act
    history: Act
    go: Go


def show(definition: Definition, seen: Seen, problem: str, ways: Ways) -> None:
    """The head of a definition's sheet, into the current element."""
    section, name = section_of(definition), definition.name
    _trail(section, name, seen, ways.go)
    with ui.element("div").classes("somrs-onto-head"):
        ui.icon(section.icon)
        Word("h2", name)
        Word("span", section.one, "somrs-soft")
    if definition.doc:
        ui.label(definition.doc).classes("somrs-onto-doc")
    if problem:
        with ui.element("div").classes("somrs-onto-banner somrs-onto-bad").props('role="alert"'):
            ui.icon("error")
            ui.label(problem).classes("somrs-onto-pre")
    _buttons(section, name, (section.key, name) in seen.relied, ways)


def _trail(section: Section, name: str, seen: Seen, go: Go) -> None:
    """Its ancestors, the root first."""
    if section is TYPES:
        above = [*reversed(seen.ontology.ancestors(name)[1:])]
    elif section is SERVICES and (parent := seen.ontology.services[name].parent):
        above = [parent]
    else:
        return
    with ui.element("nav").classes("somrs-onto-trail").props('aria-label="Ancestors"'):
        for one in above:
            way(go, section, one)
            Word("span", "›").props('aria-hidden="true"')


def _buttons(section: Section, name: str, relied: bool, ways: Ways) -> None:
    def button(text: str, icon: str, act: Act, *, off: bool = False) -> None:
        made = ui.button(text, icon=icon, on_click=lambda: act(section, name)).props("flat dense no-caps")
        if off:
            made.disable()
            with made:
                ui.tooltip("SO-MRS itself relies on it")

    with ui.element("div").classes("somrs-onto-buttons"):
        ui.button("Edit", icon="edit", on_click=lambda: ways.edit(section, name)).props("unelevated dense no-caps").classes(
            "somrs-onto-edit"
        )
        if section in (TYPES, SERVICES):
            button("New below", "add", ways.below)
        button("Rename", "drive_file_rename_outline", ways.rename, off=relied)
        if section in (TYPES, SERVICES) and name != ROOT:
            button("Move", "drive_file_move", ways.move)
        button("Remove", "delete", ways.remove, off=relied)
        button("History", "history", ways.history)


def gone(section: Section, name: str, history: Callable[[], object]) -> None:
    """What was asked for is not there."""
    with ui.element("div").classes("somrs-onto-head"):
        ui.icon("search_off")
        Word("h2", name)
    note(f"There is no {section.one} of this name. It may have been removed or renamed.")
    with ui.element("div").classes("somrs-onto-buttons"):
        ui.button("See its history", icon="history", on_click=history).props("flat dense no-caps")


def overview(seen: Seen, go: Go) -> None:
    """What there is, while nothing is open."""
    with ui.element("div").classes("somrs-onto-head"):
        ui.icon("account_tree")
        Word("h2", "What kinds of things there are")
    note("The words that the map, the tasks and the services are written in. Choose one on the left to read or change it.")
    with ui.element("dl").classes("somrs-onto-facts"):
        for section in SECTIONS:
            Word("dt", section.label)
            Word("dd", str(len(section.among(seen.ontology))))
