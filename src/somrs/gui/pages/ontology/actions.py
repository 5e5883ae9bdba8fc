"""What is done to a definition without its form: renaming, moving, removing; and undoing. Always with the consequences shown before."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping

from msgspec import structs
from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.errors import InputError
from somrs.gui.pages.ontology.changes import changed, summary
from somrs.gui.pages.ontology.consequences import confirmed
from somrs.gui.pages.ontology.pieces import Word, lasting, titled
from somrs.gui.pages.ontology.sections import SERVICES, TYPES, Section
from somrs.gui.pages.ontology.seen import Seen
from somrs.gui.shell import author, guarded, tell
from somrs.ontology.naming import DefinitionKey, Renaming
from somrs.ontology.naming import Section as Naming
from somrs.ontology.services import ServiceType
from somrs.ontology.types import ObjectType
from somrs.protocol.messages.knowledge import Define, Event, by_kind
from somrs.protocol.messages.people import person_name

Done = Callable[[Section, str, int], Awaitable[None]]
"""Go to this definition, once this version is there."""


class Actions:
    """`done` hears under which name a definition is to be seen then."""

    def __init__(self, desk: LiveApi, seen: Seen, done: Done) -> None:
        self._desk, self._seen, self._done = desk, seen, done
        self.client = ui.context.client

    @lasting
    @guarded
    async def rename(self, section: Section, name: str) -> None:
        """Ask for the name, show what is renamed along, and rename."""
        to = await _asked(f"Rename {name}", "New name", name)
        if not to or to == name:
            return
        renamed = (Renaming(section=Naming(section.key), name=name, to=to),)
        change = Define(renamed=renamed, author=author(), expected_version=self._seen.version)
        if (version := await self._carried_out(change, f"Rename {name} to {to}", "Rename")) is not None:
            tell(f"{name} is called {to} now, everywhere")
            await self._done(section, to, version)

    @lasting
    @guarded
    async def ask_move(self, section: Section, name: str) -> None:
        """Ask below which other one it is to go, and move it there."""
        known: Mapping[str, ObjectType | ServiceType] = self._seen.ontology.types if section is TYPES else self._seen.ontology.services
        below = {one for one in known if self._below(section, one, name)}
        options: dict[str | None, str] = {} if section is TYPES else {None: "none"}
        options.update({one: one for one in sorted(known.keys() - below)})
        definition = known[name]
        with titled(f"Move {name}") as dialog, ui.card().classes("somrs-onto-dialog somrs-onto-small"):
            Word("h2", f"Move {name}")
            choice = ui.select(options, label="Below", value=definition.parent, with_input=True)
            choice.props("outlined dense autofocus options-dense").classes("somrs-onto-full")
            _buttons(dialog, "Move", lambda: (choice.value,))
        answer = await dialog
        if not dialog.is_deleted:
            dialog.delete()
        if answer is not None and answer[0] != definition.parent:
            await self.move(section, name, answer[0])

    def _below(self, section: Section, one: str, name: str) -> bool:
        """Whether the one is what is called so, or below it."""
        if section is TYPES:
            return name in self._seen.ontology.ancestors(one)
        seen: set[str] = set()
        current: str | None = one
        while current is not None and current in self._seen.ontology.services and current not in seen:
            if current == name:
                return True
            seen.add(current)
            current = self._seen.ontology.services[current].parent
        return False

    @lasting
    @guarded
    async def move(self, section: Section, name: str, parent: str | None) -> None:
        """Give it another parent."""
        definition = self._seen.definition(section, name)
        if section not in (TYPES, SERVICES) or not isinstance(definition, ObjectType | ServiceType):
            raise InputError(f"{name} has no parent")
        moved = structs.replace(definition, parent=parent)
        change = Define(definitions=by_kind([moved]), author=author(), expected_version=self._seen.version)
        if (version := await self._carried_out(change, f"Move {name} below {parent or 'none'}", "Move")) is not None:
            tell(f"{name} is below {parent or 'none'} now")
            await self._done(section, name, version)

    @lasting
    @guarded
    async def remove(self, section: Section, name: str) -> bool:
        """Show what would break, and remove it if nothing does."""
        change = Define(
            removed=(DefinitionKey(section=Naming(section.key), name=name),), author=author(), expected_version=self._seen.version
        )
        if await self._carried_out(change, f"Remove the {section.one} {name}", "Remove") is None:
            return False
        tell(f"The {section.one} {name} is removed; it can be brought back by Undo")
        return True

    async def _carried_out(self, change: Define, title: str, verb: str) -> int | None:
        """The version that has it; None when the person went back."""
        found = await self._desk.ontology.consider(change)
        if not await confirmed(title, verb, found, change.renamed):
            return None
        return (await self._desk.ontology.change(change)).version

    @lasting
    @guarded
    async def undo(self, event: Event) -> None:
        """Bring back what an event of the history changed."""
        found = await self._desk.ontology.consider_undo(event.version)
        said = f"{person_name(event.author)} changed it: {summary(changed(event.revision, event.renamed))}"
        if await confirmed("Undo", "Undo", found, said=said):
            await self._desk.ontology.undo(event.version, author())
            tell("Undone")

    @lasting
    @guarded
    async def undo_last(self) -> None:
        events = (await self._desk.ontology.history(limit=100)).events
        if (last := last_to_undo(events)) is None:
            tell("There is nothing to undo")
        else:
            await self.undo(last)


def last_to_undo(events: tuple[Event, ...]) -> Event | None:
    """The newest change that was not undone and undid nothing: so undoing again goes further back."""
    undone = {event.undoes for event in events}
    return next((event for event in events if event.undoes is None and event.version not in undone), None)


async def _asked(title: str, label: str, value: str) -> str | None:
    """A line that the person writes; None when they go back."""
    with titled(title) as dialog, ui.card().classes("somrs-onto-dialog somrs-onto-small"):
        Word("h2", title)
        field = ui.input(label, value=value).props("outlined dense autofocus").classes("somrs-onto-full")
        field.on("keydown.enter", lambda: dialog.submit(field.value.strip()))
        _buttons(dialog, "Go on", lambda: field.value.strip())
    answer: str | None = await dialog
    if not dialog.is_deleted:
        dialog.delete()
    return answer


def _buttons(dialog: ui.dialog, verb: str, answer: Callable[[], object]) -> None:
    with ui.row().classes("somrs-onto-buttons"):
        ui.button("Go back", on_click=lambda: dialog.submit(None)).props("flat no-caps")
        ui.button(verb, on_click=lambda: dialog.submit(answer())).props("unelevated no-caps")
