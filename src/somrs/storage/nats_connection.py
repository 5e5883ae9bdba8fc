"""Connections to the NATS servers of a bus, and what is made in their JetStream with a copy on each of several servers."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import ssl
from collections.abc import Callable, Coroutine, Set
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote, urlsplit

from somrs.errors import UsageError
from somrs.trust.credentials import Credentials, advice

if TYPE_CHECKING:
    from nats.aio.client import Client

log = logging.getLogger(__name__)

T = TypeVar("T")

SCHEMES = ("nats", "tls", "ws", "wss")
"""How URLs of NATS servers begin."""

RECONNECT_PAUSE = 0.25
"""Seconds between two attempts to reach a server again."""

PING_PAUSE, MOST_PINGS = 2.0, 2
"""Seconds between two pings of a server, and how many it may leave unanswered before another one is tried. When a host loses its power
or its network, nothing says that the connections to it have ended."""

MOST_COPIES = 3
"""The number of servers that store a stream or a bucket, if there are as many."""

FIRST_PAUSE, LONGEST_PAUSE = 0.05, 1.0
"""Seconds before what was not answered is tried again; each pause is twice as long as the one before."""

_OTHER_COPIES = 10058
"""The error that a stream is there with another configuration."""

_TOO_MANY_COPIES = frozenset({10074, 10005})
"""The errors that there are fewer servers than copies."""


INBOXES = "_INBOX."
"""How subjects for answers begin. An answer goes nowhere else: it would be sent with the rights of who answers."""

END_TIME = 1.0
"""Seconds for a connection to end. What it has sent is flushed before; the library waits for ever for one whose TLS was never agreed on."""

RENEWAL_LOOK = 2.0
"""Seconds between two looks whether the own certificate has been renewed."""

logging.getLogger("asyncio").addFilter(lambda record: "returning true from eof_received()" not in str(record.msg))
# The NATS library gives TLS a protocol of asyncio that is made for plain connections; the warning at each end of one says nothing else.

_renewing: set[asyncio.Task[None]] = set()
"""The tasks that renew connections."""


async def connect(servers: str, credentials: Credentials | None = None, **options: Any) -> Client:
    """Connect to one of the servers, whose URLs are separated by commas, and renew the connection until it is closed.

    Servers that cannot be reached are tried again, however long; the log says so once. `credentials`: with them, the connection begins with
    TLS, so that nobody in between can have it do without, and is made anew when the own certificate has been renewed. `options`: those of
    `nats.connect`.

    Raises UsageError for a wrong URL, or when the library is not installed.
    """
    try:
        import nats
    except ImportError:
        raise UsageError("the bus needs additional packages: pip install 'somrs[bus]'") from None

    client: Client | None = None
    urls, failures, denials = servers.split(","), 0, 0

    async def explain(error: Exception) -> None:
        nonlocal failures, denials
        failures += 1
        denials += _is_denied(error)
        if client is None and failures == len(urls):  # one of several servers may be away
            log.warning("the bus at %s cannot be reached: %s; it is tried again", servers, _problem(error))
        elif client is not None and _is_denied(error) and denials == 1:
            log.error("the bus at %s has ended the connection of this program: %s", servers, _problem(error))
        elif "permissions violation" in str(error).lower():
            log.warning("the bus at %s has denied this program something: %s", servers, error)
        log.debug("the bus: %s", error)

    if credentials is not None:
        inbox = f"{INBOXES}{quote(credentials.name, safe='').replace('.', '%2E')}"
        options |= {"tls": credentials.client, "tls_handshake_first": True, "inbox_prefix": inbox}
    try:
        for url in urls:
            if "://" in url and urlsplit(url).scheme not in SCHEMES:
                raise ValueError(f"it begins with one of {', '.join(f'{scheme}://' for scheme in SCHEMES)}")
        client = await nats.connect(
            urls,
            allow_reconnect=True,
            max_reconnect_attempts=-1,
            reconnect_time_wait=RECONNECT_PAUSE,
            ping_interval=PING_PAUSE,
            max_outstanding_pings=MOST_PINGS,
            error_cb=explain,
            **options,
        )
    except (nats.errors.Error, ValueError) as error:  # nothing else ends the attempts
        raise UsageError(f"{servers}: this is not the URL of a NATS server: {error}") from None
    if credentials is not None:
        task = asyncio.create_task(_renew(client, credentials, credentials.generation))
        _renewing.add(task)
        task.add_done_callback(_renewing.discard)
    return client


async def end(client: Client | None) -> None:
    """Close a connection, which may be lost just now."""
    if client is not None:
        # uvloop has closed it (RuntimeError), or asyncio's TLS has (AttributeError).
        with contextlib.suppress(OSError, RuntimeError, AttributeError):
            async with asyncio.timeout(END_TIME):
                await client.close()


async def _renew(client: Client, credentials: Credentials, generation: int) -> None:
    """Connect anew whenever the own certificate has been renewed: the servers end connections whose certificate has expired."""
    while not client.is_closed:
        credentials.renew()
        if credentials.generation != generation and client.is_connected:
            generation = credentials.generation
            await client.force_reconnect()
        await asyncio.sleep(RENEWAL_LOOK)
    if client.last_error is not None and _is_denied(client.last_error):
        log.error("the bus has ended the connection of %s: %s", credentials.name, _problem(client.last_error))


def _is_denied(error: Exception) -> bool:
    """Whether the servers do not let this program in."""
    return "authorization" in str(error).lower()


def _problem(error: Exception) -> str:
    """Why there is no connection, for people."""
    if isinstance(error, ssl.SSLError):
        if "WRONG_VERSION_NUMBER" in str(error):
            return "it has no TLS, and this program has a certificate: start its servers with certificates, too"
        return advice(error)
    if _is_denied(error):
        return "its servers do not know the certificate of this program: it is revoked or has expired, or they do not know it yet"
    return str(error)


async def patiently(ask: Callable[[], Coroutine[Any, Any, T]], refusals: Set[int] = frozenset()) -> T:
    """The result of `ask`, which is called again while the servers do not answer, or cannot for now.

    Raises nats.js.errors.APIError for what they refuse: that something is not there, the errors in `refusals`, and all but those that pass.
    """
    from nats import errors
    from nats.js.errors import APIError, NotFoundError

    pause = FIRST_PAUSE
    while True:
        try:
            return await ask()
        except NotFoundError:
            raise
        except APIError as error:
            if error.err_code in refusals or error.code not in (None, 503):
                raise
        except (errors.Error, OSError):
            pass
        await asyncio.sleep(pause)
        pause = min(pause * 2, LONGEST_PAUSE)


async def made_with_copies(make: Callable[[int], Coroutine[Any, Any, T]]) -> T:
    """What `make` makes with as many copies as there are servers for, or with which it is there already."""
    from nats.js.errors import APIError

    refusals = {_OTHER_COPIES, *_TOO_MANY_COPIES}
    for copies in range(MOST_COPIES, 1, -1):
        try:
            return await patiently(partial(make, copies), refusals)
        except APIError as error:
            if error.err_code not in refusals:
                raise
    return await patiently(partial(make, 1))
