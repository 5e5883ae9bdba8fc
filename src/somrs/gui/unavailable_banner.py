"""A line that says that a part of the system does not answer, as long as that is so."""

from __future__ import annotations

import time

from nicegui import ui

from somrs.api.hub import News
from somrs.api.service import Desk
from somrs.api.system import SystemSeen
from somrs.gui.icons import clock
from somrs.gui.news import follow


class Silence:
    """Of the `part`, as the system's page names it."""

    def __init__(self, desk: Desk, part: str) -> None:
        self._part = part
        self._heard = time.time()
        self._said = ui.label().classes("somrs-trouble").props('role="status"')
        self._said.visible = False
        follow(desk.context.hub, "system", self._begin, self._hear)

    async def _begin(self) -> None:
        """It is as it was until it is heard."""

    async def _hear(self, news: News) -> None:
        if not isinstance(news.value, SystemSeen):
            return
        silent = any(part.name == self._part and part.milliseconds is None for part in news.value.parts)
        if silent:
            self._said.set_text(f"The {self._part} does not answer. This is as it was at {clock(self._heard)}, and goes on by itself.")
        else:
            self._heard = time.time()
        self._said.visible = silent
