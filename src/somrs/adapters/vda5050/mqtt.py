"""A connection to an MQTT broker that comes back whenever it is lost."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import ssl
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import aiomqtt
from msgspec import Struct

from somrs.adapters.brokers import KEEP_ALIVE, Server, ServerChoice, read_broker_url
from somrs.errors import UsageError
from somrs.ontology.files.documents import Entry

log = logging.getLogger(__name__)

PASSWORD = "SOMRS_MQTT_PASSWORD"
"""The environment variable with the password at the broker."""

PAUSE = 2.0
"""Seconds between two attempts to connect."""


class Certificates(Entry):
    """Files in PEM, from the folder of the site file. `authority`: who signed the broker's certificate; None: the authorities of the
    system. `certificate`, `key`: of this program, if the broker wants one."""

    authority: str | None = None
    certificate: str | None = None
    key: str | None = None


class BrokerAddress(Struct, frozen=True, kw_only=True):
    """Where a broker is: at one of the servers. `security`: the context for TLS, with the files as they are now; None: without TLS."""

    servers: tuple[Server, ...]
    user: str | None = None
    password: str | None = None
    security: Callable[[], ssl.SSLContext] | None = None


def broker_address(url: str, certificates: Certificates, folder: Path) -> BrokerAddress:
    """Read `mqtt://host:port` or `mqtts://user@host:port`; of several servers, separated by commas. Raises UsageError."""
    try:
        broker = read_broker_url(url)
    except ValueError as error:
        raise UsageError(f"{error}: write mqtt://HOST:PORT, or mqtts://USER@HOST:PORT with TLS") from None
    if broker.has_password:
        raise UsageError(f"the address of the broker has a password: take it out, and set {PASSWORD} in the environment")
    security = partial(_security, certificates, folder) if broker.scheme == "mqtts" else None
    if security is not None:
        security()  # so that who starts the system reads what is wrong
    return BrokerAddress(
        servers=broker.servers,
        user=broker.user,
        password=os.environ.get(PASSWORD) if broker.user else None,
        security=security,
    )


def _security(certificates: Certificates, folder: Path) -> ssl.SSLContext:
    try:
        context = ssl.create_default_context(cafile=str(folder / certificates.authority) if certificates.authority else None)
        if certificates.certificate is not None:
            key = str(folder / certificates.key) if certificates.key else None
            context.load_cert_chain(str(folder / certificates.certificate), key)
    except (OSError, ssl.SSLError) as error:
        files = ", ".join(str(folder / file) for file in (certificates.authority, certificates.certificate, certificates.key) if file)
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise UsageError(f"certificates: {files}: {reason}: give `authority`, `certificate` and `key` as paths of PEM files") from None
    return context


class Message(Struct, frozen=True, kw_only=True):
    """A message at a topic. `quality`: MQTT's quality of service. `is_retained`: the broker keeps it for those who subscribe afterwards."""

    topic: str
    payload: bytes
    quality: int = 0
    is_retained: bool = False


class Connection:
    """`topics`: those that are subscribed to. `on_message` gets each message; `on_connection`, whether the broker is there."""

    def __init__(
        self,
        address: BrokerAddress,
        topics: Sequence[tuple[str, int]],
        on_message: Callable[[str, bytes], None],
        on_connection: Callable[[bool], None],
        *,
        last_will: Message | None = None,
        name: str | None = None,
    ) -> None:
        self._address, self._topics, self._on_message, self._on_connection = address, topics, on_message, on_connection
        self._last_will, self._name = last_will, name
        self._servers = ServerChoice(address.servers)
        self._outgoing: deque[Message] = deque()
        self._wake = asyncio.Event()
        self.is_connected = False
        self._client_in_use: aiomqtt.Client | None = None
        self._may_connect = asyncio.Event()
        self._may_connect.set()

    def cut(self) -> None:
        """Lose the connection without a goodbye, as a robot does that drives out of the radio network, and make none until `restore`."""
        if not self._may_connect.is_set():
            return
        self._may_connect.clear()
        link = self._client_in_use._client.socket() if self._client_in_use is not None else None
        if isinstance(link, socket.socket):
            link.shutdown(socket.SHUT_RDWR)

    def restore(self) -> None:
        """Connect again after `cut`."""
        self._may_connect.set()

    def publish(self, message: Message) -> None:
        """Send a message as soon as possible. It is lost if the broker is not there, as messages with a quality of 0 are."""
        if self.is_connected:
            self._outgoing.append(message)
            self._wake.set()

    async def run(self) -> None:
        """Connect, and connect again whenever the connection is lost, until cancelled."""
        is_told = False
        while True:
            await self._may_connect.wait()
            try:
                async with self._client() as client:
                    is_told, self._client_in_use = False, client
                    for topic, quality in self._topics:
                        await client.subscribe(topic, qos=quality)
                    self._outgoing.clear()
                    self.is_connected = True
                    self._on_connection(True)
                    async with asyncio.TaskGroup() as group:
                        group.create_task(self._send(client))
                        group.create_task(self._receive(client))
            except* (aiomqtt.MqttError, OSError, UsageError) as errors:
                if not is_told:
                    is_told = True
                    log.warning("%s:%d: the broker is waited for: %s", *self._servers.current, errors.exceptions[0])
            finally:
                self._client_in_use = None
                if self.is_connected:
                    self.is_connected = False
                    self._on_connection(False)
            self._servers.lost()
            await asyncio.sleep(PAUSE)

    def _client(self) -> aiomqtt.Client:
        will = self._last_will
        return aiomqtt.Client(
            *self._servers.current,
            keepalive=KEEP_ALIVE,
            username=self._address.user,
            password=self._address.password,
            identifier=self._name,
            tls_context=self._address.security() if self._address.security is not None else None,
            will=aiomqtt.Will(will.topic, will.payload, will.quality, will.is_retained) if will is not None else None,
            max_queued_outgoing_messages=0,
        )

    async def _send(self, client: aiomqtt.Client) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._outgoing:
                message = self._outgoing.popleft()
                await client.publish(message.topic, message.payload, qos=message.quality, retain=message.is_retained)

    async def _receive(self, client: aiomqtt.Client) -> None:
        async for message in client.messages:
            if isinstance(message.payload, bytes):
                self._on_message(message.topic.value, message.payload)
        raise aiomqtt.MqttError("the broker has closed the connection")
