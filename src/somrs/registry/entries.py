"""What a Registry keeps, so that it knows who is there when it is started again."""

from __future__ import annotations

from msgspec import Struct

from somrs.protocol.messages.directory import Offer


class Listed(Struct, frozen=True, kw_only=True):
    """What a provider offers, until when; the latest counts. Without offers, it has left."""

    provider: str
    offers: tuple[Offer, ...]
    until: float
