"""How many examples property tests try: as many as fit a run of all tests, or, with EXAMPLES=20 in the environment, 20 times as many.

In a run of all tests they are the same every time: what is found there, everybody finds. `make properties` looks for others.
"""

import os

from hypothesis import HealthCheck, Phase, settings
from hypothesis.database import DirectoryBasedExampleDatabase

FACTOR = int(os.environ.get("EXAMPLES", "1"))

PHASES = [phase for phase in Phase if phase is not Phase.shrink or "NO_SHRINKING" not in os.environ]
"""Who only asks whether a test fails does not wait for the smallest example with which it does."""

PROFILE = settings(
    deadline=None,  # a busy machine is no defect
    suppress_health_check=[HealthCheck.too_slow],
    derandomize=FACTOR == 1,
    database=None if FACTOR == 1 else DirectoryBasedExampleDatabase(".hypothesis/examples"),
    max_examples=50 * FACTOR,
    phases=PHASES,
)


def examples(count: int) -> settings:
    """Try so many examples; a decorator for a property test."""
    return settings(PROFILE, max_examples=count * FACTOR)
