"""News for pages that are open, and for those that their browsers have left or lost."""

from __future__ import annotations

import asyncio

import pytest
from nicegui import Client, core, ui
from starlette.requests import Request

from somrs.client.hub import Hub, News
from somrs.gui.news import follow


class FollowingPage:
    """A page that follows a topic, and what it has heard. `is_begun`: it has read the subject of the topic."""

    def __init__(self, hub: Hub) -> None:
        self.client = Client(
            ui.page("/following", reconnect_timeout=60),
            request=Request({"type": "http", "method": "GET", "path": "/following", "headers": []}),
        )
        self.is_begun = False
        self.heard: list[object] = []
        with self.client:
            follow(hub, "map", self._begin, self._hear)

    async def _begin(self) -> None:
        self.is_begun = True

    async def _hear(self, news: News) -> None:
        self.heard.append(news.value)

    async def open(self, socket: str) -> None:
        await self.client.handle_handshake(socket, "tab", None, "document", None)
        await settle()

    async def leave(self, socket: str) -> None:
        self.client.handle_disconnect(socket)
        await settle()


async def settle() -> None:
    """Let all tasks run that have nothing to wait for."""
    for _ in range(20):
        await asyncio.sleep(0)


def test_a_page_that_was_left_is_not_updated_and_hears_all_when_its_browser_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    async def play() -> None:
        monkeypatch.setattr(core, "loop", asyncio.get_running_loop())  # as NiceGUI does when its server starts
        hub = Hub()
        page = FollowingPage(hub)
        await settle()
        assert not page.is_begun
        await page.open("first socket")
        assert page.is_begun
        hub.publish("map", 1)
        await settle()
        assert page.heard == [1]
        await page.leave("first socket")
        for version in (2, 3):
            hub.publish("map", version)
            await settle()
        assert page.heard == [1]
        await page.open("second socket")
        assert page.heard == [1, 2, 3]
        page.client.delete()

    asyncio.run(play())
