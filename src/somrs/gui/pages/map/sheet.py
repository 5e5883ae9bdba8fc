"""The selected object: type, attributes, relations, who discovered it, and history; renaming, identifying and removing it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.author import author
from somrs.gui.pages.map.change_text import format_time
from somrs.gui.pages.map.entries import list_note, show_events
from somrs.gui.pages.map.form import ObjectForm
from somrs.gui.pages.map.merging import MergeDialog
from somrs.gui.pages.map.object_drafts import ObjectDrafts
from somrs.gui.pages.map.relations import Relations
from somrs.gui.shell import guarded, notify
from somrs.ontology.objects import Change, objects_of
from somrs.protocol.messages.knowledge import Event, History, RenameObject
from somrs.protocol.messages.people import person_name

_HISTORY = 25


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetActions:
    """The page's actions for the sheet: open another object, change the map, remove the object, show it on the plan, show a version, undo
    one. `record_version` is called with each version that the sheet made."""

    open_object: Callable[[str | None], None]
    change: Callable[[tuple[Change, ...], str], Awaitable[int | None]]
    remove: Callable[[str], Awaitable[None]]
    show_on_plan: Callable[[str], None]
    show_version: Callable[[int], Awaitable[None]]
    undo: Callable[[int], Awaitable[None]]
    record_version: Callable[[int], None]


class Sheet:
    """The sheet of one object, added to the current element."""

    def __init__(self, api: LiveApi, name: str, actions: SheetActions, drafts: ObjectDrafts) -> None:
        self._api, self.name, self._actions = api, name, actions
        self._relations: Relations | None = None
        self._form: ObjectForm | None = None
        self._history_version = -1
        self._events: tuple[Event, ...] = ()
        object = api.context.map.objects.get(name)
        if object is None:
            self._show_missing()
            return
        self._heading(object.type)
        self._discovery = ui.element("div")
        ui.timer(0, guarded(self._show_discovery), once=True)
        self._form = ObjectForm(api, object, drafts, actions.record_version)
        with ui.element("section").classes("somrs-map-part").props('aria-label="Relations"'):
            ui.label("Relations").classes("somrs-map-head")
            self._relations = Relations(api, name, actions.change, actions.open_object)
        with ui.expansion(
            "History", icon="history", on_value_change=lambda event: self._on_history_toggle(bool(event.value))
        ) as self._history:
            self._history.classes("somrs-map-history").props("dense")
            self._event_list = ui.element("ol").classes("somrs-map-events")

    @property
    def dirty(self) -> bool:
        return self._form is not None and self._form.dirty

    def _show_missing(self) -> None:
        with ui.element("div").classes("somrs-map-clash somrs-map-gone").props('role="alert"'):
            ui.icon("help_outline").props('aria-hidden="true"')
            ui.label(f"There is no {self.name} on the map. It may have been removed or renamed.")
        ui.button("Close", on_click=lambda: self._actions.open_object(None)).props("flat dense no-caps")

    def _heading(self, type_name: str) -> None:
        with ui.element("div").classes("somrs-map-title"):
            ui.label(self.name).classes("somrs-title").props('role="heading" aria-level="2"')
            ui.link(type_name, f"/ontology?type={type_name}").classes("somrs-map-type").tooltip("The type, in the ontology")
            ui.space()
            # Devices join under their own names.
            is_device = self._api.context.ontology.is_device(type_name)
            identify = () if is_device else (("merge", "It is another object", guarded(self._merge)),)
            for icon, label, action in (
                ("center_focus_strong", "Show on the plan", lambda: self._actions.show_on_plan(self.name)),
                ("drive_file_rename_outline", "Rename it", guarded(self._rename)),
                *identify,
                ("delete", "Remove it", guarded(lambda: self._actions.remove(self.name))),
                ("close", "Close", lambda: self._actions.open_object(None)),
            ):
                ui.button(icon=icon, on_click=action).props(f'flat round dense size=sm aria-label="{label}"').tooltip(label)

    async def apply_changes(self, changes: tuple[Change, ...], version: int) -> None:
        """Update the sheet after changes of the map. Without changes, everything may have changed."""
        if self._form is None or (changes and not any(self.name in objects_of(change) for change in changes)):
            return
        await self._form.apply_changes(self._api.context.map.objects.get(self.name), changes, version)
        if self._relations is not None:
            self._relations.refresh()
        if self._history.value:
            await self._show_history()

    # History

    async def _on_history_toggle(self, opened: bool) -> None:
        if opened:
            await guarded(self._show_history)()

    async def _show_history(self) -> None:
        if self._history_version == self._api.context.version:
            return
        self._history_version = self._api.context.version
        # As many as are shown: the earlier ones stay when news comes.
        self._show_events(await self._api.map.history(self.name, limit=max(_HISTORY, len(self._events))), ())

    async def _show_earlier(self) -> None:
        page = await self._api.map.history(self.name, limit=_HISTORY, before=self._events[-1].version)
        self._show_events(page, self._events)

    def _show_events(self, page: History, later_events: tuple[Event, ...]) -> None:
        self._events = (*later_events, *page.events)
        self._event_list.clear()
        with self._event_list:
            show_events(self._events, self._api.context.ontology, self._actions.show_version, self._actions.undo)
            if not self._events:
                list_note("No changes since the map was loaded.")
            if page.more:
                with ui.element("li"):
                    ui.button("Earlier changes", icon="expand_more", on_click=guarded(self._show_earlier)).props("flat dense no-caps")

    # Discovery

    async def _show_discovery(self) -> None:
        """Who put the object on the map by a sighting."""
        discovered = (await self._api.map.history(self.name, limit=1)).discovered
        if discovered is None:
            return
        with self._discovery.classes("somrs-map-discovery"):
            ui.icon("travel_explore").props('aria-hidden="true"')
            ui.label(f"Discovered by {person_name(discovered.author)}, {format_time(discovered.at)}")
            if not discovered.confirmed:
                ui.button("Which object is it?", on_click=guarded(self._merge)).props("flat dense no-caps").classes("somrs-map-link")

    async def _merge(self) -> None:
        if (result := await MergeDialog(self._api, self.name).ask()) is not None:
            version, name = result
            self._actions.record_version(version)
            self._actions.open_object(name)

    # Renaming

    async def _rename(self) -> None:
        title = f"Rename {self.name}"
        with ui.dialog().props(f'aria-label="{title}"') as dialog, ui.card().classes("somrs-map-dialog"):
            ui.label(title).classes("somrs-title")
            with ui.element("form").props("novalidate").classes("somrs-map-form") as form:
                field = ui.input("New name", value=self.name).props("outlined dense autofocus autocomplete=off hide-bottom-space")
                with ui.element("div").classes("somrs-map-buttons"):
                    ui.button("Rename", icon="check").props("unelevated no-caps type=submit")
                    ui.button("Cancel", on_click=dialog.close).props("flat no-caps")
            form.on("submit.prevent", lambda: dialog.submit(str(field.value or "").strip()))
        dialog.on("hide", dialog.delete)
        new_name = await dialog
        if new_name and new_name != self.name:
            result = await self._api.map.rename(RenameObject(name=self.name, to=str(new_name), author=author()))
            notify(f"{self.name} renamed to {new_name}")
            self._actions.record_version(result.version)
            self._actions.open_object(str(new_name))
