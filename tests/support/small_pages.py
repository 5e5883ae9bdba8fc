"""Maps that count as large already when they are small, and count the entries that are gone through in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from somrs.ontology import indexes, paged


@dataclass
class Visits:
    """How many entries of large mappings were gone through."""

    count: int = 0


@contextmanager
def small_pages(page: int = 4) -> Iterator[Visits]:
    """Let mappings be large from two pages on, with so many entries in a page."""
    visits, in_order = Visits(), paged._in_order

    def counted(keys: Iterable[Any]) -> list[Any]:
        ordered = in_order(keys)
        visits.count += len(ordered)
        return ordered

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paged, "LARGE", 2 * page)
        patch.setattr(paged, "PAGE", page)
        patch.setattr(indexes, "FEW", 2)
        patch.setattr(paged, "_in_order", counted)
        yield visits
