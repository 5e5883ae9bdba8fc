"""Publish and subscribe within a process, by topic: `map`, `ontology`, `services`, `tasks`, `questions`, and `task ID` for one task.

Each subscription has a queue. A subscriber that does not keep up loses the queued news, and receives news with `missed` instead: it then
reads the subject of the topic again. The feed of a topic runs while the topic has a subscriber.
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
"""Maximum number of news in the queue of a subscription."""


class News(msgspec.Struct, frozen=True, kw_only=True):
    """News of a topic. `missed`: earlier news were lost, and `value` is None."""

    topic: str
    value: object = None
    missed: bool = False


Feed = Callable[[str], Awaitable[None]]
"""Publishes the news of a topic until it is cancelled."""


class NewsSubscription:
    """The queue of a subscriber. `topics`: the topics that it follows."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._waiting: asyncio.Queue[News] = asyncio.Queue()
        self.topics: frozenset[str] = frozenset()

    def follow(self, topics: Iterable[str]) -> None:
        """Follow these topics from now on, and no others."""
        previous_topics, self.topics = self.topics, frozenset(topics)
        self._hub.change_topics(self, previous_topics)

    def own_topics(self) -> frozenset[str]:
        """The topics that no other subscription follows."""
        return self._hub.topics_of(self)

    async def wait_until_followed(self) -> None:
        """Wait until the topics are followed, so that data read afterwards is not older than the first news."""
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
    """Delivers news to subscriptions, in one event loop."""

    def __init__(self) -> None:
        self._subscriptions: dict[str, set[NewsSubscription]] = {}
        self._feeds: dict[str, Feed] = {}
        self._fed: dict[str, asyncio.Task[None]] = {}

    @property
    def topics(self) -> frozenset[str]:
        """The topics that have a subscriber."""
        return frozenset(self._subscriptions)

    def topics_of(self, subscription: NewsSubscription) -> frozenset[str]:
        """The topics that only this subscription follows."""
        return frozenset(topic for topic in subscription.topics if len(self._subscriptions.get(topic, ())) == 1)

    def feed(self, kind: str, feed: Feed) -> None:
        """Register the feed of the topics that begin with `kind`; it runs for a topic while the topic has a subscriber."""
        self._feeds[kind] = feed

    def publish(self, topic: str, value: object = None, *, missed: bool = False) -> None:
        news = News(topic=topic, value=value, missed=missed)
        for listener in self._subscriptions.get(topic, ()):
            listener.enqueue(news)

    @contextmanager
    def subscribe(self, *topics: str) -> Iterator[NewsSubscription]:
        """Subscribe to the topics until the context is left."""
        listener = NewsSubscription(self)
        try:
            listener.follow(topics)
            yield listener
        finally:
            listener.follow(())

    def change_topics(self, listener: NewsSubscription, previous_topics: frozenset[str]) -> None:
        """Begin and end feeds after a subscription has changed its topics."""
        for topic in sorted(listener.topics - previous_topics):
            self._subscriptions.setdefault(topic, set()).add(listener)
            self._begin(topic)
        for topic in sorted(previous_topics - listener.topics):
            self._subscriptions[topic].discard(listener)
            if not self._subscriptions[topic]:
                del self._subscriptions[topic]
                self._end(topic)

    async def wait_until_followed(self, topics: frozenset[str]) -> None:
        """Wait until these topics are followed: here, no time at all. `LiveHub` waits for the API."""

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
