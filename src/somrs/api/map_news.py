"""News of the topic `map`."""

from __future__ import annotations

from msgspec import Struct

from somrs.ontology.objects import Change


class MapNews(Struct, frozen=True, kw_only=True):
    """The map came to `version` by `changes`; with `read`, anything may have changed: read it again."""

    version: int
    changes: tuple[Change, ...] = ()
    read: bool = False
