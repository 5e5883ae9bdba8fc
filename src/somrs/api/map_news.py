"""News of the topic `map`."""

from __future__ import annotations

from msgspec import Struct

from somrs.ontology.objects import Change


class MapNews(Struct, frozen=True, kw_only=True):
    """`changes` brought the map to `version`. `read`: anything may have changed; read the map again."""

    version: int
    changes: tuple[Change, ...] = ()
    read: bool = False
