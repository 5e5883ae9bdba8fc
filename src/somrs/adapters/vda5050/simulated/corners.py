"""When a simulated vehicle has come to a node at which it need not stop."""

from __future__ import annotations

import math
from collections.abc import Sequence

from somrs.adapters.vda5050.messages.orders import Node

NEAR = 0.08
"""A vehicle that is this near to a node has come to it, m. It drives on to the next node from there, and so cuts the corner by less."""

Point = tuple[float, float]


def has_come(nodes: Sequence[Node], place: Point, earlier: Point) -> bool:
    """Whether a vehicle that was at one place and is at another, m, has come to the first of the nodes ahead; or has left it behind, on
    the way to the second, between two looks."""
    positions = [(node.node_position.x, node.node_position.y) for node in nodes[:2] if node.node_position is not None]
    if len(positions) < 2:
        return False
    node, following = positions
    if math.dist(place, node) <= NEAR:
        return True
    return math.dist(place, node) > math.dist(earlier, node) and _distance(place, node, following) <= NEAR


def _distance(point: Point, start: Point, end: Point) -> float:
    """The distance of a point from a line between two others, m."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.hypot(dx, dy)
    x, y = point[0] - start[0], point[1] - start[1]
    along = (x * dx + y * dy) / length if length else -1.0
    return abs(x * dy - y * dx) / length if along > 0 else math.inf
