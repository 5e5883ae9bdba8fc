"""What an identity may do on a bus: what the NATS servers permit it, and which of its messages recipients accept.

The servers know certificates and not roles: `permissions` says for each identity to which subjects it may publish and subscribe. That
every message has the token of its sender in its subject follows from it, so recipients know who that is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from somrs.errors import UsageError
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.rights import check_right
from somrs.runtime.bus_address import BEGINNINGS, PROVEN_ROOT, BusAddress, name_of, sender_token, token_of
from somrs.runtime.neighbour_checks import check_neighbour
from somrs.runtime.places import check_addresses, component_names, listening_patterns, may_listen
from somrs.runtime.proofs import Proof
from somrs.storage.nats_connection import INBOXES
from somrs.storage.stores import COPIES, JOURNALS, REQUESTS, SITES_REQUEST, Stores
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role, role_named
from somrs.trust.neighbours import OWN_SITE

_SITES = "KV_somrs-sites"
_WITH_JOURNALS = frozenset({Role.REPOSITORY, Role.REGISTRY, Role.TASK_MANAGER, Role.SCHEDULER})
"""The roles of components whose journals are on the bus."""

_LISTING = frozenset({Role.GATEWAY, Role.REGISTRY, Role.TASK_MANAGER})
"""The roles that list addresses of their site."""

_MARK = ":"
"""Between the parts of the token of a neighbour's program. `token_of` leaves none in a name."""

_READING = tuple(f"$JS.API.STREAM.{request}.{_SITES}" for request in ("INFO", "MSG.GET"))
"""What who lists addresses may ask of JetStream: which sites there are.

JetStream answers on any subject that a request names, also on one of somebody else. So nobody has rights there who stores nothing; others
ask the servers of the bus. And nobody has DIRECT.GET or consumers, which would send there what is stored as it is.
"""

_LEADING = tuple(f"$JS.API.STREAM.{request}.KV_somrs-leaders" for request in ("INFO", "MSG.GET"))
"""What components with a journal may ask of JetStream besides their own streams: who leads."""


def _storing(stores: Stores) -> list[str]:
    """What a component may ask of JetStream about its own streams. The servers make them."""
    return [f"$JS.API.STREAM.{request}.{stream}" for stream in (stores.journal, stores.copies) for request in ("INFO", "MSG.GET", "PURGE")]


def permissions(identity: Identity, sites: Iterable[str] = ()) -> dict[str, object]:
    """The permissions of an identity, as in the configuration of a NATS server. `sites`: those of the bus, whose names are in the names of
    streams; NATS has no patterns within a token."""
    if Role.BUS in identity.roles:
        return {"publish": ">", "subscribe": ">"}
    me, patterns = token_of(identity.name), listening_patterns(identity)
    publish = [f"{PROVEN_ROOT}.*.{'*' if Role.GATEWAY in identity.roles else me}.>", "somrs-status.*", SITES_REQUEST]
    publish += [f"{BEGINNINGS}.*.{pattern}" for pattern in patterns]
    subscribe = [f"{INBOXES}{me}.>", f"{BEGINNINGS}.*.>", *(f"{PROVEN_ROOT}.*.*.{kind}.{me}.>" for kind in ("answers", "processes"))]
    subscribe += [f"{PROVEN_ROOT}.*.*.{pattern}" for pattern in patterns]
    if identity.roles & _LISTING:
        publish += [f"{REQUESTS}.*", "$KV.somrs-sites.*", *_READING]
    for role in identity.roles & _WITH_JOURNALS:
        publish += _LEADING
        for component in component_names(identity, role):
            publish += [f"{root}.*.{component}" for root in (REQUESTS, JOURNALS, "$KV.somrs-leaders", "somrs-resignation")]
            publish += [f"{COPIES}.*.{component}.>", *(subject for site in sites for subject in _storing(Stores(site, component)))]
            subscribe += [f"{root}.*.{component}" for root in (JOURNALS, "somrs-resignation")]
        # Who asks how a component is gets the answer at its inbox, whose name nobody else knows. With `allow_responses`, NATS would permit
        # answers on any subject that a question names, and a program may ask itself.
        publish.append(f"{INBOXES}>")
        subscribe.append("somrs-status.*")
    return {"publish": list(dict.fromkeys(publish)), "subscribe": list(dict.fromkeys(subscribe))}


def proof_of_subject(credentials: Credentials, subject: str) -> Proof:
    """The proof of who has sent a message with this subject."""

    def prove() -> Identity:
        try:
            token = sender_token(subject)
            return neighbour_of(token) if _MARK in token else credentials.identity_named(name_of(token), time.time())
        except ValueError as error:
            raise UsageError(str(error)) from None

    return prove


def token_of_sender(identity: Identity) -> str:
    """The token with which a gateway passes on messages of an identity. That of a neighbour's says all that the gateway has proven of it:
    others on the bus do not know who holds certificates there, and the servers let no other program use such a token."""
    if identity.site == OWN_SITE:
        return token_of(identity.name)
    lists = (sorted(identity.roles), sorted(identity.speaks_for))
    return _MARK.join((token_of(identity.site), token_of(identity.name), *("+".join(map(token_of, names)) for names in lists)))


def neighbour_of(token: str) -> Identity:
    """The identity of a neighbour's program with this token. Raises ValueError or UsageError if it is none."""
    site, name, roles, names = token.split(_MARK)
    return Identity(
        name=name_of(name),
        roles=frozenset(role_named(role) for role in roles.split("+")),
        speaks_for=frozenset(name_of(spoken) for spoken in names.split("+") if spoken),
        site=name_of(site),
    )


def may_answer(credentials: Credentials, bus: BusAddress, name: str, subject: str) -> bool:
    """Whether who has this name may answer what is sent to a subject of this bus: a component's, or the inbox of a process."""
    tokens = bus.tokens(subject)
    if tokens[0] == "processes":
        return tokens[1] == token_of(name)
    try:
        identity = credentials.identity_named(name, time.time())
    except UsageError:
        return False
    return may_listen(identity, tokens)


def rights_on(bus: BusAddress, credentials: Credentials | None) -> Callable[[Message, Identity], None]:
    """The check of a message on this bus, to who has these credentials: that its sender may send it, and that its addresses in this site
    are the sender's.

    It raises WireError with the code `DENIED`.
    """

    def check(message: Message, identity: Identity) -> None:
        if identity.site != OWN_SITE:
            assert credentials is not None, "who has none, checks nobody"
            check_neighbour(message, identity, credentials)
            return
        check_right(message, identity)
        check_addresses(message, identity, bus.covers)

    return check
