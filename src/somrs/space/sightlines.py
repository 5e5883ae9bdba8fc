"""Lines of sight: which upright boxes and cylinders are between two points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from somrs.space.distances import Array
from somrs.space.solids import Solid

Place = tuple[float, float, float]
_TINY = 1e-12


def hull(solid: Solid) -> Solid:
    """The box around a polygon; other solids are as they are."""
    if solid.form != "Polygon":
        return solid
    xs, ys = [x for x, _ in solid.outline], [y for _, y in solid.outline]
    x, y = solid.world((min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2)
    return replace(solid, form="Box", x=x, y=y, width=max(xs) - min(xs), depth=max(ys) - min(ys), outline=())


class Prisms:
    """Boxes and cylinders as arrays. `names`: whose they are, one for each."""

    def __init__(self, names: Sequence[str], solids: Sequence[Solid]) -> None:
        self._numbers: dict[str, list[int]] = {}
        for number, name in enumerate(names):
            self._numbers.setdefault(name, []).append(number)
        self._boxes = np.array([solid.form == "Box" for solid in solids], dtype=bool)
        self._half = np.array([(solid.width / 2, solid.depth / 2) for solid in solids]).reshape(-1, 2)
        self._radius = np.array([solid.radius for solid in solids])
        self._height = np.array([solid.height for solid in solids])
        self.place([(solid.x, solid.y, solid.z, solid.yaw) for solid in solids])

    def place(self, poses: Sequence[tuple[float, float, float, float]]) -> None:
        """Put the prisms at these poses: the middle of the underside, and the yaw."""
        self._poses = np.array(poses, dtype=float).reshape(-1, 4)
        self._cos, self._sin = np.cos(self._poses[:, 3]), np.sin(self._poses[:, 3])

    def hide(self, start: Place, end: Place, ignored: set[str]) -> bool:
        """Whether a prism, except those of the ignored names, is between two points."""
        if not len(self._boxes):
            return False
        enter, leave = self._spans(np.asarray(start), np.asarray(end))
        hits = (enter <= leave) & (leave > 0.0) & (enter < 1.0)
        for name in ignored:
            hits[self._numbers.get(name, [])] = False
        return bool(hits.any())

    def share_until(self, start: Place, end: Place, ignored: set[str]) -> float:
        """How much of the line from start to end is before the first prism, except those of the ignored names; 1.0 if none is on it."""
        return float(self.shares_until(start, np.asarray([end], dtype=float), ignored)[0])

    def shares_until(self, start: Place, ends: Array, ignored: set[str]) -> Array:
        """The same for lines to several ends, n × 3: a share for each."""
        enter, leave = self._spans(np.asarray(start), ends)
        shares = np.where((enter <= leave) & (leave > 0.0), np.clip(enter, 0.0, 1.0), 1.0)
        for name in ignored:
            shares[:, self._numbers.get(name, [])] = 1.0
        nearest: Array = shares.min(axis=1, initial=1.0)
        return nearest

    def _spans(self, start: Array, end: Array) -> tuple[Array, Array]:
        """For each prism, where the line from start to end enters and leaves it, as shares of its length; if it does not meet it, it leaves
        before it enters. For several ends, a row for each."""
        x, y, z = np.moveaxis(end - start, -1, 0)[..., None]
        (along_u, along_v), (u, v) = self._turned(x, y), self._turned(*(start[:2] - self._poses[:, :2]).T)
        enter, leave = _span(start[2] - self._poses[:, 2] - self._height / 2, z, self._height / 2)
        first_u, last_u = _span(u, along_u, self._half[:, 0])
        first_v, last_v = _span(v, along_v, self._half[:, 1])
        first_round, last_round = _round_span(u, v, along_u, along_v, self._radius)
        enter = np.maximum(enter, np.where(self._boxes, np.maximum(first_u, first_v), first_round))
        leave = np.minimum(leave, np.where(self._boxes, np.minimum(last_u, last_v), last_round))
        return enter, leave

    def _turned(self, x: Array | float, y: Array | float) -> tuple[Array, Array]:
        """A vector in the frame of each prism."""
        return self._cos * x + self._sin * y, self._cos * y - self._sin * x


def _span(start: Array, along: Array, half: Array) -> tuple[Array, Array]:
    """The parts of lines, as shares of their lengths, between -half and half of one axis; from infinity to -infinity for none."""
    moves = np.abs(along) > _TINY
    rate = np.where(moves, along, 1.0)
    first, second = (-half - start) / rate, (half - start) / rate
    within = np.where(np.abs(start) <= half, math.inf, -math.inf)
    return np.where(moves, np.minimum(first, second), -within), np.where(moves, np.maximum(first, second), within)


def _round_span(u: Array, v: Array, along_u: Array, along_v: Array, radius: Array) -> tuple[Array, Array]:
    """The parts of lines within circles about the origin, in the same way."""
    square, half_slope = along_u**2 + along_v**2, u * along_u + v * along_v
    excess = u**2 + v**2 - radius**2
    moves = square > _TINY
    root = half_slope**2 - square * excess
    width, rate = np.sqrt(np.maximum(root, 0.0)), np.where(moves, square, 1.0)
    within = np.where(np.where(moves, root >= 0, excess <= 0), math.inf, -math.inf)
    first = np.where(moves & (root >= 0), (-half_slope - width) / rate, -within)
    last = np.where(moves & (root >= 0), (width - half_slope) / rate, within)
    return first, last
