"""The names of clients and authors: as recorded, and as people know them."""

from __future__ import annotations

from urllib.parse import quote, unquote

CLIENT = "urn:so-mrs:client:"
"""The prefix of a client without an address; answers go back on the connection."""


def client_address(name: str) -> str:
    """Return the sender's address for a client of this name."""
    return CLIENT + quote(name, safe="@")


def person_name(recorded: str) -> str:
    """Return the name as people know it, without the parts of an address around it."""
    name = recorded
    while name.startswith(CLIENT):
        name = unquote(name.removeprefix(CLIENT))
    if name.startswith(("urn:", "http:", "https:")):
        name = unquote(name.rstrip("/").rpartition("/")[2].rpartition(":")[2])
    return name or "somebody"
