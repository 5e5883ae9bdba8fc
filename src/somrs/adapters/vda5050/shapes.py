"""Outlines of zones, lines that are driven, and curves that vehicles plan. Lengths are in metres."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from somrs.adapters.vda5050.messages.orders import Trajectory
from somrs.space.lines import point_distance
from somrs.space.solids import polygon_distance

Point = tuple[float, float]

STEP = 0.1
"""Distance between the points at which lines are looked at."""

SPAN_POINTS = 8
"""How many points of a curve are calculated between two of its knots."""


def counterclockwise(outline: Sequence[Point]) -> tuple[Point, ...]:
    """The corners of a polygon in this direction (3.0, 7.6)."""
    area = sum(x * v - u * y for (x, y), (u, v) in _sides(outline))
    return tuple(outline) if area >= 0.0 else tuple(reversed(outline))


def distance(outline: Sequence[Point], point: Point) -> float:
    """How far a point is from a polygon; 0 inside."""
    return max(0.0, polygon_distance(outline, *point))


def distance_to_line(point: Point, line: Sequence[Point]) -> float:
    """How far a point is from a polyline; infinite if that is empty."""
    if len(line) == 1:
        return math.dist(point, line[0])
    return min((point_distance(point, start, end) for start, end in pairwise(line)), default=math.inf)


def points_along(line: Sequence[Point]) -> Iterator[Point]:
    """Points on a polyline, `STEP` apart at most."""
    yield from line[:1]
    for (x, y), (u, v) in pairwise(line):
        count = max(1, math.ceil(math.dist((x, y), (u, v)) / STEP))
        yield from ((x + (u - x) * index / count, y + (v - y) * index / count) for index in range(1, count + 1))


def comes_near(line: Sequence[Point], outline: Sequence[Point], reach: float) -> bool:
    """Whether a disc of this radius touches a polygon when its middle moves along a polyline."""
    stretches = [*pairwise(line)] or [(point, point) for point in line]
    near = (stretch for stretch in stretches if _boxes_meet(stretch, outline, reach))
    return any(distance(outline, point) <= reach for stretch in near for point in points_along(stretch))


def overlap(first: Sequence[Point], second: Sequence[Point]) -> bool:
    """Whether two convex polygons have more in common than their edges."""
    if not _boxes_meet(first, second, 0.0):
        return False
    for (x, y), (u, v) in (*_sides(first), *_sides(second)):
        normal = v - y, x - u
        low, high = ([normal[0] * point[0] + normal[1] * point[1] for point in outline] for outline in (first, second))
        if max(low) <= min(high) + 1e-9 or max(high) <= min(low) + 1e-9:
            return False
    return True


def curve_points(trajectory: Trajectory) -> list[Point]:
    """Points on a NURBS curve, from its start to its end. Raises ValueError when it is none (3.0, 7.3)."""
    degree, points = trajectory.degree or 1, trajectory.control_points
    weights = [point.weight if point.weight is not None else 1.0 for point in points]
    knots = trajectory.knot_vector or _uniform_knots(degree, len(points))
    if degree < 1 or len(points) <= degree or len(knots) != len(points) + degree + 1:
        raise ValueError("the numbers of its knots and control points do not fit its degree")
    if any(end < start for start, end in pairwise(knots)) or knots[0] == knots[-1] or min(weights) <= 0.0:
        raise ValueError("its knots do not grow, or a weight is not positive")
    numbers = [value for point in points for value in (point.x, point.y)]
    if not all(map(math.isfinite, (*numbers, *weights, *knots))):
        raise ValueError("a number is not finite")
    spots = [(point.x * weight, point.y * weight, weight) for point, weight in zip(points, weights, strict=True)]
    spans = [(start, end) for start, end in pairwise(knots[degree : len(points) + 1]) if start < end]
    count = 1 if degree == 1 else SPAN_POINTS
    places = [start + (end - start) * index / count for start, end in spans for index in range(count)]
    return [_curve_point(degree, knots, spots, place) for place in (*places, spans[-1][1])]


def _uniform_knots(degree: int, count: int) -> tuple[float, ...]:
    inner = count - degree - 1
    return (*[0.0] * (degree + 1), *(index / (inner + 1) for index in range(1, inner + 1)), *[1.0] * (degree + 1))


def _curve_point(degree: int, knots: Sequence[float], spots: Sequence[tuple[float, float, float]], place: float) -> Point:
    """De Boor's algorithm in homogeneous coordinates."""
    span = max(index for index in range(degree, len(spots)) if knots[index] <= place and knots[index] < knots[index + 1])
    near = [*spots[span - degree : span + 1]]
    for level in range(1, degree + 1):
        for index in range(degree, level - 1, -1):
            low, high = knots[index + span - degree], knots[index + 1 + span - level]
            share = (place - low) / (high - low)
            near[index] = tuple(  # type: ignore[assignment]
                (1.0 - share) * start + share * end for start, end in zip(near[index - 1], near[index], strict=True)
            )
    x, y, weight = near[degree]
    return x / weight, y / weight


def _boxes_meet(first: Sequence[Point], second: Sequence[Point], reach: float) -> bool:
    """Whether the boxes around some points and others are no farther from each other."""
    for axis in (0, 1):
        one, two = ([point[axis] for point in points] for points in (first, second))
        if max(one) + reach < min(two) or max(two) + reach < min(one):
            return False
    return True


def _sides(outline: Sequence[Point]) -> Iterator[tuple[Point, Point]]:
    return zip(outline, (*outline[1:], outline[0]), strict=True)
