"""What is checked of messages and answers that come from programs of neighbours, over HTTP and behind a gateway to a bus.

Who sends is proven by a certificate; what it may send is in `protocol/messages/neighbour_rights.py`; and the addresses in a message have to
be at hosts of the same neighbour, so that nobody speaks for an own program, or for another neighbour.
"""

from __future__ import annotations

from collections.abc import Iterator
from urllib.parse import urlsplit

from somrs.errors import RemoteError, WireError
from somrs.protocol.component_paths import is_of_component
from somrs.protocol.messages.directory import Discovered, ServicesJoined
from somrs.protocol.messages.envelope import ANONYMOUS, Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.neighbour_rights import check_neighbour_right, is_of_components
from somrs.protocol.messages.rights import DENIED, participant_names
from somrs.runtime.bus_address import path_tokens
from somrs.runtime.places import may_listen
from somrs.runtime.reply_hosts import addresses_in
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role
from somrs.trust.neighbours import OWN_SITE


def check_neighbour(message: Message, identity: Identity, credentials: Credentials) -> None:
    """Raises WireError with the code `DENIED` if a program of a neighbour may not send a message to who has these credentials."""
    check_neighbour_right(message, identity, credentials.identity.roles)
    neighbour = credentials.neighbours[identity.site]
    sender = message.header.sender
    if is_of_components(type(message.body)) and sender not in (neighbour.repository, *neighbour.registries):
        if Role.TRAFFIC not in identity.roles or not is_of_component(sender):
            raise _denied(identity, "From", sender, f"the file with the neighbours has another address for {identity.site}")
        if not neighbour.simulates:
            raise _denied(
                identity, "From", sender, f"add `simulates: true` to {identity.site} there, if its simulator may read the whole map"
            )
    for field, address in (*addresses_in(message), *_offered(message)):
        if address == ANONYMOUS and field == "ReplyTo":
            continue
        if credentials.neighbours.site_of(address) != identity.site:
            raise _denied(
                identity, field, address, f"add its host to `hosts` of {identity.site} in the file with the neighbours, if it is there"
            )
        if field in ("From", "ReplyTo") and is_of_component(address) and not may_listen(identity, path_tokens(urlsplit(address).path)):
            raise _denied(identity, field, address, "it needs a certificate with which it can listen there")


def check_site(message: Message, credentials: Credentials) -> None:
    """Raises WireError with the code `DENIED` if a message of an own program has an address at the host of a neighbour."""
    for field, address in addresses_in(message):
        if credentials.neighbours.site_of(address) != OWN_SITE:
            raise WireError(DENIED, f"{field} is {address[:200]}, at the host of a neighbour, and its sender is of this site")


def check_answer(answer: Message, request: Message, credentials: Credentials) -> None:
    """Check the answer on the connection of a request: if the request went to a neighbour, it is to be one that who listens there may give.

    Raises RemoteError if it is not.
    """
    recipient = request.header.recipient
    site = credentials.neighbours.site_of(recipient)
    if site == OWN_SITE:
        return
    try:
        if not isinstance(answer.body, Fault):  # anybody may say why a message was refused
            check_neighbour_right(answer, _listener(request, site), credentials.identity.roles)
    except WireError as error:
        raise RemoteError(f"{recipient} gave an answer that it has no right to: {error.text}") from None
    if answer.header.sender not in (ANONYMOUS, recipient):
        raise RemoteError(f"{recipient} answered in the name of {answer.header.sender[:200]}")


def _listener(request: Message, site: str) -> Identity:
    """Who listens at an address of a neighbour, by its path: the connection has proven that it is of that neighbour."""
    path = urlsplit(request.header.recipient).path.strip("/")
    roles = {"repository": Role.REPOSITORY, "registry": Role.REGISTRY, "task-manager": Role.TASK_MANAGER}
    role = next((role for start, role in roles.items() if path.partition("/")[0].startswith(start)), Role.DEVICE)
    names = frozenset(name.removeprefix(f"{site}:") for name in participant_names(request))
    return Identity(name=path, roles=frozenset({role}), speaks_for=names, site=site)


def _offered(message: Message) -> Iterator[tuple[str, str]]:
    """The addresses of what a Registry offers."""
    if isinstance(message.body, Discovered | ServicesJoined):
        for offer in message.body.offers:
            yield f"the address of {offer.service}", offer.address


def _denied(identity: Identity, field: str, address: str, advice: str) -> WireError:
    return WireError(DENIED, f"{identity.full_name} may not name {address[:200]} as {field}: {advice}")
