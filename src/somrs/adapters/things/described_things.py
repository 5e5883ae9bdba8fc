"""Things that describe or announce themselves, resolved like those of mapping files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import aiohttp
from msgspec import Struct, structs

from somrs.adapters.things.connections import parse_connection
from somrs.adapters.things.home_assistant import Discovered
from somrs.adapters.things.model import Connection, Thing
from somrs.adapters.things.resolving import Resolver
from somrs.adapters.things.thing_description import Described, read_description
from somrs.adapters.things.thing_names import ThingNames
from somrs.errors import InputError
from somrs.ontology.types import Ontology

ADDRESS = re.compile(r"https?://")
MOST_BYTES = 1 << 20


class ResolvedThing(Struct, frozen=True, kw_only=True):
    """A thing, what it is defined by, and its connections."""

    thing: Thing
    ontology: Ontology
    connections: Mapping[str, Connection]


async def load_description(place: str, folder: Path) -> tuple[str, str]:
    """The text of a Thing Description, and its address. `place`: a file, or an address. Raises InputError, and OSError."""
    if not ADDRESS.match(place):
        path = folder / place
        try:
            return path.read_text("utf-8-sig"), path.resolve().as_uri()
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path} cannot be read: {error}; correct the name, which is relative to the site file") from error
    async with aiohttp.ClientSession() as session, session.get(place) as answer:
        if answer.status >= 400:
            raise InputError(f"{place} answers {answer.status} {answer.reason}; correct the address")
        return (await answer.content.read(MOST_BYTES)).decode("utf-8", "replace"), place


def resolve_description(
    text: str,
    address: str,
    ontology: Ontology,
    connections: Mapping[str, Connection],
    names: ThingNames | None = None,
    taken_names: frozenset[str] = frozenset(),
) -> ResolvedThing:
    """The thing of a Thing Description. Connections of the settings with the same address are used. Raises InputError."""
    described = read_description(text, address, ontology, names if names is not None else ThingNames(), taken_names)
    used_connections: dict[str, Connection] = {}
    for name, entry in described.connections.items():
        connection, security = parse_connection(name, entry), described.securities.get(name)
        configured = _configured(connection, security, connections)
        used_connections[name] = configured if configured is not None else connection
        if configured is None and security not in (None, "nosec"):
            need = _NEEDS.get(str(security))
            advice = f"name a connection with the address {connection} in the settings, with {need}" if need else "it is not supported"
            text = f"the security scheme {security}: {advice}"
            described = structs.replace(described, unsupported=(*described.unsupported, text))
    return _resolved(described, ontology.extended(described.definitions), used_connections, address)


def resolve_discovered(discovered: Discovered, ontology: Ontology, connections: Mapping[str, Connection]) -> ResolvedThing:
    """The thing that messages announce. Raises InputError."""
    return _resolved(discovered, ontology, connections, "Home Assistant's discovery")


_NEEDS = {"basic": "user and password_file", "bearer": "password_file, which has the token, and no user"}
"""What a connection has for the security schemes that are supported."""


def _configured(connection: Connection, security: str | None, connections: Mapping[str, Connection]) -> Connection | None:
    """The connection of the settings to the same server that has what the security scheme needs; None if there is none.

    A password is only sent to what asks for it: several things with passwords of their own may be behind one address.
    """
    for configured in connections.values():
        if (configured.scheme, configured.host, configured.port) == (connection.scheme, connection.host, connection.port):
            has_user, has_password = configured.user is not None, configured.password_file is not None
            fits = {"basic": has_user, "bearer": has_password and not has_user, "nosec": not has_password or connection.kind == "mqtt"}
            if security is None or fits.get(security, False):
                # What a description names has paths of its own, and no other connection has this name.
                name = configured.name if not configured.path else f"{connection.name} as {configured.name}"
                return structs.replace(configured, name=name, path="")
    return None


def _resolved(described: Described | Discovered, ontology: Ontology, connections: Mapping[str, Connection], source: str) -> ResolvedThing:
    resolver = Resolver(described.name, ontology, connections)
    thing = resolver.thing(described.entry)
    if thing is None:
        problems = "; ".join(f"{'.'.join(map(str, path))}: {message}" for path, message in resolver.problems)
        raise InputError(f"{described.name}, from {source}: {problems}")
    thing = structs.replace(thing, unsupported=described.unsupported)
    return ResolvedThing(thing=thing, ontology=ontology, connections=connections)
