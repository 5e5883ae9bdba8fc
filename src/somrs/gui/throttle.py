"""Changing a page not for every piece of news, but for all that come within a moment."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from nicegui import background_tasks, ui

PAUSE = 0.2
"""Seconds; what happens within is one change of the page."""


class Throttle:
    """Called as often as one likes, it calls the action a moment after the first time, in the page of now, and then is ready again."""

    def __init__(self, action: Callable[[], None], pause: float = PAUSE) -> None:
        self._action, self._pause = action, pause
        self._client = ui.context.client
        self._is_pending = False

    def __call__(self) -> None:
        if not self._is_pending:
            self._is_pending = True
            background_tasks.create(self._run_action(), name="change the page", context=self._client)

    async def _run_action(self) -> None:
        await asyncio.sleep(self._pause)
        self._is_pending = False
        if not self._client.is_deleted:
            self._action()
