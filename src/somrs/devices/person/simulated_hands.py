"""The hands of a person in the simulated world: what a person reports as done is done there, too, so that robots meet it.

In a real building nothing of this runs: the person has moved the thing.
"""

from __future__ import annotations

import logging
import math
from itertools import product

from somrs.devices.simulator.link.link import OperatorLink
from somrs.entish.formula import Formula, Name, Number, Relation, conjuncts
from somrs.entish.parse import parse
from somrs.errors import SomrsError
from somrs.service_manager.sdk.device import MapReader
from somrs.service_manager.sdk.values import term

log = logging.getLogger(__name__)

_SPACING = 0.1
"""Greatest distance between neighbours of the spots that are considered on a support, m."""
_EDGE = 0.12
"""Distance of the spots from the edge of the support, m."""
_APART = 0.2
"""Distance from other things that is as good as any greater one, m."""
_CLEARANCE = 0.02
"""Height above its support from which a thing is dropped, m."""
Point = tuple[float, float]


async def put_in_place(person: str, simulator: str | None, map: MapReader, effect: Formula) -> Formula:
    """Move the things that the effect says are on something, in the simulator at `simulator` (host:port), if there is one.

    Returns the effect with the positions that the things then have.
    """
    moves = [part.arguments for part in conjuncts(effect) if isinstance(part, Relation) and part.relation == "isOn"]
    pairs = [(thing.name, support.name) for thing, support in moves if isinstance(thing, Name) and isinstance(support, Name)]
    if simulator is None or not pairs:
        return effect
    host, _, port = simulator.rpartition(":")
    parts = [str(effect)]
    try:
        async with OperatorLink(host, int(port)) as operator:
            for thing, support in pairs:
                x, y, z = await _free_spot(map, person, support)
                await operator.move(thing, x, y, z)
                await operator.idle()
                state = await operator.observe(thing)
                position = zip("XYZ", (state.x, state.y, state.z), strict=True)
                parts += [f"{thing}.Position{axis} = {value:.3f}" for axis, value in position]
    except (SomrsError, OSError) as error:
        log.info("%s is not moved in a simulated world: %s", pairs[0][0], error)
    return parse(" AND ".join(parts))


async def _free_spot(map: MapReader, person: str, support: str) -> tuple[float, float, float]:
    """A spot near the edge of the support, not close to the things on it, on the side of the person; and its height."""
    [x, y, z, height, width, depth, radius] = [
        await _number(map, f"{support}.{path}")
        for path in ("PositionX", "PositionY", "PositionZ", "Shape.Height", "Shape.Width", "Shape.Depth", "Shape.Radius")
    ]
    yaw = await _number(map, f"{support}.RotationZ")
    standing = (await _number(map, f"{person}.PositionX"), await _number(map, f"{person}.PositionY"))
    others: list[Point] = []
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
    return best[0], best[1], z + height + _CLEARANCE


def _steps(half: float) -> list[float]:
    """Evenly spaced offsets from -half to half."""
    count = math.ceil(half / _SPACING)
    return [half * step / count for step in range(-count, count + 1)] if count else [0.0]


async def _number(map: MapReader, attribute: str) -> float:
    """The value of the attribute; 0 if the map has none."""
    rows = await map.query(f"{attribute} = ?Value", limit=1)
    value = term(str(rows[0]["Value"])) if rows else None
    return value.value if isinstance(value, Number) else 0.0
