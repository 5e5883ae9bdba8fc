"""Ways of doing something, timed side by side: in turns, in one run, so that what else the machine does strikes all of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping

ROUNDS = 9
ROUND_TIME = 0.02
"""Seconds that each way gets in a round, at the least."""

UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def side_by_side(title: str, ways: Mapping[str, Callable[[], object]], rounds: int = ROUNDS) -> None:
    """Print the median time of each way, its best, and how many times the median of the first way that is."""
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
    """The time in a unit that suits it."""
    scale, unit = next((entry for entry in UNITS if seconds >= entry[0]), UNITS[-1])
    return f"{seconds / scale:.3g} {unit}"


def _repeats(way: Callable[[], object]) -> int:
    """How often to do it in a round; doing it once before also warms it up."""
    first_time = _seconds(way, 1)
    return max(1, round(ROUND_TIME / max(min(first_time, _seconds(way, 1)), 1e-7)))


def _seconds(way: Callable[[], object], repeats: int) -> float:
    """Seconds that it takes once, over so many times."""
    started = time.perf_counter()
    for _ in range(repeats):
        way()
    return (time.perf_counter() - started) / repeats
