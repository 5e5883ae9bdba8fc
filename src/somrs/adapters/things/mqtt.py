"""The connection to an MQTT broker."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from typing import NamedTuple

import aiomqtt

from somrs.adapters.brokers import KEEP_ALIVE, Server, ServerChoice
from somrs.adapters.things.connections import read_password, security
from somrs.adapters.things.connector import FIRST_PAUSE, LONGEST_PAUSE, ConnectionNotes, Listener, why_not_there
from somrs.adapters.things.conversion import Raw
from somrs.adapters.things.messages import payload_text
from somrs.adapters.things.model import Command, Connection, Source
from somrs.errors import InputError

AT_MOST_ONCE, AT_LEAST_ONCE = 0, 1
"""Of messages to things, the broker says that it has them. Messages from things need no such word: a connection loses none, and after
each new connection the broker sends what it retains again."""
RENEWALS = (2.0, 8.0, 30.0)
"""Pauses in seconds after which topics are subscribed again, each once. A broker may retain a message later than it passes it on: NATS does
so by a stream of its own. Who subscribes in between gets it neither way. With each subscription, a broker has to send again what it
retains (3.1.1, 3.8.4)."""


def client_at(connection: Connection, server: Server, will: aiomqtt.Will | None = None) -> aiomqtt.Client:
    """A client of a server of a broker, which is not connected yet, with its files as they are now. Raises InputError if they cannot be
    used."""
    return aiomqtt.Client(
        *server,
        username=connection.user,
        password=read_password(connection),
        tls_context=security(connection),
        keepalive=KEEP_ALIVE,
        will=will,
    )


class RetainedNews:
    """Which messages are news. A broker sends what it retains with each subscription, and does not say of when it is."""

    def __init__(self) -> None:
        self._payloads: dict[str, bytes] = {}
        """The last message of each topic."""
        self._fresh_topics: set[str] = set()
        """Those of which this connection has had a message when it was published: what is retained is the same, or older."""

    def connect(self) -> None:
        """Note that a connection begins: things may have said something meanwhile."""
        self._fresh_topics = set()

    def forget(self, topic: str) -> None:
        """Take the next message of a topic for news."""
        self._payloads.pop(topic, None)
        self._fresh_topics.discard(topic)

    def is_news(self, topic: str, payload: bytes, *, is_retained: bool) -> bool:
        """Whether a message is news, which is not asked twice."""
        if is_retained and (topic in self._fresh_topics or self._payloads.get(topic) == payload):
            return False
        if not is_retained:
            self._fresh_topics.add(topic)
        self._payloads[topic] = payload
        return True


class MqttConnector:
    """A broker. Messages to it wait until it is there."""

    def __init__(self, connection: Connection, listener: Listener) -> None:
        self._connection, self._listener = connection, listener
        self._notes, self._servers = ConnectionNotes(connection), ServerChoice(connection.servers)
        self._topics: dict[str, None] = {}
        self._subscribed: set[str] = set()
        self._news = RetainedNews()
        self._topics_changed = asyncio.Event()
        self._client: aiomqtt.Client | None = None
        self._connected = asyncio.Event()

    def follow(self, source: Source) -> None:
        self.subscribe(source.place)

    def subscribe(self, topic: str) -> None:
        """Receive the messages of a topic, which may have wildcards."""
        self._topics[topic] = None
        self._subscribed.discard(topic)  # whoever follows it now has not heard what is retained
        self._news.forget(topic)
        self._topics_changed.set()

    def unfollow(self, source: Source) -> None:
        self._topics.pop(source.place, None)
        self._topics_changed.set()

    async def run(self) -> None:
        pause = FIRST_PAUSE
        while True:
            try:
                async with client_at(self._connection, self._servers.current) as client:
                    self._notes.note("is connected", is_bad=False)
                    pause = FIRST_PAUSE
                    self._client, self._subscribed = client, set()
                    self._news.connect()
                    self._connected.set()
                    self._listener.reached(self._connection.name, True)
                    await self._serve(client)
            except (aiomqtt.MqttError, OSError, InputError) as error:
                self._notes.note(why_not_there(error, self._connection, is_refused=_is_refusal(error)))
            finally:
                self._connected.clear()
                self._client = None
            self._listener.reached(self._connection.name, False)
            self._servers.lost()
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    async def send(self, command: Command, raw: Raw) -> None:
        await self.publish(command.place, payload_text(raw), retain=command.retain)

    async def publish(self, topic: str, payload: str | bytes, *, retain: bool = False) -> None:
        """Publish, and return when the broker has it."""
        while True:
            await self._connected.wait()
            assert self._client is not None, "a connection has a client"
            try:
                await self._client.publish(topic, payload, qos=AT_LEAST_ONCE, retain=retain)
            except aiomqtt.MqttError:
                await asyncio.sleep(FIRST_PAUSE)  # the connection is being lost; the message goes over the next one
            else:
                return

    async def _serve(self, client: aiomqtt.Client) -> None:
        """Receive messages until the connection ends."""
        subscriber = asyncio.create_task(self._subscribe_all(client))
        try:
            async for message in client.messages:
                payload = message.payload
                if isinstance(payload, bytes) and self._news.is_news(str(message.topic), payload, is_retained=message.retain):
                    self._listener.received((self._connection.name, str(message.topic), None), payload)
        finally:
            subscriber.cancel()
            await asyncio.wait([subscriber])

    async def _subscribe_all(self, client: aiomqtt.Client) -> None:
        renewals: list[_Renewal] = []
        while True:
            self._topics_changed.clear()
            fresh_topics = [topic for topic in self._topics if topic not in self._subscribed]
            stale_topics = [topic for topic in self._subscribed if topic not in self._topics]
            await _subscribe(client, fresh_topics)
            if stale_topics:
                await client.unsubscribe(stale_topics)
            self._subscribed = {*self._subscribed, *fresh_topics} - {*stale_topics}
            now = asyncio.get_running_loop().time()
            renewals += [_Renewal(now + sum(RENEWALS[: number + 1]), fresh_topics) for number in range(len(RENEWALS)) if fresh_topics]
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(min((renewal.due for renewal in renewals), default=None)):
                    await self._topics_changed.wait()
            now = asyncio.get_running_loop().time()
            due_topics = {topic for renewal in renewals if renewal.due <= now for topic in renewal.topics}
            renewals = [renewal for renewal in renewals if renewal.due > now]
            await _subscribe(client, sorted(due_topics & self._subscribed))


def _is_refusal(error: Exception) -> bool:
    """Whether a broker does not accept a user or a password (MQTT 3.1.1, 3.2.2.3, and as paho translates it)."""
    code = error.rc if isinstance(error, aiomqtt.MqttCodeError) else None
    return getattr(code, "value", code) in (4, 5, 134, 135)


class _Renewal(NamedTuple):
    """When topics are subscribed again."""

    due: float
    topics: list[str]


async def _subscribe(client: aiomqtt.Client, topics: Sequence[str]) -> None:
    if topics:
        await client.subscribe([(topic, AT_MOST_ONCE) for topic in topics])
