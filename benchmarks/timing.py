"""Times several ways of doing something, in turns in one run, so that other load on the machine affects all of them alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping

ROUNDS = 9
ROUND_TIME = 0.02
"""The minimum duration of each way in a round, in seconds."""

UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def side_by_side(title: str, ways: Mapping[str, Callable[[], object]], rounds: int = ROUNDS) -> None:
    """Print the median time of each way, its best time, and the ratio of its median to that of the first way."""
    repeats = {name: _repeats(way) for name, way in ways.items()}
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            times[name].append(_seconds(way, repeats[name]))
    first = statistics.median(times[next(iter(ways))])
    print(f"\n{title:48} {'median':>10} {'best':>10} {'ratio':>8}")
    for name, durations in times.items():
        median = statistics.median(durations)
        print(f"  {name:46} {format_time(median):>10} {format_time(min(durations)):>10} {median / first:8.2f}")


def format_time(seconds: float) -> str:
    """Return the time as text, in a suitable unit."""
    scale, unit = next((entry for entry in UNITS if seconds >= entry[0]), UNITS[-1])
    return f"{seconds / scale:.3g} {unit}"


def _repeats(way: Callable[[], object]) -> int:
    """Return how often to repeat the way in a round. The first run also warms it up."""
    first_time = _seconds(way, 1)
    return max(1, round(ROUND_TIME / max(min(first_time, _seconds(way, 1)), 1e-7)))


def _seconds(way: Callable[[], object], repeats: int) -> float:
    """Return the mean seconds of one run over so many runs."""
    started = time.perf_counter()
    for _ in range(repeats):
        way()
    return (time.perf_counter() - started) / repeats
