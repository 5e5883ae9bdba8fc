"""Tasks that a test submits and follows to their end."""

from __future__ import annotations

import asyncio

from somrs.client.client import Client
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from tests.support.hang import HANG_TIME


async def finished(client: Client, task: str) -> TaskView:
    """The task at its end."""
    view: TaskView | None = None
    async for news in client.news(task):
        view = news.view
    assert view is not None
    return view


async def accomplish(client: Client, effect: str, *, waits: bool = True) -> TaskView:
    """The task with this effect at its end, whatever that is."""
    return await asyncio.wait_for(finished(client, await client.submit(Submit(effect=effect, waits=waits))), HANG_TIME)
