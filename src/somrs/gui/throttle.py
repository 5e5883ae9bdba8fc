"""Combining several pieces of news into one update of a page."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from nicegui import background_tasks, ui

PAUSE = 0.2
"""Seconds; all news within this time make one update."""


class Throttle:
    """A callable that runs the action at most once in each `pause`, in the page in which it was made."""

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
