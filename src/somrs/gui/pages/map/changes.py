"""All that happened to the map, newest first."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.pages.map.entries import entries
from somrs.gui.shell import guarded

PAGE = 30


class Changes:
    """`look` shows a version on the plan, `undo` undoes one."""

    def __init__(self, desk: LiveApi, look: Callable[[int], Awaitable[None]], undo: Callable[[int], Awaitable[None]]) -> None:
        self._desk, self._look, self._undo = desk, look, undo
        self._list = ui.element("ol").classes("somrs-map-events").props('aria-label="What happened to the map"')
        self._more = ui.button("Show older", on_click=guarded(self._older)).props("flat dense no-caps")
        self._more.visible = False
        self._oldest: int | None = None
        self._newest = -1

    async def refresh(self) -> None:
        """What happened since."""
        if self._newest == self._desk.context.version:
            return
        self._oldest = None
        self._newest = self._desk.context.version
        self._list.clear()
        await self._older()

    async def _older(self) -> None:
        found = await self._desk.map.events(before=self._oldest, limit=PAGE)
        with self._list:
            entries(found.events, self._desk.context.ontology, self._look, self._undo)
            if not found.events and self._oldest is None:
                ui.label("Nothing was changed since the map was given.").classes("somrs-soft")
        if found.events:
            self._oldest = found.events[-1].version
        self._more.visible = found.more
