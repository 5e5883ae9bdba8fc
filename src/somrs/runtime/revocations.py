"""What the authorities of neighbours have revoked: the service of the own authority asks theirs, and notes it for the site's programs."""

from __future__ import annotations

import asyncio
import logging

import aiohttp

from somrs.errors import RemoteError
from somrs.runtime.trust_client import MOST_BYTES, REVOKED_PATH
from somrs.trust.connections import fingerprint
from somrs.trust.credentials import Credentials
from somrs.trust.files import write_private
from somrs.trust.neighbours import REVOKED_NEIGHBOURS_FILE, TrustedNeighbour, write_revoked

log = logging.getLogger(__name__)

ASK_PAUSE = 2.0
"""Seconds between two questions to the authority of a neighbour."""

ANSWER_TIME = 10.0
"""Seconds after which it is asked again."""


class Revocations:
    """Asks the authorities of neighbours. While one does not answer, what it said last counts, and the log says so once."""

    def __init__(self, credentials: Credentials) -> None:
        self._credentials = credentials
        self._silent: set[str] = set()

    async def follow(self) -> None:
        """Write down what they have revoked whenever it has changed, until cancelled."""
        async with aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(total=ANSWER_TIME)) as session:
            while True:
                asked = [neighbour for neighbour in self._credentials.neighbours.all if neighbour.service]
                answers = await asyncio.gather(*(self._ask(session, neighbour) for neighbour in asked))
                news = {
                    fingerprint(neighbour.authority): serials
                    for neighbour, serials in zip(asked, answers, strict=True)
                    if serials is not None
                }
                known_serials = self._credentials.revoked_of_neighbours
                if {**known_serials, **news} != known_serials:
                    write_private(self._credentials.folder / REVOKED_NEIGHBOURS_FILE, write_revoked({**known_serials, **news}))
                await asyncio.sleep(ASK_PAUSE)

    async def _ask(self, session: aiohttp.ClientSession, neighbour: TrustedNeighbour) -> tuple[str, ...] | None:
        """The serial numbers that a neighbour has revoked; None if it does not answer."""
        try:
            # Only a program of that neighbour is accepted there.
            tls = self._credentials.client_for(neighbour.service)
            async with session.get(neighbour.service + REVOKED_PATH, ssl=tls, allow_redirects=False) as response:
                content = await response.content.read(MOST_BYTES + 1)
                if response.status != 200 or not response.content.at_eof():
                    raise RemoteError(f"HTTP {response.status}")
        except (RemoteError, aiohttp.ClientError, TimeoutError, OSError) as error:
            if neighbour.name not in self._silent:
                self._silent.add(neighbour.name)
                log.warning(
                    "the authority of %s at %s does not answer: %s; what it said last counts", neighbour.name, neighbour.service, error
                )
            return None
        self._silent.discard(neighbour.name)
        return tuple(sorted(content.decode("ascii", "replace").split()))
