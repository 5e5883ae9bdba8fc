"""Banners that report that a part of the system does not answer."""

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
    """Banner for a part, or for all parts of a kind, by the name in the system overview."""

    def __init__(self, api: LiveApi, part: str) -> None:
        self._part = part
        self._answered_at = time.time()
        self._label = ui.label().classes("somrs-trouble").props('role="status"')
        self._label.visible = False
        follow(api.context.hub, "system", self._begin, self._handle_news)

    async def _begin(self) -> None:
        """Do nothing: the banner stays as it is until news arrive."""

    async def _handle_news(self, news: News) -> None:
        if not isinstance(news.value, SystemView):
            return
        parts = [part for part in news.value.parts if self._part in (part.name, part.kind)]
        silent = [part.name if part.kind else f"The {part.name}" for part in parts if part.milliseconds is None]
        if silent:
            subject = f"{' and '.join(silent)} {'does' if len(silent) == 1 else 'do'}"
            self._label.set_text(f"{subject} not answer. Data from {format_time(self._answered_at)}; updates resume automatically.")
        else:
            self._answered_at = time.time()
        self._label.visible = bool(silent)


class ApiUnavailableBanner:
    """Banner for the API, without which no page is updated."""

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
            self._label.set_text(f"The API does not answer. Data from {format_time(time.time())}; updates resume automatically.")
        self._label.visible = not self._hub.connected
