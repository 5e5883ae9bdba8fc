"""What JetStream has for a component: a stream with its journal, and one with the copies of its file. And the bucket with all leases.

Who may make a stream may have JetStream read others, and publish in any name. With certificates, only the servers of the bus make what
components ask them for (`deployment/bus_stores.py`), so that each component reaches its own streams only.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, NamedTuple

from somrs.storage.lease import LEASES, make_leases
from somrs.storage.nats_connection import FIRST_PAUSE, LONGEST_PAUSE, made_with_copies

if TYPE_CHECKING:
    from nats.aio.client import Client
    from nats.js import JetStreamContext

log = logging.getLogger(__name__)

REQUESTS = "somrs-stores"
"""The first token of the subjects on which servers are asked to make something; the site follows, and the component, if it is for one."""

SITES_REQUEST = "somrs-sites"
"""The subject on which servers are asked which sites there are. Who asks JetStream has it answer on any subject, in anybody's name."""

JOURNALS, COPIES = "somrs-journal", "somrs-copy"
"""The first tokens of the subjects of what is stored."""

_ANSWER_TIME = 10.0
"""Seconds after which the servers are asked again."""


class Stores(NamedTuple):
    """The names of what a component has in JetStream. Names of streams have no dots."""

    site: str
    component: str

    @property
    def key(self) -> str:
        return f"{self.site}.{self.component}"

    @property
    def journal(self) -> str:
        """The stream of the journal."""
        return f"{JOURNALS}-{self.site}-{self.component}"

    @property
    def journal_subject(self) -> str:
        return f"{JOURNALS}.{self.key}"

    @property
    def copies(self) -> str:
        """The stream of the copies."""
        return f"{COPIES}-{self.site}-{self.component}"

    @property
    def copies_subject(self) -> str:
        """How the subjects of the copies begin."""
        return f"{COPIES}.{self.key}"


async def make_stores(js: JetStreamContext, stores: Stores) -> None:
    """Make what is not there yet. Waits while the servers do not answer. Raises nats.js.errors.APIError for what they refuse."""
    from nats.js.api import DiscardPolicy, StreamConfig

    journal = StreamConfig(name=stores.journal, subjects=[stores.journal_subject])
    copies = StreamConfig(name=stores.copies, subjects=[f"{stores.copies_subject}.>"], discard=DiscardPolicy.NEW, allow_rollup_hdrs=True)
    await made_with_copies(lambda count: js.add_stream(journal, num_replicas=count))
    await made_with_copies(lambda count: js.add_stream(copies, num_replicas=count))
    await make_leases(js)


async def have_made(client: Client, subject: str, make: Callable[[], Awaitable[object]], *, by_servers: bool) -> None:
    """Have the servers make what is asked for on a subject, however long they do not; without certificates, `make` it here."""
    if not by_servers:
        await make()
        return
    while problem := (await answer_of_servers(client, subject)).decode():
        log.warning("the bus has not made %s: %s; it is asked again", subject, problem)
        await asyncio.sleep(LONGEST_PAUSE)


async def answer_of_servers(client: Client, subject: str) -> bytes:
    """What the servers of the bus answer on a subject, however long they do not."""
    from nats import errors

    pause, has_warned = FIRST_PAUSE, False
    while True:
        try:
            return (await client.request(subject, timeout=_ANSWER_TIME)).data
        except errors.NoRespondersError:
            problem = "none of its servers was started with `somrs run bus`, or it starts just now"
        except (errors.Error, OSError) as error:
            problem = str(error) or "it does not answer"
        if pause == LONGEST_PAUSE and not has_warned:
            log.warning("the bus does not answer on %s: %s; it is asked again", subject, problem)
            has_warned = True
        await asyncio.sleep(pause)
        pause = min(pause * 2, LONGEST_PAUSE)


async def discard_stores(client: Client, site: str) -> None:
    """Delete everything that the bus keeps of a site's components."""
    from nats.js.errors import BucketNotFoundError, NoKeysError

    js = client.jetstream()
    beginnings = tuple(f"{root}.{site}." for root in (JOURNALS, COPIES))
    for stream in await js.streams_info():
        if any(subject.startswith(beginnings) for subject in stream.config.subjects or ()):
            await js.delete_stream(str(stream.config.name))
    with contextlib.suppress(BucketNotFoundError, NoKeysError):
        bucket = await js.key_value(LEASES)
        for key in await bucket.keys():
            if key.startswith(f"{site}."):
                await bucket.purge(key)
