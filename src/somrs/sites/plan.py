"""Rectangles on a floor plan: positions, overlaps, and moves that separate them. Units are metres and radians."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of `width` along its own x and `depth` along its y, rotated by `yaw` about its centre (`x`, `y`)."""

    x: float
    y: float
    width: float
    depth: float
    yaw: float = 0.0

    @property
    def axes(self) -> tuple[Point, Point]:
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return (cos, sin), (-sin, cos)

    @property
    def reach(self) -> float:
        """The distance of the corners from the centre."""
        return math.hypot(self.width, self.depth) / 2

    def corners(self) -> list[Point]:
        """The corners, counter-clockwise."""
        (u_x, u_y), (v_x, v_y) = self.axes
        w, d = self.width / 2, self.depth / 2
        return [(self.x + i * w * u_x + j * d * v_x, self.y + i * w * u_y + j * d * v_y) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]

    def local(self, point: Point) -> Point:
        """The point in the rectangle's own coordinates, with the origin at its centre."""
        dx, dy = point[0] - self.x, point[1] - self.y
        return tuple(dx * ax + dy * ay for ax, ay in self.axes)  # type: ignore[return-value]  # two axes, two numbers

    def world(self, local: Point) -> Point:
        (u_x, u_y), (v_x, v_y) = self.axes
        return self.x + local[0] * u_x + local[1] * v_x, self.y + local[0] * u_y + local[1] * v_y

    def moved(self, offset: Point) -> Box:
        return replace(self, x=self.x + offset[0], y=self.y + offset[1])

    def gap(self, point: Point) -> float:
        """The distance from the point to the rectangle; inside, minus the distance to the nearest edge."""
        u, v = self.local(point)
        du, dv = abs(u) - self.width / 2, abs(v) - self.depth / 2
        return math.hypot(max(du, 0), max(dv, 0)) if max(du, dv) > 0 else max(du, dv)


def separation(box: Box, other_box: Box) -> Point | None:
    """The shortest move of `box` that ends an overlap with `other_box`; None when they do not overlap (separating axes)."""
    if math.hypot(box.x - other_box.x, box.y - other_box.y) >= box.reach + other_box.reach:
        return None
    best: Point | None = None
    shortest = math.inf
    mine, theirs = box.corners(), other_box.corners()
    for ax, ay in (*box.axes, *other_box.axes):
        first_projection, second_projection = [x * ax + y * ay for x, y in mine], [x * ax + y * ay for x, y in theirs]
        forward, backward = max(second_projection) - min(first_projection), max(first_projection) - min(second_projection)
        if forward <= 0 or backward <= 0:
            return None
        if min(forward, backward) < shortest:
            shortest = min(forward, backward)
            sign = 1.0 if forward < backward else -1.0
            best = (ax * sign * shortest, ay * sign * shortest)
    return best


def cleared(box: Box, walls: Sequence[Box], margin: float = 0.01) -> Box | None:
    """The rectangle moved out of the walls, each time out of the one that it overlaps most; None if 8 moves are not enough."""
    for _ in range(8):
        pushes = [push for wall in walls if (push := separation(box, wall)) is not None]
        if not pushes:
            return box
        x, y = max(pushes, key=lambda push: math.hypot(*push))
        length = math.hypot(x, y)
        box = box.moved((x * (1 + margin / length), y * (1 + margin / length)))
    return None


def clearance(point: Point, boxes: Iterable[Box]) -> float:
    """The radius of the largest free disc around the point; negative inside a rectangle."""
    return min((box.gap(point) for box in boxes), default=math.inf)


def roomiest(point: Point, boxes: Sequence[Box], radius: float, reach: float) -> Point | None:
    """The nearest candidate point, at most `reach` away, around which a disc of the radius is free; None when there is none."""
    near_boxes = [box for box in boxes if box.gap(point) < reach + radius]
    candidates = [point] + [
        (point[0] + step * reach / 20 * math.cos(angle * math.pi / 16), point[1] + step * reach / 20 * math.sin(angle * math.pi / 16))
        for step in range(1, 21)
        for angle in range(32)
    ]
    return next((candidate for candidate in candidates if clearance(candidate, near_boxes) >= radius), None)


def is_in_polygon(point: Point, outline: Sequence[Point]) -> bool:
    """Whether the point is inside the polygon (crossing number)."""
    x, y = point
    crossings = False
    for (x1, y1), (x2, y2) in zip(outline, [*outline[1:], *outline[:1]], strict=True):
        if (y1 > y) != (y2 > y) and x < x1 + (y - y1) * (x2 - x1) / (y2 - y1):
            crossings = not crossings
    return crossings


def without_gap(start: Point, end: Point, gap: tuple[Point, Point], tolerance: float = 0.15) -> list[tuple[Point, Point]]:
    """The pieces of a wall from start to end that remain beside an opening; the whole wall when the opening is not in it.

    An opening is in the wall when both its ends are at most `tolerance` from the wall's line.
    """
    length = math.dist(start, end)
    if length == 0:
        return []
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    offsets = [(x - start[0]) * ux + (y - start[1]) * uy for x, y in gap]
    aside = [abs((y - start[1]) * ux - (x - start[0]) * uy) for x, y in gap]
    low, high = max(min(offsets), 0.0), min(max(offsets), length)
    if max(aside) > tolerance or high - low < 0.05:
        return [(start, end)]
    points = [(start[0] + t * ux, start[1] + t * uy) for t in (0.0, low, high, length)]
    return [piece for piece in ((points[0], points[1]), (points[2], points[3])) if math.dist(*piece) > 0.05]
