"""Who asks, and who changed something: as it is recorded, and as people know them."""

from __future__ import annotations

from urllib.parse import quote, unquote

CLIENT = "urn:so-mrs:client:"
"""Before the name of one who asks, and has no address: answers come on the connection."""


def client_address(name: str) -> str:
    """As whom somebody of that name asks."""
    return CLIENT + quote(name, safe="@")


def person_name(recorded: str) -> str:
    """Who it was, as people know them: without what addresses have around a name."""
    name = recorded
    while name.startswith(CLIENT):
        name = unquote(name.removeprefix(CLIENT))
    if name.startswith(("urn:", "http:", "https:")):
        name = unquote(name.rstrip("/").rpartition("/")[2].rpartition(":")[2])
    return name or "somebody"
