"""News as they happen, by topic: `map`, `ontology`, `services`, `tasks`, `questions`, and `task ID` for one task.

Whoever listens has a queue; one who does not keep up loses what is in it, and hears so: then read again what the topic is about. What has
to be asked for is asked for only while somebody listens.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import contextmanager

import msgspec

log = logging.getLogger(__name__)

MOST_WAITING = 1000
"""News that wait for one listener."""


class News(msgspec.Struct, frozen=True, kw_only=True):
    """What happened to the topic; None after something was `missed`."""

    topic: str
    value: object = None
    missed: bool = False


Feed = Callable[[str], Awaitable[None]]
"""Publishes what happens to a topic, until it is cancelled."""


class Listening:
    """What one listener has not heard yet."""

    def __init__(self) -> None:
        self._waiting: asyncio.Queue[News] = asyncio.Queue()

    def put(self, news: News) -> None:
        if self._waiting.qsize() >= MOST_WAITING:
            topics = {news.topic}
            while not self._waiting.empty():
                topics.add(self._waiting.get_nowait().topic)
            for topic in sorted(topics):
                self._waiting.put_nowait(News(topic=topic, missed=True))
        else:
            self._waiting.put_nowait(news)

    async def next(self) -> News:
        return await self._waiting.get()

    async def __aiter__(self) -> AsyncIterator[News]:
        while True:
            yield await self._waiting.get()


class Hub:
    """Brings news to those who listen. Everything runs in one event loop."""

    def __init__(self) -> None:
        self._listening: dict[str, set[Listening]] = {}
        self._feeds: dict[str, Feed] = {}
        self._fed: dict[str, asyncio.Task[None]] = {}

    def feed(self, kind: str, feed: Feed) -> None:
        """Where the news of topics come from whose first word is `kind`: run while somebody listens to one."""
        self._feeds[kind] = feed

    def publish(self, topic: str, value: object = None, *, missed: bool = False) -> None:
        news = News(topic=topic, value=value, missed=missed)
        for listener in self._listening.get(topic, ()):
            listener.put(news)

    @contextmanager
    def listening(self, *topics: str) -> Iterator[Listening]:
        """The news of the topics from now on."""
        listener = Listening()
        for topic in topics:
            self._listening.setdefault(topic, set()).add(listener)
            self._begin(topic)
        try:
            yield listener
        finally:
            for topic in topics:
                self._listening[topic].discard(listener)
                if not self._listening[topic]:
                    del self._listening[topic]
                    self._end(topic)

    def _begin(self, topic: str) -> None:
        feed = self._feeds.get(topic.partition(" ")[0])
        if feed is not None and topic not in self._fed:
            self._fed[topic] = asyncio.create_task(self._feeding(feed, topic))

    async def _feeding(self, feed: Feed, topic: str) -> None:
        try:
            await feed(topic)
        except Exception:  # a defect in one feed must not end the others, nor be silent
            log.exception("the news of %s ended", topic)
            self.publish(topic, missed=True)

    def _end(self, topic: str) -> None:
        if (fed := self._fed.pop(topic, None)) is not None:
            fed.cancel()

    async def close(self) -> None:
        for fed in self._fed.values():
            fed.cancel()
        for fed in self._fed.values():
            with contextlib.suppress(asyncio.CancelledError):
                await fed
        self._fed.clear()
