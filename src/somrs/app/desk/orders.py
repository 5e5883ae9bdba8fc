"""Tasks that are kept to be stated again: templates, and those that recur."""

from __future__ import annotations

from somrs.app.desk.context import Context


class OrdersDesk:
    def __init__(self, context: Context) -> None:
        self._context = context
