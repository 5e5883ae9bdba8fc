"""Looking at a place: what simulated robots and cameras report of the things that they see there."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.devices.simulator.drivers.recognition import SEEN, sighting_parts
from somrs.devices.simulator.link.commands import Sighting
from somrs.service_manager.sdk.device import Task
from somrs.service_manager.sdk.orders import Refusal
from somrs.service_manager.sdk.values import number_of

LOOK_HEIGHT = 0.1
"""Height above the top of an object at which its surroundings are looked at, m."""


async def point_at(task: Task, place: str) -> tuple[float, float, float]:
    """A point just above an object, where things on it are. Raises Refusal if the map does not say where it is."""
    rows = await task.map.query(f"{place}.PositionX = ?X AND {place}.PositionY = ?Y AND {place}.PositionZ = ?Z", limit=1)
    if not rows:
        raise Refusal(f"the map does not say where {place} is")
    heights = await task.map.query(f"{place}.Shape.Height = ?Height", limit=1)
    x, y, z = (number_of(rows[0][axis]) for axis in "XYZ")
    return x, y, z + (number_of(heights[0]["Height"]) if heights else 0.0) + LOOK_HEIGHT


def describe_things(place: str, sightings: Sequence[Sighting]) -> list[str]:
    """Which things are on or in the place, what they look like and where exactly, as parts of a formula.

    They are variables: the Repository finds out which objects of the map they are.
    """
    parts: list[str] = []
    for number, sighting in enumerate(sightings):
        if place in (sighting.support, sighting.container) and not sighting.robot:
            parts += [*sighting_parts(sightings, number), f"?{SEEN}{number}.Unknown = FALSE"]
    return parts
