"""The entries of the audit log on a page: who changed what, and what was denied to whom, newest first."""

from __future__ import annotations

from nicegui import ui

from somrs.access.auditor import DENIED, DONE, actor_text, detail_text
from somrs.api.remote import LiveApi
from somrs.gui.icons import Badge, Sign, format_time
from somrs.gui.shell import guarded
from somrs.storage.audit_log import AuditEntry

PAGE = 20
"""Entries that are shown at once."""

_SIGNS = {DONE: Sign("check_circle", "Done", "good"), DENIED: Sign("block", "Denied", "bad")}
_FAILED = Sign("error", "Failed", "bad")


class AuditList:
    """The entries, with a button for earlier ones."""

    def __init__(self, api: LiveApi) -> None:
        self._api = api
        self._oldest_number: int | None = None
        self._rows = ui.element("div")
        self._earlier = ui.button("Earlier entries", on_click=guarded(self.show_more)).props("flat no-caps")

    async def show_more(self) -> None:
        """Show the next entries below those that are shown."""
        page = await self._api.access.audit(limit=PAGE, before=self._oldest_number)
        with self._rows:
            for entry in page.entries:
                self._build(entry)
                self._oldest_number = entry.number
            if self._oldest_number is None:
                ui.label("Nothing was done yet.").classes("somrs-soft")
        self._earlier.visible = page.more

    def _build(self, entry: AuditEntry) -> None:
        with ui.element("div").classes("somrs-access-row").props(f'role="group" aria-label="Entry {entry.number}"'):
            ui.label(actor_text(entry.actor)).classes("somrs-access-name")
            Badge(_SIGNS.get(entry.outcome, _FAILED))
            ui.label(entry.act)
            ui.label(format_time(entry.moment)).classes("somrs-soft somrs-access-time")
            ui.label(detail_text(entry.details)).classes("somrs-soft")
