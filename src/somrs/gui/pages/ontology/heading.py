"""The heading of a definition: name, ancestors, description and actions."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from nicegui import ui

from somrs.gui.pages.ontology.elements import OpenDefinition, TextTag, definition_link, note
from somrs.gui.pages.ontology.ontology_view import OntologyView
from somrs.gui.pages.ontology.sections import SECTIONS, SERVICES, TYPES, Section, section_of
from somrs.ontology.types import ROOT, Definition

DefinitionAction = Callable[[Section, str], Awaitable[object] | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class DefinitionActions:
    """Actions on a definition. `add_below` creates a definition below it."""

    edit: DefinitionAction
    add_below: DefinitionAction
    rename: DefinitionAction
    move: DefinitionAction
    remove: DefinitionAction
    history: DefinitionAction
    open_definition: OpenDefinition


@dataclass(frozen=True, slots=True)
class Heading:
    """What the heading of a definition shows. `ancestors` begin with the root."""

    definition: Definition
    problem: str
    ancestors: tuple[str, ...]
    is_system: bool

    @classmethod
    def of(cls, definition: Definition, problem: str, view: OntologyView) -> Heading:
        section, name = section_of(definition), definition.name
        ancestors: tuple[str, ...] = ()
        if section is TYPES:
            ancestors = (*reversed(view.ontology.ancestors(name)[1:]),)
        elif section is SERVICES and (parent := view.ontology.services[name].parent):
            ancestors = (parent,)
        return cls(definition, problem, ancestors, (section.key, name) in view.system_definitions)

    def build(self, actions: DefinitionActions) -> None:
        """Add the heading to the current element."""
        section, name = section_of(self.definition), self.definition.name
        if self.ancestors:
            with ui.element("nav").classes("somrs-onto-trail").props('aria-label="Ancestors"'):
                for ancestor in self.ancestors:
                    definition_link(actions.open_definition, section, ancestor)
                    TextTag("span", "›").props('aria-hidden="true"')
        with ui.element("div").classes("somrs-onto-head"):
            ui.icon(section.icon)
            TextTag("h2", name)
            TextTag("span", section.singular, "somrs-soft")
        if self.definition.doc:
            ui.label(self.definition.doc).classes("somrs-onto-doc")
        if self.problem:
            with ui.element("div").classes("somrs-onto-banner somrs-onto-bad").props('role="alert"'):
                ui.icon("error")
                ui.label(self.problem).classes("somrs-onto-pre")
        _buttons(section, name, self.is_system, actions)


def _buttons(section: Section, name: str, is_system: bool, actions: DefinitionActions) -> None:
    def button(text: str, icon: str, act: DefinitionAction, *, disabled: bool = False) -> None:
        element = ui.button(text, icon=icon, on_click=lambda: act(section, name)).props("flat dense no-caps")
        if disabled:
            element.disable()
            with element:
                ui.tooltip("Required by SO-MRS")

    with ui.element("div").classes("somrs-onto-buttons"):
        ui.button("Edit", icon="edit", on_click=lambda: actions.edit(section, name)).props("unelevated dense no-caps").classes(
            "somrs-onto-edit"
        )
        if section in (TYPES, SERVICES):
            button("New below", "add", actions.add_below)
        button("Rename", "drive_file_rename_outline", actions.rename, disabled=is_system)
        if section in (TYPES, SERVICES) and name != ROOT:
            button("Move", "drive_file_move", actions.move)
        button("Remove", "delete", actions.remove, disabled=is_system)
        button("History", "history", actions.history)


def show_missing(section: Section, name: str, history: Callable[[], object]) -> None:
    """Show that a definition does not exist."""
    with ui.element("div").classes("somrs-onto-head"):
        ui.icon("search_off")
        TextTag("h2", name)
    note(f"There is no {section.singular} of this name. It may have been removed or renamed. Select another one in the list.")
    with ui.element("div").classes("somrs-onto-buttons"):
        ui.button("See its history", icon="history", on_click=history).props("flat dense no-caps")


def show_overview(view: OntologyView) -> None:
    """The page's content while no definition is open."""
    with ui.element("div").classes("somrs-onto-head"):
        ui.icon("account_tree")
        TextTag("h2", "Definitions")
    note("Types, attributes, relations, functions and services of the map and the tasks. Select one on the left to view or edit it.")
    with ui.element("dl").classes("somrs-onto-facts"):
        for section in SECTIONS:
            TextTag("dt", section.label)
            TextTag("dd", str(len(section.definitions_in(view.ontology))))
