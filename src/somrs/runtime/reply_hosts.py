"""Where a message from the network may have others send to: only to the computer from which it comes, or to hosts that the site allows.

Otherwise anybody could have a component send requests to servers that only this computer reaches, or flood a third one with news. Who a
sender is, this does not say.
"""

from __future__ import annotations

import asyncio
import ipaddress
import os
import socket
from collections.abc import Iterator
from functools import lru_cache
from urllib.parse import urlsplit

from somrs.errors import UsageError
from somrs.protocol.messages.directory import Publish
from somrs.protocol.messages.envelope import ANONYMOUS, Message

VARIABLE = "SOMRS_REPLY_HOSTS"
"""The environment variable with the hosts, separated by spaces, to which any message may have components send."""

MOST_KNOWN = 1000
"""Maximum number of answers about hosts that are kept."""

Address = ipaddress.IPv4Address | ipaddress.IPv6Address


class ReplyHosts:
    """Checks the addresses in messages by the host from which they come."""

    def __init__(self) -> None:
        self._allowed_hosts = {host.casefold() for host in os.environ.get(VARIABLE, "").split()}
        self._checked: dict[tuple[str, str], None] = {}
        """Hosts, each with a sender that is the same computer. They are asked about again when there are many."""

    async def check(self, message: Message, peer: str) -> None:
        """Check the addresses in a message from the computer with this IP address. Raises UsageError."""
        for name, address in addresses_in(message):
            host = _host(address)
            if host is None or host in self._allowed_hosts or (host, peer) in self._checked:
                continue
            if not await _is_same_computer(host, peer):
                raise UsageError(
                    f"{name} is {address[:200]}, and the message comes from {peer}: name an address of the computer that sends, "
                    f"or allow the host where this component runs: {VARIABLE}={host[:200]}"
                )
            if len(self._checked) >= MOST_KNOWN:
                self._checked.clear()
            self._checked[host, peer] = None


def check_readable(message: Message) -> None:
    """Check that the addresses in a message can be read as URLs. Raises UsageError."""
    for _, address in (("To", message.header.recipient), *addresses_in(message)):
        try:
            urlsplit(address)
        except ValueError:
            raise UsageError(f"{address[:200]} is no address") from None


def addresses_in(message: Message) -> Iterator[tuple[str, str]]:
    """The addresses to which the message may have somebody send, each with the name of the field."""
    yield "From", message.header.sender
    yield "ReplyTo", message.header.reply_to
    if isinstance(message.body, Publish):
        for offer in message.body.offers:
            yield f"the address of {offer.service}", offer.address


def _host(address: str) -> str | None:
    """The host of an address; None if nothing can be sent there, as to the name of a client. Raises UsageError for a broken address."""
    if address == ANONYMOUS or not address.lower().startswith(("http:", "https:")):
        return None
    try:
        host = urlsplit(address).hostname
    except ValueError:
        host = None
    if not host:
        raise UsageError(f"{address[:200]} is no address")
    return host


async def _is_same_computer(host: str, peer: str) -> bool:
    sender = _parsed(peer)
    if sender is None:
        return False
    return any(address == sender or (_is_own(address) and _is_own(sender)) for address in await _resolved(host))


async def _resolved(host: str) -> list[Address]:
    """The IP addresses of a host; none if it has none."""
    if (address := _parsed(host)) is not None:
        return [address]
    try:
        answers = await asyncio.get_running_loop().getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return []
    return [address for answer in answers if (address := _parsed(str(answer[4][0]))) is not None]


def _parsed(text: str) -> Address | None:
    try:
        address = ipaddress.ip_address(text.partition("%")[0])
    except ValueError:
        return None
    return address.ipv4_mapped or address if isinstance(address, ipaddress.IPv6Address) else address


@lru_cache(maxsize=MOST_KNOWN)
def _is_own(address: Address) -> bool:
    """Whether this computer has the address: only then can a socket be bound to it."""
    if address.is_loopback or address.is_unspecified:  # a server that listens at all addresses is reached at this one
        return True
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((str(address), 0))
        except OSError:
            return False
    return not address.is_multicast
