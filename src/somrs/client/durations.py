"""Durations as texts for users."""

from __future__ import annotations


def format_duration(seconds: float) -> str:
    """Format a duration: `4.2 s`, `15 s`, `3 min`, `2 h 5 min`."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"
