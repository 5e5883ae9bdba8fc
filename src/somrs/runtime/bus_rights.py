"""What an identity may do on a bus: at which paths it may listen, what the NATS servers permit it, and in whose name its messages speak.

The servers know certificates and not roles: `permissions` says for each identity to which subjects it may publish and subscribe. That
every message has the token of its sender in its subject follows from it, so recipients know who that is.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from urllib.parse import urlsplit

from somrs.errors import UsageError, WireError
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.rights import DENIED, check_right
from somrs.runtime.bus_address import BEGINNINGS, PROVEN_ROOT, BusAddress, path_tokens, sender_of, token_of
from somrs.runtime.proofs import Proof
from somrs.runtime.reply_hosts import addresses_in
from somrs.storage.nats_connection import INBOXES
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role

MOST_OF_A_KIND = 32
"""How many Task Managers, Registries and simulators a site with certificates has on a bus: NATS has no patterns within a token."""

_SITES = "KV_somrs-sites"
_NUMBERS = range(2, MOST_OF_A_KIND + 1)
_SPOKEN = ("devices", "passages", "maps")
"""The first parts of paths at which a device listens; the second is its name."""


def _numbered(name: str) -> tuple[str, ...]:
    return (name, *(f"{name}-{number}" for number in _NUMBERS))


_PATHS: dict[Role, tuple[str, ...]] = {
    Role.REPOSITORY: ("repository",),
    Role.REGISTRY: _numbered("registry"),
    Role.TASK_MANAGER: _numbered("task-manager"),
    Role.SCHEDULER: ("scheduler",),
    Role.TRAFFIC: ("traffic", "map-follower", *_numbered("simulator")),
    Role.API: ("news.*",),
    Role.CLIENT: ("news.*",),
    Role.VIEWER: ("news.*",),
}
"""The paths at which programs listen, as subjects."""

_WITH_JOURNALS = frozenset({Role.REPOSITORY, Role.REGISTRY, Role.TASK_MANAGER, Role.SCHEDULER})
"""The roles of components whose journals are on the bus."""

_LISTING = frozenset({Role.GATEWAY, Role.REGISTRY, Role.TASK_MANAGER})
"""The roles that list addresses of their site."""

_READING = (
    "$JS.API.INFO",
    *(f"$JS.API.{request}.{_SITES}" for request in ("STREAM.INFO", "STREAM.MSG.GET", "DIRECT.GET", "CONSUMER.CREATE")),
    *(f"$JS.API.{request}.{_SITES}.>" for request in ("DIRECT.GET", "CONSUMER.CREATE", "CONSUMER.INFO", "CONSUMER.DELETE")),
    "$JS.FC.>",
)
"""What everybody may ask of JetStream: to read which sites there are."""

_STORING = (
    *(f"$JS.API.STREAM.{request}.*" for request in ("CREATE", "INFO", "MSG.GET", "PURGE")),
    "$JS.API.DIRECT.GET.>",
    "$JS.API.CONSUMER.>",
    "$O.somrs-journals.>",
)
"""What components with a journal may: what is stored is theirs together, but only one of them can write to each journal."""


@lru_cache(maxsize=2000)
def listening_patterns(identity: Identity) -> tuple[str, ...]:
    """The paths at which an identity may listen, as subjects without their site; `*` is any token."""
    fixed = [pattern for role in sorted(identity.roles) for pattern in _PATHS.get(role, ())]
    names = sorted({identity.name, *identity.speaks_for}) if Role.DEVICE in identity.roles else []
    return (*fixed, *(f"{first}.{token_of(name)}" for name in names for first in _SPOKEN))


def permissions(identity: Identity) -> dict[str, object]:
    """The permissions of an identity, as in the configuration of a NATS server."""
    if Role.BUS in identity.roles:
        return {"publish": ">", "subscribe": ">"}
    me, patterns = token_of(identity.name), listening_patterns(identity)
    publish = [f"{PROVEN_ROOT}.*.{'*' if Role.GATEWAY in identity.roles else me}.>", "somrs-status.*", *_READING]
    publish += [f"{BEGINNINGS}.*.{pattern}" for pattern in patterns]
    subscribe = [f"{INBOXES}{me}.>", f"{BEGINNINGS}.*.>", *(f"{PROVEN_ROOT}.*.*.{kind}.{me}.>" for kind in ("answers", "processes"))]
    subscribe += [f"{PROVEN_ROOT}.*.*.{pattern}" for pattern in patterns]
    if identity.roles & _LISTING:
        publish += [f"$JS.API.STREAM.CREATE.{_SITES}", "$KV.somrs-sites.*"]
    for role in identity.roles & _WITH_JOURNALS:
        publish += _STORING
        for component in _PATHS[role]:
            publish += [f"{root}.*.{component}" for root in ("somrs-journal", "$KV.somrs-leaders", "somrs-resignation")]
            subscribe += [f"{root}.*.{component}" for root in ("somrs-journal", "somrs-resignation")]
        subscribe.append("somrs-status.*")
    permitted: dict[str, object] = {"publish": list(dict.fromkeys(publish)), "subscribe": list(dict.fromkeys(subscribe))}
    # Who asks how a component is gets the answer at its own inbox.
    return permitted | ({"allow_responses": True} if identity.roles & _WITH_JOURNALS else {})


def proof_of_subject(credentials: Credentials, subject: str) -> Proof:
    """The proof of who has sent a message with this subject."""

    def prove() -> Identity:
        try:
            name = sender_of(subject)
        except ValueError as error:
            raise UsageError(str(error)) from None
        return credentials.identity_named(name, time.time())

    return prove


def may_answer(credentials: Credentials, bus: BusAddress, name: str, subject: str) -> bool:
    """Whether who has this name may answer what is sent to a subject of this bus: a component's, or the inbox of a process."""
    tokens = bus.tokens(subject)
    if tokens[0] == "processes":
        return tokens[1] == token_of(name)
    try:
        identity = credentials.identity_named(name, time.time())
    except UsageError:
        return False
    return _may_listen(identity, tokens)


def rights_on(bus: BusAddress) -> Callable[[Message, Identity], None]:
    """The check of a message on this bus: that its sender may send it, and that its addresses in this site are the sender's.

    It raises WireError with the code `DENIED`.
    """

    def check(message: Message, identity: Identity) -> None:
        check_right(message, identity)
        for field, address in addresses_in(message):
            if bus.covers(address) and not _may_listen(identity, path_tokens(urlsplit(address).path)):
                text = f"{identity.name} may not name {address[:200]} as {field}: it needs a certificate with which it can listen there"
                raise WireError(DENIED, text)

    return check


def _may_listen(identity: Identity, tokens: list[str]) -> bool:
    return any(_matches(pattern.split("."), tokens) for pattern in listening_patterns(identity))


def _matches(pattern: list[str], tokens: list[str]) -> bool:
    return len(pattern) == len(tokens) and all(part in ("*", token) for part, token in zip(pattern, tokens, strict=True))
