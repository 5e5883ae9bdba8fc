"""Split long answers into pages that a node accepts.

A node refuses documents of more than 256 KiB. The limit here counts JSON. The XML on the wire is up to about five times as long, because
each small value has an element of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import TypeVar

import msgspec

PAGE_BYTES = 40_000
"""The size of a page as JSON. A single larger item has a page to itself."""

PAGE_ITEMS = 200

T = TypeVar("T")


def size(value: object) -> int:
    """Return the size of the value as JSON, in bytes."""
    return len(msgspec.json.encode(value))


def fit_page(items: Iterable[T], limit: int = PAGE_ITEMS, max_bytes: int = PAGE_BYTES) -> Iterator[T]:
    """Yield the first items, as many as fit on one page; at least one."""
    used_bytes = 0
    for number, item in enumerate(islice(items, limit)):
        used_bytes += size(item)
        if used_bytes > max_bytes and number > 0:
            return
        yield item


def pages(items: Iterable[T], max_bytes: int = PAGE_BYTES) -> Iterator[list[T]]:
    """Split the items into pages, each with as many as fit."""
    page: list[T] = []
    used_bytes = 0
    for item in items:
        item_bytes = size(item)
        if page and used_bytes + item_bytes > max_bytes:
            yield page
            page, used_bytes = [], 0
        page.append(item)
        used_bytes += item_bytes
    if page:
        yield page
