"""Collision avoidance between robots: each robot claims the space that it occupies or needs to stop.

Claims are capsules (a line with a radius): for the base from its position to where it can stop, and for the boom while it is extended.
A robot takes a new claim only if it overlaps no other robot's claims. Robots renew claims one after the other, so claims never overlap.
"""

from __future__ import annotations

from dataclasses import dataclass

from somrs.space.lines import segment_distance
from somrs.space.solids import Point

GAP = 0.02
"""Distance that robots keep between their outlines, m."""


@dataclass(frozen=True, slots=True)
class Capsule:
    """All points within `radius` of the line from `start` to `end`."""

    start: Point
    end: Point
    radius: float

    def gap(self, capsule: Capsule) -> float:
        """Distance between two capsules; negative if they overlap."""
        return segment_distance(self.start, self.end, capsule.start, capsule.end) - self.radius - capsule.radius
