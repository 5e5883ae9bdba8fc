"""The number of examples of property tests: few enough for a run of all tests or, with EXAMPLES=20 in the environment, 20 times as many.

A run of all tests uses the same examples every time, so its failures can be repeated. `make properties` uses new ones.
"""

import os

from hypothesis import HealthCheck, Phase, settings
from hypothesis.database import DirectoryBasedExampleDatabase

FACTOR = int(os.environ.get("EXAMPLES", "1"))

PHASES = [phase for phase in Phase if phase is not Phase.shrink or "NO_SHRINKING" not in os.environ]
"""Shrinking is skipped with NO_SHRINKING: mutation tests need only the failure, and not the smallest example."""

PROFILE = settings(
    deadline=None,  # a busy machine is not an error
    suppress_health_check=[HealthCheck.too_slow],
    derandomize=FACTOR == 1,
    database=None if FACTOR == 1 else DirectoryBasedExampleDatabase(".hypothesis/examples"),
    max_examples=50 * FACTOR,
    phases=PHASES,
)


def examples(count: int) -> settings:
    """A decorator that sets the number of examples of a property test."""
    return settings(PROFILE, max_examples=count * FACTOR)
