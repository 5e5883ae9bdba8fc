"""Tasks that are over: found, read, exported."""

from __future__ import annotations

from somrs.app.desk.context import Context


class RecordsDesk:
    def __init__(self, context: Context) -> None:
        self._context = context
