"""A line that says that a part of the system does not answer, as long as that is so."""

from __future__ import annotations

import time

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.api.system import SystemView
from somrs.client.hub import News
from somrs.client.live_news import CONNECTION, LiveHub
from somrs.gui.icons import format_time
from somrs.gui.news import follow


class UnavailableBanner:
    """Of the `part`, as the system's page names it."""

    def __init__(self, api: LiveApi, part: str) -> None:
        self._part = part
        self._answered_at = time.time()
        self._label = ui.label().classes("somrs-trouble").props('role="status"')
        self._label.visible = False
        follow(api.context.hub, "system", self._begin, self._handle_news)

    async def _begin(self) -> None:
        """It is as it was until it is heard."""

    async def _handle_news(self, news: News) -> None:
        if not isinstance(news.value, SystemView):
            return
        silent = any(part.name == self._part and part.milliseconds is None for part in news.value.parts)
        if silent:
            self._label.set_text(
                f"The {self._part} does not answer. This is as it was at {format_time(self._answered_at)}, and goes on by itself."
            )
        else:
            self._answered_at = time.time()
        self._label.visible = silent


class ApiUnavailableBanner:
    """Of the API: while it is not there, nothing on any page changes."""

    def __init__(self, hub: LiveHub) -> None:
        self._hub = hub
        self._label = ui.label().classes("somrs-trouble somrs-unreachable").props('role="status"')
        self._label.visible = False
        self._update()
        follow(hub, CONNECTION, self._begin, self._handle_news)

    async def _begin(self) -> None:
        self._update()

    async def _handle_news(self, news: News) -> None:
        self._update()

    def _update(self) -> None:
        if not self._hub.connected and not self._label.visible:
            self._label.set_text(
                f"The API does not answer. What is shown is as it was at {format_time(time.time())}, and goes on by itself."
            )
        self._label.visible = not self._hub.connected
