"""How long a lease lasts: what its holder asked for, within limits."""

from __future__ import annotations

import math

from somrs.errors import UsageError

SHORTEST = 1.0
"""Seconds; a shorter lease would be lost to one lost message."""

LONGEST = 3600.0
"""Seconds; a longer one would keep the silent on the books all day."""


def grant_lease(requested: float) -> float:
    """The lease in seconds. Raises UsageError for what is no duration."""
    if not math.isfinite(requested) or requested <= 0:
        raise UsageError(f"a lease of {requested} s is not one: ask for {SHORTEST:.0f} to {LONGEST:.0f} seconds")
    return min(max(requested, SHORTEST), LONGEST)
