"""The history of the ontology: time, author, old and new definitions; and undo."""

from __future__ import annotations

from datetime import datetime

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.pages.ontology.actions import Actions
from somrs.gui.pages.ontology.changes import definition_changes
from somrs.gui.pages.ontology.consequences import show_revision
from somrs.gui.pages.ontology.elements import TextTag, in_page_context, note, titled_dialog
from somrs.gui.pages.ontology.sections import Section
from somrs.gui.shell import guarded
from somrs.protocol.messages.knowledge import Event
from somrs.protocol.messages.people import person_name

PAGE = 40
"""Events per page."""


class HistoryDialog:
    """A dialog with the history of the ontology or of one definition."""

    def __init__(self, api: LiveApi, actions: Actions) -> None:
        self._api, self._actions = api, actions
        self.client = ui.context.client

    @in_page_context
    @guarded
    async def open_history(self, section: Section | None = None, name: str = "") -> None:
        title = f"History of {name}" if section is not None else "History of the ontology"
        with titled_dialog(title) as dialog, ui.card().classes("somrs-onto-dialog"):
            with ui.row().classes("somrs-onto-head"):
                TextTag("h2", title)
                ui.space()
                ui.button(icon="close", on_click=dialog.close).props('flat round dense aria-label="Close"')
            body = ui.element("ol").classes("somrs-onto-past somrs-onto-dialog-body")
            foot = ui.element("div")
        dialog.on("hide", dialog.delete)
        dialog.open()
        await self._load_page(body, foot, section, name, None, dialog)

    async def _load_page(
        self, body: ui.element, foot: ui.element, section: Section | None, name: str, before_version: int | None, dialog: ui.dialog
    ) -> None:
        page = await self._api.ontology.history(before=before_version, limit=PAGE)
        shown_events = []
        for event in page.events:
            changes = definition_changes(event.revision, event.renamed)
            if section is not None and not any(change.section is section and name in (change.name, change.old_name) for change in changes):
                continue
            shown_events.append(event)
            name = next((change.old_name for change in changes if change.section is section and change.name == name), name)
        undone_versions = {event.undoes for event in page.events}
        with body:
            for event in shown_events:
                self._entry(event, event.version in undone_versions, dialog)
        foot.clear()
        with foot:
            if page.more:
                last_version = page.events[-1].version
                load_older = guarded(lambda: self._load_page(body, foot, section, name, last_version, dialog))
                ui.button("Show older", on_click=load_older).props("flat no-caps")
            elif not shown_events and before_version is None:
                note("No changes since the system was set up.")

    def _entry(self, event: Event, is_undone: bool, dialog: ui.dialog) -> None:
        event_time = datetime.fromtimestamp(event.at)
        with ui.element("li"):
            with ui.element("div").classes("somrs-onto-head"):
                TextTag("b", person_name(event.author))
                TextTag(
                    "time",
                    f"{event_time:%H:%M:%S}" if event_time.date() == datetime.now().date() else f"{event_time:%d %b %Y, %H:%M}",
                    "somrs-soft",
                ).props(f'datetime="{event_time.isoformat()}"')
                TextTag("span", f"version {event.version}", "somrs-soft")
                if event.undoes is not None:
                    TextTag("span", f"undid version {event.undoes}", "somrs-onto-verb")
                ui.space()
                if is_undone:
                    TextTag("span", "undone", "somrs-onto-verb")
                else:

                    async def undo() -> None:
                        dialog.close()
                        await self._actions.undo(event)

                    button = ui.button("Undo", icon="undo", on_click=undo).props("flat dense no-caps")
                    button.props(f'aria-label="Undo version {event.version}"')
            changes = definition_changes(event.revision, event.renamed)
            if changes:
                show_revision(changes)
            else:
                note("The change is too long to be shown here.")
