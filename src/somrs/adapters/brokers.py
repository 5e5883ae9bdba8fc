"""Where an MQTT broker is: at one server, or at several that pass on the same messages. A client uses one of them at a time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from urllib.parse import urlsplit

from msgspec import Struct

Server = tuple[str, int]
"""The host and the port of a server."""

PORTS = {"mqtt": 1883, "mqtts": 8883}

KEEP_ALIVE = 10
"""Seconds without a message after which a client asks its server whether it is there: of a host that has lost its power or its network,
nothing says that the connections to it have ended."""


class BrokerUrl(Struct, frozen=True, kw_only=True):
    """A URL of a broker, or the URLs of its servers. They have the same user."""

    scheme: str
    servers: tuple[Server, ...]
    user: str | None = None
    has_password: bool = False


def read_broker_url(text: str) -> BrokerUrl:
    """Read mqtt://HOST:PORT or mqtts://USER@HOST:PORT; of several servers, separated by commas. Raises ValueError."""
    urls = [urlsplit(part.strip()) for part in text.split(",")]
    first = urls[0]
    servers: list[Server] = []
    for url in urls:
        if url.scheme not in PORTS or not url.hostname or re.search(r"\s", url.netloc) or url.path not in ("", "/"):
            raise ValueError(f"{text!r} is no address of a broker")
        if (url.scheme, url.username) != (first.scheme, first.username):
            raise ValueError(f"{text!r} has servers with different schemes or users")
        try:
            servers.append((url.hostname, url.port or PORTS[url.scheme]))
        except ValueError:
            raise ValueError(f"{text!r} has no valid port") from None
    has_password = any(url.password is not None for url in urls)
    return BrokerUrl(scheme=first.scheme, servers=tuple(servers), user=first.username, has_password=has_password)


def addresses_text(scheme: str, servers: Sequence[Server]) -> str:
    """The servers of a broker as URLs, for people."""
    return ",".join(f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}" for host, port in servers)


class ServerChoice:
    """Which server of a broker is used: the same as long as it is there, and then the next."""

    def __init__(self, servers: Sequence[Server]) -> None:
        self._servers, self._number = servers, 0

    @property
    def current(self) -> Server:
        return self._servers[self._number]

    def lost(self) -> None:
        """The connection to the current server is lost, or was not made."""
        self._number = (self._number + 1) % len(self._servers)
