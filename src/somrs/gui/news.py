"""How a page that is open hears of what happens."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from nicegui import background_tasks, ui

from somrs.api.hub import Hub, News

Hear = Callable[[News], Awaitable[None]]


def follow(hub: Hub, topic: str, begin: Callable[[], Awaitable[None]], hear: Hear) -> None:
    """Have `begin` called once the page of this moment is in its browser, and `hear` with all news of the topic from then on, until the
    page is closed."""
    client = ui.context.client

    async def following() -> None:
        await client.connected()
        with hub.listening(topic) as listening:
            await begin()
            async for news in listening:
                await hear(news)

    task = background_tasks.create(following(), name=f"follow {topic}", context=client)
    client.on_delete(lambda: task.cancel())
