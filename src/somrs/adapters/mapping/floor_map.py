"""How the map follows what a survey shows: which objects come, change and go, with names that stay the same.

What a survey shows differs a little each time. A wall, a door, an obstacle or a room of it is the object of the map that is in its place;
what is new gets a new name; an object that the survey has brought, and does not show any more, goes. Objects that others have put on the
map stay as they are, and nothing is added in their place; that doors of them are shut or open, and furniture is not there, is news
(`observed`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from somrs.adapters.mapping.survey import LEAST_SIGHTINGS, Piece
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import PART_OF, Value
from somrs.sites.draft import box_shape, floor_values, pose
from somrs.sites.occupancy.building import Building
from somrs.sites.occupancy.grid import Cell, OccupancyGrid, States
from somrs.sites.occupancy.importing import DOOR_HEIGHT, OBSTACLE_HEIGHT, WALL_HEIGHT
from somrs.sites.occupancy.walls import beside_walls
from somrs.sites.plan import Box, Point, is_in_polygon

SAME = 0.03
"""A pose or a size that differs by less is the same, m or rad."""
SAME_PLACE = 0.5
"""What is so near is the same door, or the same obstacle, m."""
IN_LINE = 0.25
"""Walls whose middle lines are so near, and that overlap, are the same, m."""
LOOKS = ("Color", "Shape.Form", "Shape.Width", "Shape.Depth", "Shape.Radius", "Shape.Height")
"""The attributes of furniture that a camera sees."""
_DEEPEST_IN_WALL = 0.1
"""So far at most is a piece of furniture moved out of walls: nobody knows exactly where both are, m."""
_BUILT = ("Room", "Wall", "Door")
"""The kinds of parts of a storey."""
_MOSTLY = 0.9
"""Share of the cells in the place of an object that have to agree for it to count as gone, or as open or shut."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """An object as a survey shows it. `box`: where it is; of a room, only its middle counts, and `outline` is its edge. `floor`: the values
    of its floor, of a room."""

    kind: str
    box: Box
    values: dict[str, Value] = field(default_factory=dict)
    outline: Sequence[Point] = ()
    floor: dict[str, Value] = field(default_factory=dict)
    connects: tuple[int, ...] = ()
    """Of a door: the positions of its rooms among those that are shown."""


@dataclass(slots=True, kw_only=True)
class _Entry:
    """An object of the map. `is_foreign`: somebody else has put it there; `is_earlier`: or an earlier survey of the same robot;
    `is_device`: it reports by itself how it is."""

    name: str
    shown: Shown
    floor: str | None = None
    connects: tuple[str, ...] = ()
    is_foreign: bool = False
    is_earlier: bool = False
    is_device: bool = False


class FloorMap:
    """The objects of a storey, at this elevation in m. `names`: those that the map has already."""

    def __init__(self, storey: str, elevation: float, names: Collection[str] = ()) -> None:
        self.storey, self.elevation = storey, elevation
        self._names = set(names)
        self._numbers: Counter[str] = Counter()
        self._entries: dict[str, _Entry] = {}
        self._shut: set[str] = set()
        """The doors that were seen shut: they are still there, although the survey shows a wall."""
        self._missed: set[str] = set()
        self._kept: set[str] = set()
        """What an earlier survey has brought, and this one has not seen to be gone."""

    def add_foreign(
        self,
        name: str,
        shown: Shown,
        floor: str | None = None,
        connects: tuple[str, ...] = (),
        *,
        is_earlier: bool = False,
        is_device: bool = False,
    ) -> None:
        """Note an object that somebody else has put on the map, or an earlier survey. `floor`: that of a room; `connects`: the rooms that a
        door joins. `is_device`: a door with a drive, which reports by itself whether it is open."""
        self._entries[name] = _Entry(
            name=name, shown=shown, floor=floor, connects=connects, is_foreign=True, is_earlier=is_earlier, is_device=is_device
        )

    @property
    def surveyed_names(self) -> list[str]:
        """The objects that this survey or an earlier one has brought."""
        return [entry.name for entry in self._entries.values() if entry.is_earlier or not entry.is_foreign]

    def adopt_earlier(self, grid: OccupancyGrid) -> None:
        """From now on, treat what an earlier survey has brought as what this one has: call it when all has been seen again.

        What this one has not seen stays, and furniture that is not in its place: somebody may know where it is.
        """
        for entry in self._entries.values():
            if entry.is_earlier:
                entry.is_foreign = entry.is_earlier = False
                if entry.shown.kind == "Room" or entry.name in self._missed or not is_free(entry.shown.box, grid):
                    self._kept.add(entry.name)

    @property
    def furniture(self) -> list[tuple[str, Box, float]]:
        """The pieces of furniture on the map: their names, where they are, and the heights of their tops, m."""
        return [
            (entry.name, entry.shown.box, _number(entry.shown.values, "PositionZ") + _number(entry.shown.values, "Shape.Height"))
            for entry in self._entries.values()
            if entry.shown.kind not in _BUILT and entry.name not in self._missed
        ]

    @property
    def known_doors(self) -> list[Box]:
        """Where the doors are that others have put on the map."""
        return [
            entry.shown.box for entry in self._entries.values() if entry.shown.kind == "Door" and entry.is_foreign and not entry.is_earlier
        ]

    @property
    def room_count(self) -> int:
        """How many rooms of the storey are known."""
        return sum(entry.shown.kind == "Room" for entry in self._entries.values())

    def floor_at(self, point: Point) -> str | None:
        """The floor of the room in which a point is."""
        return next((entry.floor for entry in self._entries.values() if is_in_polygon(point, entry.shown.outline)), None)

    def observed(self, grid: OccupancyGrid) -> tuple[list[str], list[str]]:
        """What a survey shows of the objects of the map: parts of a formula, that doors are shut or open, as far as this is news; and the
        furniture of others that is not where the map has it, each piece once."""
        parts, missed = [], []
        for name, entry in self._entries.items():
            box, kind = entry.shown.box, entry.shown.kind
            if entry.is_device:
                continue
            if kind == "Door" and (is_open := is_door_open(box, grid)) is not None:
                if is_open is not bool(entry.shown.values.get("Open", True)):
                    parts.append(f"{name}.Open = {str(is_open).upper()}")
                    entry.shown = replace(entry.shown, values={**entry.shown.values, "Open": is_open})
                (self._shut.discard if is_open else self._shut.add)(name)
            elif entry.is_foreign and self._is_furniture(entry) and name not in self._missed and is_free(box, grid):
                missed.append(name)
        self._missed.update(missed)
        return parts, missed

    def follow(self, building: Building, pieces: Sequence[Piece], robots: Sequence[Point] = ()) -> list[Change]:
        """The changes by which the map has what a survey shows. `robots`: where it has seen robots, which are no obstacles."""
        shown = [*shown_objects(building, pieces, robots, self.elevation)]
        matched = self._matched(shown)
        changes = [*self._removals({entry.name for entry in matched.values()} | self._shut | self._kept_beside(shown))]
        rooms: list[str] = []
        for index, item in enumerate(shown):
            entry = matched.get(index)
            if entry is None:
                entry = self._entry_of(item)
                changes += self._additions(entry)
            elif not entry.is_foreign:
                changes += self._updates(entry, item)
            if item.kind == "Room":
                rooms.append(entry.name)
            if item.kind == "Door" and not entry.is_foreign:
                changes += self._connections(entry, tuple(rooms[number] for number in item.connects))
        return changes

    @staticmethod
    def _is_furniture(entry: _Entry) -> bool:
        """Whether it is a piece of furniture that somebody may look for, and not what a survey could not recognise."""
        return entry.shown.kind not in _BUILT and not (entry.is_earlier and entry.shown.kind == "Obstacle")

    def _kept_beside(self, shown: Sequence[Shown]) -> set[str]:
        """What an earlier survey has brought and this one has not, without what is in the place of something shown: a half of a wall."""
        return {
            name for name in self._kept & self._entries.keys() if not any(_agreement(item, self._entries[name].shown) > 0 for item in shown)
        }

    def _matched(self, shown: Sequence[Shown]) -> dict[int, _Entry]:
        """The object of the map that each shown one is, by its position: those that agree best first, each once."""
        pairs = [
            (agreement, index, name)
            for index, item in enumerate(shown)
            for name, entry in self._entries.items()
            if name not in self._missed and (agreement := _agreement(item, entry.shown)) > 0
        ]
        matched: dict[int, _Entry] = {}
        taken_names: set[str] = set()
        for _, index, name in sorted(pairs, key=lambda pair: (-pair[0], pair[1], pair[2])):
            if index not in matched and (name not in taken_names or self._entries[name].is_foreign):
                matched[index] = self._entries[name]
                taken_names.add(name)
        return matched

    def _fresh_name(self, kind: str) -> str:
        while True:
            self._numbers[kind] += 1
            name = f"{kind}{self._numbers[kind]:03}"
            if name not in self._names:
                self._names.add(name)
                return name

    def _entry_of(self, item: Shown) -> _Entry:
        entry = _Entry(name=self._fresh_name(item.kind), shown=item, floor=self._fresh_name("Floor") if item.floor else None)
        self._entries[entry.name] = entry
        return entry

    def _additions(self, entry: _Entry) -> Iterator[Change]:
        item = entry.shown
        yield ObjectAdded(Object(name=entry.name, type=item.kind, values=item.values))
        if item.kind in _BUILT:
            yield FactAdded(Fact(PART_OF, (entry.name, self.storey)))
        if entry.floor is not None:
            yield ObjectAdded(Object(name=entry.floor, type="Floor", values=item.floor))
            yield FactAdded(Fact(PART_OF, (entry.floor, entry.name)))

    def _updates(self, entry: _Entry, item: Shown) -> Iterator[Change]:
        changes = [*_changed_values(entry.name, entry.shown.values, item.values)]
        if entry.floor is not None:
            changes += _changed_values(entry.floor, entry.shown.floor, item.floor)
        if changes:  # or else small differences would add up
            entry.shown = item
        yield from changes

    def _connections(self, entry: _Entry, rooms: tuple[str, ...]) -> Iterator[Change]:
        if entry.connects == rooms:
            return
        if entry.connects and all(room in self._entries for room in entry.connects):  # with a room, its facts have gone
            yield FactRemoved(Fact("connects", (entry.name, *entry.connects)))
        entry.connects = rooms
        yield FactAdded(Fact("connects", (entry.name, *rooms)))

    def _removals(self, kept_names: set[str]) -> Iterator[Change]:
        for name, entry in [*self._entries.items()]:
            if not entry.is_foreign and name not in kept_names:
                del self._entries[name]
                if entry.floor is not None:
                    yield ObjectRemoved(entry.floor)
                yield ObjectRemoved(name)


def is_door_open(box: Box, grid: OccupancyGrid) -> bool | None:
    """Whether a door is open, by what was seen along the middle of its line; None if not enough of it was seen."""
    states = _states_along(replace(box, width=0.7 * box.width), grid, (0.0,))
    if np.mean(states == Cell.FREE) >= _MOSTLY:
        return True
    rows = _states_along(replace(box, width=0.7 * box.width), grid, (-0.5, 0.0, 0.5)).reshape(3, -1)
    return False if np.mean((rows == Cell.OCCUPIED).any(axis=0)) >= _MOSTLY else None


def is_free(box: Box, grid: OccupancyGrid) -> bool:
    """Whether the place of an object is free, apart from its edge."""
    return bool(np.mean(_states_along(replace(box, width=0.8 * box.width), grid, (-0.4, -0.2, 0.0, 0.2, 0.4)) == Cell.FREE) >= _MOSTLY)


def _states_along(box: Box, grid: OccupancyGrid, rows: Sequence[float]) -> States:
    """The states of cells in rows along a rectangle. `rows`: their distances from its middle line, as shares of its depth."""
    count = max(3, round(box.width / grid.resolution))
    offsets = ((np.arange(count) + 0.5) / count - 0.5) * box.width
    return grid.state_at(grid.to_local([box.world((float(u), row * box.depth)) for row in rows for u in offsets]))


def shown_objects(building: Building, pieces: Sequence[Piece], robots: Sequence[Point], elevation: float) -> Iterator[Shown]:
    """The objects that a survey shows: rooms, then walls, doors, furniture, and obstacles that the camera has not recognised."""
    for room in building.rooms:
        floor = floor_values(room.outline, elevation)
        yield Shown(kind="Room", box=Box(*room.middle, 0.0, 0.0), outline=room.outline, floor=floor)
    for wall in building.walls:
        yield _box_shown("Wall", wall, elevation, WALL_HEIGHT, {"Color": "White"})
    for door in building.doors:
        values = {**pose(door.box, elevation), **box_shape(door.box, DOOR_HEIGHT), "Open": True}
        yield Shown(kind="Door", box=door.box, values=values, connects=door.rooms)
    furniture = [piece for piece in pieces if piece.count >= LEAST_SIGHTINGS]
    for piece in furniture:
        looks = {path: piece.values[path] for path in LOOKS if path in piece.values}
        values = {path: round(value, 3) if isinstance(value, float) else value for path, value in looks.items()}
        box = beside_walls(piece.box, building.walls, _DEEPEST_IN_WALL) or piece.box
        yield Shown(kind=piece.type, box=box, values={**pose(box, piece.z), **values})
    for obstacle in building.obstacles:
        is_robot = any(obstacle.gap(robot) < 0.2 for robot in robots)
        if not is_robot and not any(_overlap(obstacle, piece.box) for piece in furniture):
            yield _box_shown("Obstacle", obstacle, elevation, OBSTACLE_HEIGHT, {})


def _box_shown(kind: str, box: Box, elevation: float, height: float, values: dict[str, Value]) -> Shown:
    return Shown(kind=kind, box=box, values={**pose(box, elevation), **box_shape(box, height), **values})


def _overlap(first: Box, second: Box) -> bool:
    return first.gap((second.x, second.y)) < 0 or second.gap((first.x, first.y)) < 0


def _agreement(first: Shown, second: Shown) -> float:
    """How well two shown objects agree; 0 if they are not the same."""
    if first.kind == "Room" or second.kind == "Room":
        is_same = first.kind == second.kind and any(
            is_in_polygon((room.box.x, room.box.y), around.outline) for room, around in ((first, second), (second, first))
        )
        return 1 / (1 + math.dist((first.box.x, first.box.y), (second.box.x, second.box.y))) if is_same else 0.0
    if first.kind != second.kind:
        return 0.0
    if first.kind == "Wall":
        return _common_length(first.box, second.box)
    return max(0.0, SAME_PLACE - math.dist((first.box.x, first.box.y), (second.box.x, second.box.y)))


def _common_length(first: Box, second: Box) -> float:
    """The length along which two walls are in one place, m."""
    if abs(math.remainder(first.yaw - second.yaw, math.pi)) > math.radians(10):
        return 0.0
    u, v = first.local((second.x, second.y))
    if abs(v) > IN_LINE:
        return 0.0
    return max(0.0, min(first.width / 2, u + second.width / 2) - max(-first.width / 2, u - second.width / 2))


def _changed_values(name: str, old_values: Mapping[str, Value], new_values: Mapping[str, Value]) -> Iterator[Change]:
    """What of the values of an object differs, beyond the noise. All poses and sizes change together."""
    paths = [*dict.fromkeys([*old_values, *new_values])]
    if all(_is_same(old_values.get(path, 0.0), new_values.get(path, 0.0)) for path in paths):
        return
    for path in paths:
        if old_values.get(path) != new_values.get(path):
            yield ValueSet(name, path, new_values.get(path))


def _is_same(first: Value, second: Value) -> bool:
    if isinstance(first, int | float) and isinstance(second, int | float):
        return abs(first - second) < SAME
    return first == second


def _number(values: Mapping[str, Value], path: str) -> float:
    value = values.get(path)
    return float(value) if isinstance(value, int | float) else 0.0
