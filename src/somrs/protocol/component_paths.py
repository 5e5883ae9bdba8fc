"""The paths of SO-MRS in addresses. Other paths are those of devices of other makes."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote, urlsplit

FIRST_PARTS = frozenset(
    {
        "repository",
        "registry",
        "task-manager",
        "scheduler",
        "traffic",
        "simulator",
        "map-follower",
        "news",
        "devices",
        "robots",
        "passages",
        "maps",
    }
)
"""The first parts of paths at which programs of SO-MRS listen, without the numbers of those of which there are several."""

_NUMBER, _PORT = re.compile(r"-\d+$"), re.compile(r":\d+$")


def is_of_component(address: str) -> bool:
    """Whether an address has a path of SO-MRS."""
    if not address.startswith(("http://", "https://")):
        return False
    return _NUMBER.sub("", unquote(urlsplit(address).path).strip("/").partition("/")[0]) in FIRST_PARTS


def scheme_change(earlier: str, address: str) -> Callable[[Any], Any] | None:
    """A function that changes the scheme of addresses as it has changed between two addresses of a component of one host; None if it has
    not.

    It takes data of texts, numbers, lists and dictionaries, and changes the addresses of that host that have a path of SO-MRS.
    """
    was, now = urlsplit(earlier), urlsplit(address)
    if was.scheme == now.scheme or was.hostname != now.hostname or not {was.scheme, now.scheme} <= {"http", "https"}:
        return None
    host = re.escape(_PORT.sub("", was.netloc))
    pattern = re.compile(rf"\b{was.scheme}://{host}(:\d+)?/[^\s,;\"']*")

    def change_text(text: str) -> str:
        return pattern.sub(lambda found: now.scheme + found[0][len(was.scheme) :] if is_of_component(found[0]) else found[0], text)

    def change(value: Any) -> Any:
        match value:
            case str():
                return change_text(value) if "://" in value else value
            case list():
                return [change(item) for item in value]
            case tuple():  # a key of a dictionary
                return tuple(change(item) for item in value)
            case dict():
                return {change(key): change(item) for key, item in value.items()}
        return value

    return change
