"""A line that says that a part of the system does not answer, as long as that is so."""

from __future__ import annotations

import time

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.api.system import SystemView
from somrs.client.hub import News
from somrs.client.live_news import CONNECTION, LiveHub
from somrs.gui.icons import clock
from somrs.gui.news import follow


class Silence:
    """Of the `part`, as the system's page names it."""

    def __init__(self, desk: LiveApi, part: str) -> None:
        self._part = part
        self._heard = time.time()
        self._said = ui.label().classes("somrs-trouble").props('role="status"')
        self._said.visible = False
        follow(desk.context.hub, "system", self._begin, self._hear)

    async def _begin(self) -> None:
        """It is as it was until it is heard."""

    async def _hear(self, news: News) -> None:
        if not isinstance(news.value, SystemView):
            return
        silent = any(part.name == self._part and part.milliseconds is None for part in news.value.parts)
        if silent:
            self._said.set_text(f"The {self._part} does not answer. This is as it was at {clock(self._heard)}, and goes on by itself.")
        else:
            self._heard = time.time()
        self._said.visible = silent


class Unreachable:
    """Of the API: while it is not there, nothing on any page changes."""

    def __init__(self, hub: LiveHub) -> None:
        self._hub = hub
        self._said = ui.label().classes("somrs-trouble somrs-unreachable").props('role="status"')
        self._said.visible = False
        self._turn()
        follow(hub, CONNECTION, self._begin, self._hear)

    async def _begin(self) -> None:
        self._turn()

    async def _hear(self, news: News) -> None:
        self._turn()

    def _turn(self) -> None:
        if not self._hub.connected and not self._said.visible:
            self._said.set_text(f"The API does not answer. What is shown is as it was at {clock(time.time())}, and goes on by itself.")
        self._said.visible = not self._hub.connected
