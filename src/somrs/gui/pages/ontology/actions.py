"""Actions on a definition without a form: rename, move, remove, undo. Each shows its consequences first."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping

from msgspec import structs
from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.errors import InputError
from somrs.gui.author import author
from somrs.gui.pages.ontology.changes import definition_changes, summary
from somrs.gui.pages.ontology.consequences import confirm_change
from somrs.gui.pages.ontology.elements import TextTag, in_page_context, titled_dialog
from somrs.gui.pages.ontology.ontology_view import OntologyView
from somrs.gui.pages.ontology.sections import SERVICES, TYPES, Section
from somrs.gui.shell import guarded, notify
from somrs.ontology.naming import DefinitionKey, Renaming
from somrs.ontology.naming import Section as Naming
from somrs.ontology.services import ServiceType
from somrs.ontology.types import ObjectType
from somrs.protocol.messages.knowledge import Define, Event, by_kind
from somrs.protocol.messages.people import person_name

OpenDefinition = Callable[[Section, str, int], Awaitable[None]]
"""Opens a definition once the page's ontology has the version."""


class Actions:
    """`open_definition` is called after a definition was changed."""

    def __init__(self, api: LiveApi, view: OntologyView, open_definition: OpenDefinition) -> None:
        self._api, self._view, self._open_definition = api, view, open_definition
        self.client = ui.context.client
        self._undoing = asyncio.Lock()
        """Held during an undo: only then is the next change to undo known."""

    @in_page_context
    @guarded
    async def rename(self, section: Section, name: str) -> None:
        """Ask for the new name, show the consequences, and rename."""
        new_name = await _ask_for_text(f"Rename {name}", "New name", name)
        if not new_name or new_name == name:
            return
        renamed = (Renaming(section=Naming(section.key), name=name, to=new_name),)
        change = Define(renamed=renamed, author=author(), expected_version=self._view.version)
        if (version := await self._carry_out(change, f"Rename {name} to {new_name}", "Rename")) is not None:
            notify(f"{name} renamed to {new_name}")
            await self._open_definition(section, new_name, version)

    @in_page_context
    @guarded
    async def ask_move(self, section: Section, name: str) -> None:
        """Ask for a new parent, and move the definition below it."""
        definitions: Mapping[str, ObjectType | ServiceType] = (
            self._view.ontology.types if section is TYPES else self._view.ontology.services
        )
        descendants = {candidate for candidate in definitions if self._is_descendant(section, candidate, name)}
        options: dict[str | None, str] = {} if section is TYPES else {None: "none"}
        options.update({candidate: candidate for candidate in sorted(definitions.keys() - descendants)})
        definition = definitions[name]
        with titled_dialog(f"Move {name}") as dialog, ui.card().classes("somrs-onto-dialog somrs-onto-small"):
            TextTag("h2", f"Move {name}")
            choice = ui.select(options, label="Below", value=definition.parent, with_input=True)
            choice.props("outlined dense autofocus options-dense").classes("somrs-onto-full")
            _buttons(dialog, "Move", lambda: (choice.value,))
        answer = await dialog
        if not dialog.is_deleted:
            dialog.delete()
        if answer is not None and answer[0] != definition.parent:
            await self.move(section, name, answer[0])

    def _is_descendant(self, section: Section, candidate: str, name: str) -> bool:
        """Whether the candidate is the definition or one of its descendants."""
        if section is TYPES:
            return name in self._view.ontology.ancestors(candidate)
        visited: set[str] = set()
        current: str | None = candidate
        while current is not None and current in self._view.ontology.services and current not in visited:
            if current == name:
                return True
            visited.add(current)
            current = self._view.ontology.services[current].parent
        return False

    @in_page_context
    @guarded
    async def move(self, section: Section, name: str, parent: str | None) -> None:
        """Change the parent of a definition."""
        definition = self._view.definition(section, name)
        if section not in (TYPES, SERVICES) or not isinstance(definition, ObjectType | ServiceType):
            raise InputError(f"{name} has no parent")
        moved = structs.replace(definition, parent=parent)
        change = Define(definitions=by_kind([moved]), author=author(), expected_version=self._view.version)
        if (version := await self._carry_out(change, f"Move {name} below {parent or 'none'}", "Move")) is not None:
            notify(f"{name} moved below {parent or 'none'}")
            await self._open_definition(section, name, version)

    @in_page_context
    @guarded
    async def remove(self, section: Section, name: str) -> bool:
        """Show the consequences, and remove the definition if no rule is broken. Returns whether it was removed."""
        change = Define(
            removed=(DefinitionKey(section=Naming(section.key), name=name),), author=author(), expected_version=self._view.version
        )
        if await self._carry_out(change, f"Remove the {section.singular} {name}", "Remove") is None:
            return False
        notify(f"The {section.singular} {name} removed; Undo restores it")
        return True

    async def _carry_out(self, change: Define, title: str, verb: str) -> int | None:
        """Show the consequences and make the change. Returns the new version; None if the user cancelled."""
        consequences = await self._api.ontology.consider(change)
        if not await confirm_change(title, verb, consequences, change.renamed):
            return None
        return (await self._api.ontology.change(change)).version

    @in_page_context
    @guarded
    async def undo(self, event: Event) -> None:
        """Undo an event of the history."""
        consequences = await self._api.ontology.consider_undo(event.version)
        description = f"{person_name(event.author)} changed it: {summary(definition_changes(event.revision, event.renamed))}"
        if await confirm_change("Undo", "Undo", consequences, explanation=description):
            async with self._undoing:
                await self._api.ontology.undo(event.version, author())
            notify("Undone")

    @in_page_context
    @guarded
    async def undo_last(self) -> None:
        async with self._undoing:
            events = (await self._api.ontology.history(limit=100)).events
        if (event := _last_to_undo(events)) is None:
            notify("There is nothing to undo")
        else:
            await self.undo(event)


def _last_to_undo(events: tuple[Event, ...]) -> Event | None:
    """The newest change that is neither undone nor an undo, so that repeated undo goes further back."""
    undone = {event.undoes for event in events}
    return next((event for event in events if event.undoes is None and event.version not in undone), None)


async def _ask_for_text(title: str, label: str, value: str) -> str | None:
    """Ask the user for a text; None if the user cancelled."""
    with titled_dialog(title) as dialog, ui.card().classes("somrs-onto-dialog somrs-onto-small"):
        TextTag("h2", title)
        field = ui.input(label, value=value).props("outlined dense autofocus").classes("somrs-onto-full")
        field.on("keydown.enter", lambda: dialog.submit(field.value.strip()))
        _buttons(dialog, "Continue", lambda: field.value.strip())
    answer: str | None = await dialog
    if not dialog.is_deleted:
        dialog.delete()
    return answer


def _buttons(dialog: ui.dialog, verb: str, answer: Callable[[], object]) -> None:
    with ui.row().classes("somrs-onto-buttons"):
        ui.button("Cancel", on_click=lambda: dialog.submit(None)).props("flat no-caps")
        ui.button(verb, on_click=lambda: dialog.submit(answer())).props("unelevated no-caps")
