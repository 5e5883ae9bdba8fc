"""Subscriptions of open pages to the API's news."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import background_tasks, ui

from somrs.api.map_news import MapNews
from somrs.api.remote import LiveApi
from somrs.client.hub import Hub, News
from somrs.errors import SomrsError
from somrs.ontology.objects import ValueSet

log = logging.getLogger(__name__)

NewsHandler = Callable[[News], Awaitable[None]]


def follow(hub: Hub, topic: str, begin: Callable[[], Awaitable[None]], hear: NewsHandler) -> None:
    """Call `begin` once the current page is open in its browser, then `hear` with each news of the topic until the page is closed. If
    `begin` fails because a component is unavailable, it is called again with the next news. News waits while the browser is not connected:
    a page that was left is kept for a minute, and updates it for nobody."""
    client = ui.context.client

    async def following() -> None:
        await client.connected()
        with hub.subscribe(topic) as listening:
            await listening.wait_until_followed()
            is_started = await _try_read(topic, begin)
            async for news in listening:
                await client.connected()
                if not is_started:
                    is_started = await _try_read(topic, begin)
                if is_started:
                    await _try_read(topic, partial(hear, news))

    task = background_tasks.create(following(), name=f"follow {topic}", context=client)
    client.on_delete(lambda: task.cancel())


def follow_values(api: LiveApi, path: str, show: Callable[[], None]) -> None:
    """Call `show` when the map is read, and whenever the values of an attribute on it may have changed: with every change of them, and of
    the objects that there are."""

    async def begin() -> None:
        show()

    async def hear(news: News) -> None:
        value = news.value
        if not isinstance(value, MapNews) or value.read or any(not isinstance(c, ValueSet) or c.path == path for c in value.changes):
            show()

    follow(api.context.hub, "map", begin, hear)


async def _try_read(topic: str, read: Callable[[], Awaitable[None]]) -> bool:
    try:
        await read()
    except SomrsError as error:
        log.info("cannot show news of %s: %s", topic, error)
        return False
    return True
