"""How many of a kind a component keeps for others, at most.

This is decided before a request is an input of the component. So a limit may be changed, and a journal is continued as it was written.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Protocol, runtime_checkable

from somrs.errors import UsageError
from somrs.limits import PREFIX, Limits
from somrs.protocol.messages.envelope import Message


@runtime_checkable
class Admitting(Protocol):
    """A component that does not take every request."""

    def check_admitted(self, message: Message, bounds: Limits) -> None:
        """Raises UsageError for a request that would be one too many. Changes nothing."""
        ...


def check_room(limit: str, bounds: Limits, kept: Collection[object], new: object = None) -> None:
    """Check that there is room for a new one among those that are kept, or that it is one of them. Raises UsageError.

    `limit`: the name of the limit, which says what is kept.
    """
    most: int = getattr(bounds, limit)
    if len(kept) >= most and new not in kept:
        raise UsageError(
            f"there are {len(kept)} {limit} here, and {most} is the limit; try again later, or set {PREFIX}{limit.upper()} where this runs"
        )
