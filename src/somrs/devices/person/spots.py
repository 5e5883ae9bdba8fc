"""Where on a support a thing is that a person puts or sees there, as far as the map tells: people do not measure positions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

from somrs.entish.formula import Number
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.values import term

_SPACING = 0.1
"""Greatest distance between neighbours of the spots that are considered on a support, m."""
_EDGE = 0.12
"""Distance of the spots from the edge of the support, m."""
_APART = 0.2
"""Distance from other things that is as good as any greater one, m."""
Point = tuple[float, float]


async def free_spot(map: MapReader, person: str, support: str, taken: Sequence[Point] = ()) -> tuple[float, float, float]:
    """A spot near the edge of the support, close neither to the things on it nor to `taken`, on the side of the person; and its height."""
    [x, y, z, height, width, depth, radius] = [
        await _number(map, f"{support}.{path}")
        for path in ("PositionX", "PositionY", "PositionZ", "Shape.Height", "Shape.Width", "Shape.Depth", "Shape.Radius")
    ]
    yaw = await _number(map, f"{support}.RotationZ")
    standing = (await _number(map, f"{person}.PositionX"), await _number(map, f"{person}.PositionY"))
    others: list[Point] = [*taken]
    for row in await map.query(f"?Thing isOn {support} AND ?Thing.PositionX = ?X AND ?Thing.PositionY = ?Y"):
        spot_x, spot_y = term(str(row["X"])), term(str(row["Y"]))
        if isinstance(spot_x, Number) and isinstance(spot_y, Number):
            others.append((spot_x.value, spot_y.value))
    half_width, half_depth = (max((size or 2 * radius) / 2 - _EDGE, 0.0) for size in (width, depth))
    edge = [(u, v) for u, v in product(_steps(half_width), _steps(half_depth)) if u in (-half_width, half_width) or abs(v) == half_depth]
    spots = [(x + u * math.cos(yaw) - v * math.sin(yaw), y + u * math.sin(yaw) + v * math.cos(yaw)) for u, v in edge]

    def rate(spot: Point) -> tuple[float, float]:
        return min([_APART, *(math.dist(spot, other) for other in others)]), -math.dist(spot, standing)

    best = max(spots, key=rate)
    return best[0], best[1], z + height


def _steps(half: float) -> list[float]:
    """Evenly spaced offsets from -half to half."""
    count = math.ceil(half / _SPACING)
    return [half * step / count for step in range(-count, count + 1)] if count else [0.0]


async def _number(map: MapReader, attribute: str) -> float:
    """The value of the attribute; 0 if the map has none."""
    rows = await map.query(f"{attribute} = ?Value", limit=1)
    value = term(str(rows[0]["Value"])) if rows else None
    return value.value if isinstance(value, Number) else 0.0
