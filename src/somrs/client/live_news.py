"""The news of an API in another process: a hub fed by one WebSocket, which reconnects when the connection is lost."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from typing import Any, Protocol

import aiohttp
import msgspec

from somrs.client.api_client import ApiClient
from somrs.client.hub import Hub, News
from somrs.errors import RemoteError, SomrsError

log = logging.getLogger(__name__)

CONNECTION = "connection"
"""The local topic for the state of the connection to the API: True or False."""

RETRY_DELAYS = (0.2, 0.5, 1.0, 2.0)
"""Seconds before each attempt to reconnect; the last value applies to all further attempts."""

SIGN_OF_LIFE = 10.0
"""Seconds between two WebSocket pings."""

MOST_BYTES = 64 * 2**20
"""Maximum size of a message."""


class Follow(msgspec.Struct, frozen=True, kw_only=True):
    """The client's message at `live`: follow these topics from now on, and no others. If `confirm` is a number, the server replies with
    `Confirmed` and this number when the topics are followed. To topics that do not exist, it first replies with an `ErrorReport`, and
    follows the others."""

    follow: tuple[str, ...]
    confirm: int | None = None


class Confirmed(msgspec.Struct, frozen=True, kw_only=True):
    """The server's reply: the topics of the request with this number are followed."""

    confirmed: int


class ServerMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A message of the server at `live`: news, a confirmation, or a problem."""

    topic: str = ""
    value: msgspec.Raw = msgspec.Raw(b"null")
    missed: bool = False
    confirmed: int | None = None
    problem: str = ""


class Copy(Protocol):
    """Local data that is updated with the news before they are published."""

    async def read(self) -> None:
        """Read all data again, since anything may have changed."""

    async def apply_news(self, news: News) -> None: ...


class LiveHub(Hub):
    """A hub that follows its topics at the API: those with a subscriber, and `always` those that `copy` needs.

    `types`: the possible types of the values, by the first part of the topic; the first type that fits is used. After an interruption of
    the connection, every topic publishes news with `missed`.
    """

    def __init__(self, api: ApiClient, types: Mapping[str, tuple[Any, ...]], copy: Copy, always: frozenset[str]) -> None:
        super().__init__()
        self._api, self._types, self._copy, self._always = api, types, copy, always
        self._changed = asyncio.Event()
        self._turned = asyncio.Event()
        self._followed: frozenset[str] | None = None
        """The topics that the API has confirmed; None without a connection."""
        self._last_request: tuple[int, frozenset[str]] = (0, frozenset())
        self.connected = False

    @property
    def topics(self) -> frozenset[str]:
        return (super().topics | self._always) - {CONNECTION}

    async def wait_until_followed(self, topics: frozenset[str]) -> None:
        """Wait until the API has confirmed these topics.

        Return at once without a connection: the topics publish news with `missed` when it has been restored.
        """
        while self._followed is not None and not topics - {CONNECTION} <= self._followed:
            turned = self._turned
            await turned.wait()

    def _begin(self, topic: str) -> None:
        self._changed.set()

    def _end(self, topic: str) -> None:
        if self._followed is not None:
            self._followed -= {topic}
        self._changed.set()

    async def run(self) -> None:
        """Receive and publish news until cancelled; reconnect when the connection is lost."""
        attempt = 0
        while True:
            try:
                async with self._api.session.ws_connect(
                    f"{self._api.url}/live",
                    headers=self._api.headers,
                    heartbeat=SIGN_OF_LIFE,
                    max_msg_size=MOST_BYTES,
                    timeout=aiohttp.ClientWSTimeout(ws_close=1.0),
                ) as socket:
                    attempt = 0
                    await self._hear(socket)
            except (aiohttp.ClientError, TimeoutError, OSError, SomrsError) as error:
                log.info("no news from %s: %s", self._api.url, error)
            finally:
                self._turn(None)
                self._set_connected(connected=False)
            await asyncio.sleep(RETRY_DELAYS[min(attempt, len(RETRY_DELAYS) - 1)])
            attempt += 1

    async def _hear(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._turn(frozenset())
        sender = asyncio.create_task(self._ask(socket))
        try:
            async for message in socket:
                if message.type is not aiohttp.WSMsgType.TEXT:
                    break
                server_message = msgspec.json.decode(message.data, type=ServerMessage)
                number, topics = self._last_request
                if server_message.problem:
                    log.warning("%s: %s", self._api.url, server_message.problem)
                elif server_message.confirmed is None:
                    await self._apply_message(server_message)
                elif server_message.confirmed == number and self.connected:
                    self._turn(topics)
                elif server_message.confirmed == number:
                    await self._start_following(topics)
        finally:
            sender.cancel()

    async def _start_following(self, topics: frozenset[str]) -> None:
        """Read all data after the first confirmation on a new connection, and publish that earlier news may be lost."""
        await self._copy.read()
        self._turn(topics)
        self._set_connected(connected=True)
        for topic in sorted(topics):
            self.publish(topic, missed=True)

    async def _ask(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        """Send the topics to follow whenever they change."""
        while True:
            self._changed.clear()
            self._last_request = number, topics = self._last_request[0] + 1, self.topics
            await socket.send_str(msgspec.json.encode(Follow(follow=tuple(sorted(topics)), confirm=number)).decode())
            await self._changed.wait()

    async def _apply_message(self, server_message: ServerMessage) -> None:
        news = News(topic=server_message.topic, value=self._value(server_message), missed=server_message.missed)
        await self._copy.apply_news(news)
        self.publish(news.topic, news.value, missed=news.missed)

    def _value(self, server_message: ServerMessage) -> object:
        if bytes(server_message.value) == b"null":
            return None
        for type in self._types.get(server_message.topic.partition(" ")[0], ()):
            try:
                return msgspec.json.decode(server_message.value, type=type)
            except msgspec.ValidationError:
                continue
        raise RemoteError(f"the API sent news of {server_message.topic} that this client does not understand; is its version different?")

    def _turn(self, followed: frozenset[str] | None) -> None:
        self._followed = followed
        self._turned.set()
        self._turned = asyncio.Event()

    def _set_connected(self, *, connected: bool) -> None:
        if connected != self.connected:
            self.connected = connected
            self.publish(CONNECTION, connected)
