"""TCP ports: bound by a server, or reserved for programs that start later or restart.

A reserved port is held by a socket that is bound and does not listen. Other programs cannot bind the port, nor use it as the source of a
connection; connections to it are refused until the program listens. Both sockets have SO_REUSEPORT, which Linux allows among sockets of
one user (socket(7)).
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import os
import socket
from collections.abc import Mapping, Sequence
from ipaddress import ip_address

from somrs.errors import UsageError

log = logging.getLogger(__name__)

RESERVED = "SOMRS_RESERVED_PORTS"
"""The environment variable that lists the ports, separated by commas, that the parent process has reserved for its child processes."""

_CHECK, _CHECKS_PER_WARNING = 0.2, 300
"""Seconds between two checks of whether a program listens, and how many of them there are for one warning."""

_RANGES = 20_000, 32_000
"""Where `free_range` looks: below the ports that Linux gives to connections (ip(7))."""

_reserved: set[int] = set()
"""The ports that this process has reserved."""


def listen_at(host: str, port: int) -> socket.socket:
    """A socket that listens at the port, or at a free port if `port` is 0. Raises UsageError when the port is taken."""
    sock = None
    try:
        sock = _bound(host, port, socket.SO_REUSEADDR, *([socket.SO_REUSEPORT] if is_reserved(port) else []))
        # With SO_REUSEADDR, several sockets may be bound to a port, of which one can listen. A server on uvloop whose socket cannot listen
        # says nothing of it, and serves nobody.
        sock.listen()
        return sock
    except OSError as error:
        if sock is not None:
            sock.close()
        raise UsageError(f"cannot listen at {host}:{port}: {error.strerror}; another --port may be free") from None


def check_free(host: str, port: int) -> None:
    """Raises UsageError when the port is taken, for a server that binds it by itself: whoever waits until somebody listens there would take
    another one for it."""
    listen_at(host, port).close()


def check_address(host: str) -> None:
    """Raises UsageError for `0.0.0.0` and `::`. A server can listen there, at all addresses, but others need one at which they reach it."""
    with contextlib.suppress(ValueError):
        if ip_address(host).is_unspecified:
            raise UsageError(
                f"{host} is no address at which other programs reach this computer: name the one that they are to use, as --host 10.0.0.7"
            )


def host_and_port(text: str) -> tuple[str, int]:
    """The parts of HOST:PORT; an IPv6 address is in brackets. Raises UsageError."""
    host, _, port = text.rpartition(":")
    if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise UsageError(f"{text!r} is no address: write HOST:PORT, such as 10.0.0.7:8883")
    return host.removeprefix("[").removesuffix("]"), int(port)


def is_reserved(port: int) -> bool:
    """Whether the port is reserved for a program of this system: for the one that is told to listen there, as others could do so, too."""
    return port in _reserved or str(port) in os.environ.get(RESERVED, "").split(",")


class Reservation:
    """Ports of a host that only this process, and processes started with its `environment`, can listen at until it is closed.
    A context manager.

    `preferred_ports` are used where they are free; other free ports take the place of the rest.
    """

    def __init__(self, host: str, count: int, preferred_ports: Sequence[int] = ()) -> None:
        self._sockets: list[socket.socket] = []
        for port in [*preferred_ports, *[0] * count][:count]:
            self._sockets.append(_held(host, port if _is_free(host, port) else 0))
        self.ports: list[int] = [sock.getsockname()[1] for sock in self._sockets]
        _reserved.update(self.ports)

    @property
    def environment(self) -> Mapping[str, str]:
        """The environment for programs that may listen at the ports."""
        return {**os.environ, RESERVED: ",".join(map(str, self.ports))}

    def release(self, port: int) -> None:
        """Release a port for a program that cannot share it with its reservation, such as one that is not ours."""
        for sock in [sock for sock in self._sockets if sock.getsockname()[1] == port]:
            sock.close()
            self._sockets.remove(sock)
            _reserved.discard(port)

    def __enter__(self) -> Reservation:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the ports; programs that listen there keep them. A second call does nothing."""
        _reserved.difference_update(self.ports)
        for sock in self._sockets:
            sock.close()


def free_range(host: str, count: int) -> int:
    """Find the first of so many free ports in a row. No connection gets one of them as its source. Raises UsageError if there are none."""
    starts: list[int] = [*range(_RANGES[0], _RANGES[1], count)]
    preferred = os.getpid() % len(starts)
    for first in starts[preferred:] + starts[:preferred]:
        if all(_is_free(host, port) for port in range(first, first + count)):
            return first
    raise UsageError(f"{host} has no {count} free ports in a row between {_RANGES[0]} and {_RANGES[1]}")


async def until_listening(address: str) -> None:
    """Return when a program listens at host:port, however long that takes. Raises UsageError for another address."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise UsageError(f"give host and port of the program as HOST:PORT, not {address!r}")
    for attempt in itertools.count(1):
        try:
            _, writer = await asyncio.open_connection(host, int(port))
        except OSError:
            if attempt % _CHECKS_PER_WARNING == 0:
                log.warning("waiting for a program that listens at %s", address)
            await asyncio.sleep(_CHECK)
        else:
            writer.close()
            return


def _is_free(host: str, port: int) -> bool:
    """Whether the port is neither bound nor reserved. Connections of an earlier run may linger there."""
    try:
        _bound(host, port, socket.SO_REUSEADDR).close()
    except OSError:
        return False
    return True


def _held(host: str, port: int) -> socket.socket:
    """A socket that keeps other programs from the port. If connections of a program that did not reserve the port linger there, the socket
    needs SO_REUSEADDR, and only keeps the port from being assigned as a free one."""
    try:
        return _bound(host, port, socket.SO_REUSEPORT)
    except OSError:
        return _bound(host, port, socket.SO_REUSEPORT, socket.SO_REUSEADDR)


def _bound(host: str, port: int, *options: int) -> socket.socket:
    sock = socket.socket()
    try:
        for option in options:
            sock.setsockopt(socket.SOL_SOCKET, option, 1)
        sock.bind((host, port))
    except OSError:
        sock.close()
        raise
    return sock
