"""Formulas as people write them: checked while they are typed, and completed."""

from __future__ import annotations

from somrs.app.desk.context import Context


class FormulasDesk:
    def __init__(self, context: Context) -> None:
        self._context = context
