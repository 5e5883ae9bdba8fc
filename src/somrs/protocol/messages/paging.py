"""Cutting long answers into pages that a node accepts.

A node refuses documents of more than 256 kB. What is counted here is JSON, of which the XML on the wire is up to about five
times as long, because each small value gets an element with a name of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import TypeVar

import msgspec

PAGE_BYTES = 40_000
"""As JSON. One thing that is larger than this still gets a page, to itself."""

PAGE_ITEMS = 200

T = TypeVar("T")


def size(value: object) -> int:
    """The bytes of the value as JSON."""
    return len(msgspec.json.encode(value))


def fit_page(items: Iterable[T], limit: int = PAGE_ITEMS, max_bytes: int = PAGE_BYTES) -> Iterator[T]:
    """As many of the first items as go on one page; the first one in any case."""
    used_bytes = 0
    for number, item in enumerate(islice(items, limit)):
        used_bytes += size(item)
        if used_bytes > max_bytes and number > 0:
            return
        yield item
