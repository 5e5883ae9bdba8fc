"""What happened to the ontology: who, when, what was before and what is after; and undoing any of it."""

from __future__ import annotations

from datetime import datetime

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.pages.ontology.actions import Actions
from somrs.gui.pages.ontology.changes import changed
from somrs.gui.pages.ontology.consequences import revision
from somrs.gui.pages.ontology.pieces import Word, lasting, note, titled
from somrs.gui.pages.ontology.sections import Section
from somrs.gui.shell import guarded
from somrs.protocol.messages.knowledge import Event
from somrs.protocol.messages.people import person_name

PAGE = 40
"""So many events are shown at once."""


class Past:
    """The history as a dialog: all of it, or of one definition."""

    def __init__(self, desk: LiveApi, actions: Actions) -> None:
        self._desk, self._actions = desk, actions
        self.client = ui.context.client

    @lasting
    @guarded
    async def show(self, section: Section | None = None, name: str = "") -> None:
        title = f"History of {name}" if section is not None else "History of the ontology"
        with titled(title) as dialog, ui.card().classes("somrs-onto-dialog"):
            with ui.row().classes("somrs-onto-head"):
                Word("h2", title)
                ui.space()
                ui.button(icon="close", on_click=dialog.close).props('flat round dense aria-label="Close"')
            body = ui.element("ol").classes("somrs-onto-past somrs-onto-dialog-body")
            foot = ui.element("div")
        dialog.on("hide", dialog.delete)
        dialog.open()
        await self._more(body, foot, section, name, None, dialog)

    async def _more(
        self, body: ui.element, foot: ui.element, section: Section | None, name: str, before: int | None, dialog: ui.dialog
    ) -> None:
        found = await self._desk.ontology.history(before=before, limit=PAGE)
        shown = []
        for event in found.events:
            revised = changed(event.revision, event.renamed)
            if section is not None and not any(one.section is section and name in (one.name, one.old_name) for one in revised):
                continue
            shown.append(event)
            name = next((one.old_name for one in revised if one.section is section and one.name == name), name)
        undone = {event.undoes for event in found.events}
        with body:
            for event in shown:
                self._entry(event, event.version in undone, dialog)
        foot.clear()
        with foot:
            if found.more:
                last = found.events[-1].version
                more = guarded(lambda: self._more(body, foot, section, name, last, dialog))
                ui.button("Show older", on_click=more).props("flat no-caps")
            elif not shown and before is None:
                note("Nothing was changed since the system was set up.")

    def _entry(self, event: Event, undone: bool, dialog: ui.dialog) -> None:
        at = datetime.fromtimestamp(event.at)
        with ui.element("li"):
            with ui.element("div").classes("somrs-onto-head"):
                Word("b", person_name(event.author))
                Word("time", f"{at:%H:%M:%S}" if at.date() == datetime.now().date() else f"{at:%d %b %Y, %H:%M}", "somrs-soft").props(
                    f'datetime="{at.isoformat()}"'
                )
                Word("span", f"version {event.version}", "somrs-soft")
                if event.undoes is not None:
                    Word("span", f"undid version {event.undoes}", "somrs-onto-verb")
                ui.space()
                if undone:
                    Word("span", "undone", "somrs-onto-verb")
                else:

                    async def undo() -> None:
                        dialog.close()
                        await self._actions.undo(event)

                    button = ui.button("Undo", icon="undo", on_click=undo).props("flat dense no-caps")
                    button.props(f'aria-label="Undo version {event.version}"')
            revised = changed(event.revision, event.renamed)
            if revised:
                revision(revised)
            else:
                note("What changed is too long to be told here.")
