"""A subscription to the changes of a component that others follow (`following.py`)."""

from __future__ import annotations

from msgspec import Struct


class Subscription(Struct, frozen=True, kw_only=True):
    """A subscription to changes until `until`, in seconds; `version` is the version at which the client subscribed.

    `own`: to changes of what the publisher itself owns, and not of what it follows of others.
    """

    until: float
    version: int
    own: bool = False
