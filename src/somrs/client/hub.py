"""News as they happen, by topic: `map`, `ontology`, `services`, `tasks`, `questions`, and `task ID` for one task.

Whoever listens has a queue; one who does not keep up loses what is in it, and hears so: then read again what the topic is about. What has
to be asked for is asked for only while somebody listens.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator
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


class NewsSubscription:
    """What one listener has not heard yet. `topics`: those of which it hears."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._waiting: asyncio.Queue[News] = asyncio.Queue()
        self.topics: frozenset[str] = frozenset()

    def follow(self, topics: Iterable[str]) -> None:
        """Hear of these topics from now on, and of no others."""
        previous_topics, self.topics = self.topics, frozenset(topics)
        self._hub.change_topics(self, previous_topics)

    async def wait_until_followed(self) -> None:
        """Return when nothing that happens to the topics is missed any more: what is read from now on is not older than the news."""
        await self._hub.wait_until_followed(self.topics)

    def enqueue(self, news: News) -> None:
        if self._waiting.qsize() >= MOST_WAITING:
            topics = {news.topic}
            while not self._waiting.empty():
                topics.add(self._waiting.get_nowait().topic)
            for topic in sorted(topics):
                self._waiting.put_nowait(News(topic=topic, missed=True))
        else:
            self._waiting.put_nowait(news)

    async def next_news(self) -> News:
        return await self._waiting.get()

    async def __aiter__(self) -> AsyncIterator[News]:
        while True:
            yield await self._waiting.get()


class Hub:
    """Brings news to those who listen. Everything runs in one event loop."""

    def __init__(self) -> None:
        self._subscriptions: dict[str, set[NewsSubscription]] = {}
        self._feeds: dict[str, Feed] = {}
        self._fed: dict[str, asyncio.Task[None]] = {}

    @property
    def topics(self) -> frozenset[str]:
        """Those that somebody listens to."""
        return frozenset(self._subscriptions)

    def feed(self, kind: str, feed: Feed) -> None:
        """Where the news of topics come from whose first word is `kind`: run while somebody listens to one."""
        self._feeds[kind] = feed

    def publish(self, topic: str, value: object = None, *, missed: bool = False) -> None:
        news = News(topic=topic, value=value, missed=missed)
        for listener in self._subscriptions.get(topic, ()):
            listener.enqueue(news)

    @contextmanager
    def subscribe(self, *topics: str) -> Iterator[NewsSubscription]:
        """The news of the topics from now on."""
        listener = NewsSubscription(self)
        try:
            listener.follow(topics)
            yield listener
        finally:
            listener.follow(())

    def change_topics(self, listener: NewsSubscription, previous_topics: frozenset[str]) -> None:
        """The listener has other topics than before."""
        for topic in sorted(listener.topics - previous_topics):
            self._subscriptions.setdefault(topic, set()).add(listener)
            self._begin(topic)
        for topic in sorted(previous_topics - listener.topics):
            self._subscriptions[topic].discard(listener)
            if not self._subscriptions[topic]:
                del self._subscriptions[topic]
                self._end(topic)

    async def wait_until_followed(self, topics: frozenset[str]) -> None:
        """Return when nothing that happens to these topics is missed any more: here, at once."""

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
