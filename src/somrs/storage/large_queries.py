"""Queries of a map that take long, answered beside the event loop, one after the other."""

from __future__ import annotations

import asyncio

from somrs.errors import RemoteError
from somrs.protocol.messages.knowledge import Rows
from somrs.repository.map_answers import answer_large
from somrs.repository.state import LargeQuery

MOST_WAITING = 16
"""The number of queries that may wait for each other."""


class LargeQueries:
    """Answers queries in a thread: a map is immutable, and the event loop gets the interpreter every few milliseconds."""

    def __init__(self) -> None:
        self._turn = asyncio.Lock()
        self._waiting = 0

    async def answer(self, task: LargeQuery) -> Rows:
        """The answer to the query. Raises FormulaError if it takes too much work, and RemoteError if too many wait."""
        if self._waiting >= MOST_WAITING:
            raise RemoteError(
                f"{MOST_WAITING} queries that take long wait already; ask again later, or with a formula that takes less work"
            )
        self._waiting += 1
        try:
            async with self._turn:
                return await asyncio.to_thread(answer_large, task)
        finally:
            self._waiting -= 1
