"""The duration of a lease: what the holder requests, within limits."""

from __future__ import annotations

import math

from somrs.errors import UsageError

SHORTEST = 1.0
"""In seconds. With a shorter lease, one lost message would lose the lease."""

LONGEST = 3600.0
"""In seconds. With a longer lease, a silent provider would stay registered for too long."""


def grant_lease(requested: float) -> float:
    """Return the granted lease in seconds. Raises UsageError when `requested` is not a positive number."""
    if not math.isfinite(requested) or requested <= 0:
        raise UsageError(f"a lease of {requested} s is not valid: request {SHORTEST:.0f} to {LONGEST:.0f} seconds")
    return min(max(requested, SHORTEST), LONGEST)
