"""The history of the map, newest first."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.pages.map.entries import list_note, show_events
from somrs.gui.shell import guarded

_PAGE = 30


class ChangeList:
    """`show_version` shows a version on the plan; `undo` undoes it."""

    def __init__(self, api: LiveApi, show_version: Callable[[int], Awaitable[None]], undo: Callable[[int], Awaitable[None]]) -> None:
        self._api, self._show_version, self._undo = api, show_version, undo
        self._list = ui.element("ol").classes("somrs-map-events").props('aria-label="Changes of the map"')
        self._older_button = ui.button("Show older", on_click=guarded(self._load_older)).props("flat dense no-caps")
        self._older_button.visible = False
        self._oldest: int | None = None
        self._newest = -1

    async def refresh(self) -> None:
        """Add the events since the last call."""
        if self._newest == self._api.context.version:
            return
        self._oldest = None
        self._newest = self._api.context.version
        self._list.clear()
        await self._load_older()

    async def _load_older(self) -> None:
        event_page = await self._api.map.events(before=self._oldest, limit=_PAGE)
        with self._list:
            show_events(event_page.events, self._api.context.ontology, self._show_version, self._undo)
            if not event_page.events and self._oldest is None:
                list_note("No changes since the map was loaded.")
        if event_page.events:
            self._oldest = event_page.events[-1].version
        self._older_button.visible = event_page.more
