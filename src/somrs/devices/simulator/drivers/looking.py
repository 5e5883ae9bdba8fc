"""Looking at a place: what simulated robots and cameras report of the things that they see there."""

from __future__ import annotations

from collections.abc import Iterable

from somrs.devices.simulator.drivers.simulated import format_number, metres
from somrs.devices.simulator.link.commands import ObjectState
from somrs.service_manager.sdk.device import Task
from somrs.service_manager.sdk.orders import Refusal

LOOK_HEIGHT = 0.1
"""Height above the top of an object at which its surroundings are looked at, m."""


async def point_at(task: Task, place: str) -> tuple[float, float, float]:
    """A point just above an object, where things on it are. Raises Refusal if the map does not say where it is."""
    rows = await task.map.query(f"{place}.PositionX = ?X AND {place}.PositionY = ?Y AND {place}.PositionZ = ?Z", limit=1)
    if not rows:
        raise Refusal(f"the map does not say where {place} is")
    heights = await task.map.query(f"{place}.Shape.Height = ?Height", limit=1)
    x, y, z = (metres(rows[0][axis]) for axis in "XYZ")
    return x, y, z + (metres(heights[0]["Height"]) if heights else 0.0) + LOOK_HEIGHT


def describe_things(place: str, object_states: Iterable[ObjectState]) -> list[str]:
    """Which things are on or in the place, and where exactly, as parts of a formula."""
    parts: list[str] = []
    for state in object_states:
        if place not in (state.support, state.container):
            continue
        parts.append(f"{state.object} {'isOn' if state.support == place else 'isIn'} {place}")
        parts += [f"{state.object}.Position{axis} = {format_number(v)}" for axis, v in zip("XYZ", (state.x, state.y, state.z), strict=True)]
        parts.append(f"{state.object}.Unknown = FALSE")
    return parts
