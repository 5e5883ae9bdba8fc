"""Why no step of a plan may involve an object: another task has reserved it, or its place and state are not known."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.planner.model.plan import Obstacle
from somrs.planner.model.problem import Problem


def exclusion_text(excluded_names: Sequence[str], problem: Problem) -> str:
    """Text for why no step may involve these excluded objects."""
    unknown = [name for name in excluded_names if name in problem.unknown]
    reserved = [name for name in excluded_names if name not in problem.unknown]
    parts: list[str] = []
    if reserved:
        parts.append(f"{' and '.join(reserved)} {'is reserved by another task' if len(reserved) == 1 else 'are reserved by other tasks'}")
    if unknown:
        parts.append(f"the place and state of {' and '.join(unknown)} are unknown")
    return ", and ".join(parts)


def exclusion_obstacles(excluded_names: Sequence[str], problem: Problem) -> tuple[Obstacle, ...]:
    """The kinds of reasons why no step may involve these excluded objects."""
    return tuple(dict.fromkeys(Obstacle.UNKNOWN if name in problem.unknown else Obstacle.PROMISED for name in excluded_names))
