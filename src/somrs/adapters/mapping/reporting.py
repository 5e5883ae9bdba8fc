"""What a camera has seen of things, as a report to the map: on what they stand is found by geometry, because nobody has named it."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import structs

from somrs.adapters.mapping.floor_map import FloorMap
from somrs.devices.simulator.drivers.recognition import sighting_parts
from somrs.devices.simulator.link.commands import Sighting

ON_TOP = 0.06
"""How far the underside of a thing may be from the top of what it stands on, m."""


def things_on(map: FloorMap, sightings: Sequence[Sighting]) -> list[Sighting]:
    """The things that stand on furniture of the map, or on its floors, with the names of these."""
    return [structs.replace(thing, support=support) for thing in sightings if (support := _support_of(map, thing)) is not None]


def _support_of(map: FloorMap, thing: Sighting) -> str | None:
    for name, box, top in map.furniture:
        if abs(thing.z - top) <= ON_TOP and box.gap((thing.x, thing.y)) <= 0.02:
            return name
    return map.floor_at((thing.x, thing.y)) if abs(thing.z - map.elevation) <= ON_TOP else None


def situation_of(things: Sequence[Sighting]) -> str:
    """The things as a formula about a variable for each; the Repository finds out which objects they are."""
    return " AND ".join(part for number in range(len(things)) for part in sighting_parts(things, number))
