"""TCP ports: had at once by a server, or reserved for programs that are started later, and again after they have ended.

A reserved port is held by a socket that is bound and does not listen: nobody else is given it, as a server or as the source of a
connection, and who connects to it is refused until the program listens there. Both sockets have SO_REUSEPORT, which Linux allows among
sockets of one user (socket(7)).
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping, Sequence

from somrs.errors import UsageError

RESERVED = "SOMRS_RESERVED_PORTS"
"""The environment variable that tells a program which ports whoever started it has reserved for it and its like."""

_reserved: set[int] = set()
"""The ports that this process has reserved itself."""


def bound(host: str, port: int) -> socket.socket:
    """A socket at the port; at a free one, if it is 0. Raises UsageError when the port cannot be had."""
    is_ours = port in _reserved or str(port) in os.environ.get(RESERVED, "").split(",")
    try:
        return _bound(host, port, socket.SO_REUSEADDR, *([socket.SO_REUSEPORT] if is_ours else []))
    except OSError as error:
        raise UsageError(f"cannot listen at {host}:{port}: {error.strerror}; another --port may be free") from None


class Reservation:
    """Ports of a host that only this process can listen at, and those that it starts with this `environment`, until it is closed.
    A context manager.

    `wanted`: ports to have, as far as nobody else has them.
    """

    def __init__(self, host: str, count: int, preferred_ports: Sequence[int] = ()) -> None:
        self._sockets: list[socket.socket] = []
        for port in [*preferred_ports, *[0] * count][:count]:
            self._sockets.append(_held(host, port if _is_free(host, port) else 0))
        self.ports: list[int] = [sock.getsockname()[1] for sock in self._sockets]
        _reserved.update(self.ports)

    @property
    def environment(self) -> Mapping[str, str]:
        """The environment of programs that may listen at them."""
        return {**os.environ, RESERVED: ",".join(map(str, self.ports))}

    def __enter__(self) -> Reservation:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the ports to whoever listens there, or to anybody. Again: nothing."""
        _reserved.difference_update(self.ports)
        for sock in self._sockets:
            sock.close()


def _is_free(host: str, port: int) -> bool:
    """Whether nobody has the port, or reserved it; connections of an earlier run may linger there."""
    try:
        _bound(host, port, socket.SO_REUSEADDR).close()
    except OSError:
        return False
    return True


def _held(host: str, port: int) -> socket.socket:
    """A socket that keeps others from the port; where connections linger of who did not reserve it, only those who ask for a free one."""
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
