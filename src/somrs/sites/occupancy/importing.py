"""Imports an occupancy map as a building of one storey."""

from __future__ import annotations

from pathlib import Path

from somrs.sites.draft import Draft, box_shape, identifier, pose
from somrs.sites.notes import Rank
from somrs.sites.occupancy.building import Building, building_of
from somrs.sites.occupancy.grid import coarser, without_margins
from somrs.sites.occupancy.reading import read_grid
from somrs.sites.site import Site

WALL_HEIGHT, DOOR_HEIGHT, OBSTACLE_HEIGHT = 2.5, 2.1, 0.5
"""Heights that an occupancy map does not say, m."""
FINEST = 0.04
"""Smaller cells do not say more of a building, and take longer, m."""


def import_occupancy_map(path: Path) -> Site:
    """The building that an occupancy map shows. Raises InputError for files that cannot be read, and ModelError."""
    name = identifier(path.name.split(".")[0].capitalize())
    draft = Draft()
    add_building(draft, name, building_of(coarser(without_margins(read_grid(path)), FINEST)))
    return draft.site(name, str(path))


def add_building(draft: Draft, name: str, building: Building) -> None:
    """Add a building of one storey, at height 0, to a map that is being made."""
    draft.add(name, "Building", {})
    storey = draft.add("Storey001", "Storey", {"Elevation": 0.0}, name)
    rooms = [draft.add(draft.numbered("Room"), "Room", {}, storey) for _ in building.rooms]
    for room, shape in zip(rooms, building.rooms, strict=True):
        draft.add_floor(shape.outline, 0.0, room)
    if not rooms:
        draft.notes.add(Rank.LEFT_OUT, name, "no room was found: nothing of the map is free, or rooms are smaller than 1 m²")
    for wall in building.walls:
        draft.add(draft.numbered("Wall"), "Wall", {**pose(wall, 0.0), **box_shape(wall, WALL_HEIGHT), "Color": "White"}, storey)
    for door in building.doors:
        values = {**pose(door.box, 0.0), **box_shape(door.box, DOOR_HEIGHT), "Open": True}
        object = draft.add(draft.numbered("Door"), "Door", values, storey)
        draft.relate("connects", object, *(rooms[number] for number in door.rooms))
        draft.notes.add(Rank.ASSUMED, object, "stands open, as it was when the map was made; state its DoorKind if it has a leaf")
    for obstacle in building.obstacles:
        object = draft.add(draft.numbered("Obstacle"), "Obstacle", {**pose(obstacle, 0.0), **box_shape(obstacle, OBSTACLE_HEIGHT)})
        draft.notes.add(Rank.ASSUMED, object, f"is {OBSTACLE_HEIGHT} m high; an occupancy map does not say what it is")
