"""Certificates on the links to a simulated or a symbolic world: who its clients are, and what each of them may do there.

The address of a world with certificates begins with `tls://`.
"""

from __future__ import annotations

import asyncio
import os
import socket
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from somrs.errors import UsageError, WireError
from somrs.ontology.qualified_names import home_of, plain_name
from somrs.trust.connections import Peer, peer_certificate, peer_of
from somrs.trust.credentials import VARIABLE, Credentials
from somrs.trust.identity import Role
from somrs.trust.neighbours import OWN_SITE

SCHEME = "tls://"

HANDSHAKE_TIME = 10.0
"""Seconds within which a client has to have proven who it is."""

ANY_ROLE = frozenset(Role)
DEVICES = frozenset({Role.DEVICE})
PEOPLE = frozenset({Role.API, Role.CLIENT})
"""Programs that act for people."""


@dataclass(frozen=True, slots=True)
class Proof:
    """What the client of a connection has proven. `peer`: None if nobody has to prove anything, or if it has no identity."""

    credentials: Credentials | None = None
    peer: Peer | None = None

    @classmethod
    def of(cls, credentials: Credentials | None, writer: asyncio.StreamWriter) -> Proof:
        """That of a new connection. `credentials`: those of the server."""
        if credentials is None:
            return cls()
        credentials.renew()
        try:
            return cls(credentials, peer_of(peer_certificate(writer.transport) or {}))
        except (UsageError, KeyError):
            return cls(credentials)

    def check(self, roles: frozenset[Role] = ANY_ROLE, name: str | None = None, *, looks_only: bool = False) -> None:
        """Raises WireError unless the client has one of these roles, may speak for this name, if one is given, and is not revoked.

        The name is that of a robot in a world of several maps, `Barn:BarnRobot`, or of one. It is for the site of its map; who only looks
        at such a world may be of any of its sites, and everything else is for the site of the server. `looks_only`: the client does.
        """
        if self.credentials is None:
            return
        if self.peer is None:
            raise WireError("not-allowed", "a certificate of the site is needed here")
        try:
            identity = self.credentials.prove(self.peer, time.time())
        except UsageError as error:
            raise WireError("not-allowed", str(error)) from None
        if not roles & identity.roles:
            raise WireError("not-allowed", f"{identity.full_name} may not do this: that is for the roles {', '.join(sorted(roles))}")
        site = self._site_of(name) if name is not None else OWN_SITE
        if identity.site != site and not looks_only:
            text = (
                f"this is for the site {site}"
                if site
                else "this is for the site of the simulator, and a neighbour's device controls its robot"
            )
            raise WireError("not-allowed", f"{identity.full_name} may not do this: {text}")
        if name is not None and not identity.may_speak_for(plain_name(name)):
            raise WireError("not-allowed", f"{identity.full_name} may not speak for {name}: a certificate that names it is needed")

    def _site_of(self, name: str) -> str:
        """The site that a robot belongs to: a neighbour that has the name of its map, or else the own one."""
        assert self.credentials is not None, "without them, nobody is asked"
        return home_of(name) if home_of(name) in self.credentials.neighbours else OWN_SITE


OPEN = Proof()
"""That of the clients of a world without certificates."""


async def start_listening(
    serve: Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]],
    sock: socket.socket,
    limit: int,
    credentials: Credentials | None,
    *,
    is_shared: bool = False,
) -> asyncio.Server:
    """Serve connections at a socket, with lines of at most `limit` bytes. With credentials, only those of clients with a certificate of the
    same site; if it is shared, or of a neighbour."""
    if credentials is None:
        return await asyncio.start_server(serve, sock=sock, limit=limit)
    tls = credentials.entrance if is_shared else credentials.server
    return await asyncio.start_server(serve, sock=sock, limit=limit, ssl=tls, ssl_handshake_timeout=HANDSHAKE_TIME)


def link_credentials(address: str, credentials: Credentials | None = None) -> Credentials | None:
    """With what a client connects to the world at an address: None without certificates; by default, those of this process.

    Raises UsageError if there are none.
    """
    if not address.startswith(SCHEME):
        return None
    credentials = credentials if credentials is not None else own_credentials()
    if credentials is None:
        raise UsageError(f"{address} is for programs with a certificate of its site: set SOMRS_CREDENTIALS to one")
    credentials.renew()
    return credentials


def own_credentials() -> Credentials | None:
    """Those of this process, which are read once."""
    path = os.environ.get(VARIABLE)
    return _read_once(path) if path else None


@lru_cache(maxsize=4)
def _read_once(path: str) -> Credentials:
    return Credentials(Path(path))
