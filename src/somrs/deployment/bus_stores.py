"""What the servers of a bus with certificates make in its JetStream, for those who ask for it (`storage/stores.py`).

Each server knows the sites of the bus as well, whose names are in the names of the streams that components may use.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Awaitable, Callable
from functools import partial
from typing import TYPE_CHECKING

import msgspec

from somrs.deployment.bus import SITES, listed_addresses, listed_sites, make_sites
from somrs.storage.nats_connection import INBOXES, connect, end
from somrs.storage.stores import REQUESTS, SITES_REQUEST, Stores, make_stores
from somrs.trust.credentials import Credentials

if TYPE_CHECKING:
    from nats.aio.client import Client
    from nats.aio.msg import Msg
    from nats.js import JetStreamContext

log = logging.getLogger(__name__)

_LISTED = f"$KV.{SITES}"
"""How the subjects begin on which sites are listed; their names follow."""


class BusStores:
    """Makes what is asked for. `note_site`: hears of each site."""

    def __init__(self, note_site: Callable[[str], object]) -> None:
        self._note_site = note_site
        self._client: Client | None = None

    async def start(self, servers: str, credentials: Credentials) -> None:
        """Begin, and read which sites there are, however long the servers cannot say it."""
        from nats.js.errors import NotFoundError

        self._client = client = await connect(servers, credentials)
        await client.subscribe(f"{REQUESTS}.*", cb=self._on_site_request)
        await client.subscribe(f"{REQUESTS}.*.*", cb=self._on_component_request)
        await client.subscribe(SITES_REQUEST, cb=self._on_question)
        await client.subscribe(f"{_LISTED}.*", cb=self._on_site)
        with contextlib.suppress(NotFoundError):
            for site in await listed_sites(client.jetstream()):
                self._note_site(site)

    async def close(self) -> None:
        await end(self._client)

    async def _on_site(self, notice: Msg) -> None:
        self._note_site(notice.subject.removeprefix(f"{_LISTED}."))

    async def _on_site_request(self, request: Msg) -> None:
        await self._answer(request, make_sites)

    async def _on_component_request(self, request: Msg) -> None:
        _, site, component = request.subject.split(".")
        self._note_site(site)
        await self._answer(request, partial(make_stores, stores=Stores(site, component)))

    async def _on_question(self, request: Msg) -> None:
        """Answer with the addresses of all sites."""
        assert self._client is not None, "it is started"
        await _respond(request, msgspec.json.encode(await listed_addresses(self._client.jetstream())))

    async def _answer(self, request: Msg, make: Callable[[JetStreamContext], Awaitable[None]]) -> None:
        """Make what is asked for, and answer with the problem, or with nothing."""
        from nats.js.errors import APIError

        assert self._client is not None, "it is started"
        problem = ""
        try:
            await make(self._client.jetstream())
        except APIError as error:
            problem = error.description or str(error)
        await _respond(request, problem.encode())


async def _respond(request: Msg, answer: bytes) -> None:
    from nats import errors

    if not request.reply.startswith(INBOXES):
        return
    try:
        await request.respond(answer)
    except (errors.Error, OSError) as error:  # it is asked again
        log.debug("an answer on %s is lost: %s", request.subject, error)
