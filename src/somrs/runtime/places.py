"""Where programs listen, by their roles: so which addresses are theirs, and which a message of theirs may name as its sender.

Who may send a type of message (`protocol/messages/rights.py`) may still not send it for another one of the same role. Addresses with
other paths than those of SO-MRS are for devices of other makes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from urllib.parse import urlsplit

from somrs.errors import WireError
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.rights import DENIED
from somrs.runtime.bus_address import path_tokens, token_of
from somrs.runtime.reply_hosts import addresses_in
from somrs.trust.identity import Identity, Role

MOST_OF_A_KIND = 32
"""How many Task Managers, Registries and simulators a site with certificates has on a bus: NATS has no patterns within a token."""

_NUMBERS = range(2, MOST_OF_A_KIND + 1)
_SPOKEN = ("devices", "robots", "passages", "maps")
"""The first parts of paths at which a device listens; the second is its name."""


def _numbered(name: str) -> tuple[str, ...]:
    return (name, *(f"{name}-{number}" for number in _NUMBERS))


PATHS: dict[Role, tuple[str, ...]] = {
    Role.REPOSITORY: ("repository",),
    Role.REGISTRY: _numbered("registry"),
    Role.TASK_MANAGER: _numbered("task-manager"),
    Role.SCHEDULER: ("scheduler",),
    Role.TRAFFIC: ("traffic", "map-follower", *_numbered("simulator")),
    Role.API: ("news", "news.*"),
    Role.CLIENT: ("news", "news.*"),
    Role.VIEWER: ("news", "news.*"),
}
"""The paths at which programs listen, as subjects."""


def component_names(identity: Identity, role: Role) -> tuple[str, ...]:
    """The paths at which an identity with this role may listen, as subjects: of several Task Managers or Registries, one that has the name
    of one of them is this one."""
    patterns = PATHS.get(role, ())
    return (identity.name,) if role in (Role.TASK_MANAGER, Role.REGISTRY) and identity.name in patterns else patterns


@lru_cache(maxsize=2000)
def listening_patterns(identity: Identity) -> tuple[str, ...]:
    """The paths at which an identity may listen, as subjects without their site; `*` is any token."""
    fixed = [pattern for role in sorted(identity.roles) for pattern in component_names(identity, role)]
    names = sorted({identity.name, *identity.speaks_for}) if Role.DEVICE in identity.roles else []
    return (*fixed, *(f"{first}.{token_of(name)}" for name in names for first in _SPOKEN))


def may_listen(identity: Identity, tokens: list[str]) -> bool:
    """Whether a path is one of an identity's. `tokens`: as those of a subject."""
    return any(_matches(pattern.split("."), tokens) for pattern in listening_patterns(identity))


def check_addresses(message: Message, identity: Identity, is_of_site: Callable[[str], bool]) -> None:
    """Check the addresses in a message that are of the site, by the identity of its sender. Raises WireError with the code `DENIED`."""
    for field, address in addresses_in(message):
        if is_of_site(address) and not may_listen(identity, path_tokens(urlsplit(address).path)):
            text = f"{identity.name} may not name {address[:200]} as {field}: it needs a certificate with which it can listen there"
            raise WireError(DENIED, text)


def _matches(pattern: list[str], tokens: list[str]) -> bool:
    return len(pattern) == len(tokens) and all(part in ("*", token) for part, token in zip(pattern, tokens, strict=True))
