"""Questions that services put to people, and their answers."""

from __future__ import annotations

from somrs.app.desk.context import Context


class QuestionsDesk:
    def __init__(self, context: Context) -> None:
        self._context = context
