"""Walls, doors, floors, holes and lifts.

Walls are 0.1 m thick and 2.5 m high, and extend beyond their ends by half their thickness, as in Open-RMF's own `building_map_tools`
(wall.py). The cabin of a lift is 2.5 m high, and its doors are those of lift.py there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from somrs.ontology.types import Value
from somrs.sites.draft import FLOOR_THICKNESS, Draft, box_shape, identifier, pose
from somrs.sites.notes import Rank
from somrs.sites.openrmf.document import Document, name_text, number, parameter, positive, text_of
from somrs.sites.openrmf.levels import Level
from somrs.sites.plan import Box, Point, without_gap

_WALL_THICKNESS, _WALL_HEIGHT, _DOOR_HEIGHT, _CABIN_HEIGHT = 0.1, 2.5, 2.1, 2.5
_HOLE_EDGE = 0.1
"""How far the body of a hole stands out of the floor, m, so that robots keep out of it."""
_DOOR_KINDS = {
    "hinged": "Hinged",
    "double_hinged": "DoubleHinged",
    "sliding": "Sliding",
    "double_sliding": "DoubleSliding",
    "telescope": "Telescope",
    "double_telescope": "DoubleTelescope",
}
_LIFT_DOOR_KINDS = {1: "Sliding", 2: "DoubleSliding", 3: "Telescope", 4: "DoubleTelescope", 5: "Hinged", 6: "DoubleHinged"}
"""By the numbers in Door.msg of Open-RMF's rmf_building_map_msgs."""


def add_fabric(document: Document, draft: Draft, level: Level) -> None:
    """Add the doors, the walls beside them, floors and holes of a level."""
    gaps: list[tuple[Point, Point]] = []
    for index, start, end, parameters in edges(document, level, "doors"):
        gaps.append((start, end))
        with document.reading(f"door {index + 1} of {level.name}", ("levels", level.name, "doors", index)):
            _add_door(draft, level, index, start, end, parameters)
    for _, edge_start, edge_end, _ in edges(document, level, "walls"):
        pieces = [(edge_start, edge_end)]
        for gap in gaps:
            pieces = [rest for piece in pieces for rest in without_gap(*piece, gap)]
        for start, end in pieces:
            level.walls.append(_add_wall_like(draft, level, draft.numbered("Wall"), "Wall", start, end, _WALL_HEIGHT, {"Color": "White"}))
    for index, floor in enumerate(level.data.get("floors") or ()):
        with document.reading(f"floor {index + 1} of {level.name}", ("levels", level.name, "floors", index)):
            _add_floor(draft, level, [level.vertex(vertex) for vertex in floor["vertices"]])
    for index, hole in enumerate(level.data.get("holes") or ()):
        with document.reading(f"hole {index + 1} of {level.name}", ("levels", level.name, "holes", index)):
            outline = [level.vertex(vertex) for vertex in hole["vertices"]]
            draft.add_floor(outline, level.elevation, level.storey, "Hole", FLOOR_THICKNESS + _HOLE_EDGE)
    if not level.data.get("floors"):
        _add_ground(draft, level)


def edges(document: Document, level: Level, kind: str) -> Iterator[tuple[int, Point, Point, dict[str, Any]]]:
    for index, edge in enumerate(level.data.get(kind) or ()):
        with document.reading(f"{kind.rstrip('s')} {index + 1} of {level.name}", ("levels", level.name, kind, index)):
            start, end = level.vertex(edge[0]), level.vertex(edge[1])
            yield index, start, end, edge[2] if len(edge) > 2 else {}


def _add_door(draft: Draft, level: Level, index: int, start: Point, end: Point, parameters: dict[str, Any]) -> None:
    stated_name = text_of(parameters, "name")
    name = identifier(stated_name if stated_name not in ("", "null") else f"Door{index + 1:03}")  # the editor's default is "null"
    has_drive = (text_of(parameters, "plugin") or "normal") != "none"  # "normal" is the editor's default
    values: dict[str, Value] = {"Open": False}
    type_name = "AutomaticDoor" if has_drive else "Door"
    kind = _DOOR_KINDS.get(text_of(parameters, "type"))
    if kind is not None:
        values["DoorKind"] = kind
    elif text_of(parameters, "type"):
        draft.notes.add(Rank.ASSUMED, name, f"{text_of(parameters, 'type')} is no known type of door; it has no DoorKind")
    if kind in ("Hinged", "DoubleHinged"):
        # Clockwise for the direction 1, from the hinge at the start or the end, as the editor draws it (level.cpp, draw_door).
        clockwise = number(parameter(parameters, "motion_direction", 1)) >= 0
        swing = math.radians(abs(number(parameter(parameters, "motion_degrees", 90.0))))
        values["SwingAngle"] = round(-swing if clockwise else swing, 4)
        if text_of(parameters, "motion_axis") == "end":
            start, end = end, start
    if number(parameter(parameters, "right_left_ratio", 1.0)) != 1.0:
        draft.notes.add(Rank.LEFT_OUT, name, "its leaves have different widths, and are equally wide on the map")
    _add_wall_like(draft, level, draft.fresh(name), type_name, start, end, _DOOR_HEIGHT, values)


def _add_wall_like(
    draft: Draft, level: Level, name: str, type: str, start: Point, end: Point, height: float, values: dict[str, Value]
) -> Box:
    overlap = _WALL_THICKNESS if type == "Wall" else 0.0
    yaw = math.atan2(end[1] - start[1], end[0] - start[0])
    box = Box((start[0] + end[0]) / 2, (start[1] + end[1]) / 2, math.dist(start, end) + overlap, _WALL_THICKNESS, yaw)
    draft.add(name, type, {**pose(box, level.elevation), **box_shape(box, height), **values}, level.storey)
    return box


def _add_ground(draft: Draft, level: Level) -> None:
    draft.notes.add(Rank.ASSUMED, f"level {level.name}", "has no floor; one is laid under all of it")
    xs, ys = zip(*(level.points or [(0.0, 0.0)]), strict=True)
    low, high = (min(xs) - 1, min(ys) - 1), (max(xs) + 1, max(ys) + 1)
    _add_floor(draft, level, [low, (high[0], low[1]), high, (low[0], high[1])])


def _add_floor(draft: Draft, level: Level, outline: list[Point]) -> None:
    if len(outline) < 3:
        raise ValueError(f"it has {len(outline)} corners, and needs three")
    level.floors[draft.add_floor(outline, level.elevation, level.storey)] = outline


def add_lifts(document: Document, draft: Draft, levels: list[Level], building: str) -> dict[str, str]:
    """Add the lifts with their doors. Returns the objects by the names in the file."""
    lifts: dict[str, str] = {}
    for key, data in (document.data.get("lifts") or {}).items():
        name = name_text(key)
        with document.reading(f"lift {name}", ("lifts", name)):
            lifts[name] = _add_lift(draft, levels, building, name, data)
    return lifts


def _add_lift(draft: Draft, levels: list[Level], building: str, key: str, data: dict[str, Any]) -> str:
    by_name = {level.name: level for level in levels}
    base = by_name.get(name_text(data.get("reference_floor_name")), levels[0])
    x, y = base.point(data["x"], data["y"])
    cabin = Box(x, y, positive(data, "width"), positive(data, "depth"), base.heading(data.get("yaw", 0.0)))
    start = by_name.get(name_text(data.get("initial_floor_name")), base)
    lift = draft.add(
        draft.fresh(identifier(key)), "Lift", {**pose(cabin, start.elevation), **box_shape(cabin, _CABIN_HEIGHT), "Label": key}, building
    )
    doors = data.get("doors") or {}
    for level_name, door_names in (data.get("level_doors") or {}).items():
        level = by_name.get(name_text(level_name))
        if level is None:
            raise ValueError(f"its level_doors name the level {name_text(level_name)}; the levels are {', '.join(by_name)}")
        draft.relate("stopsAt", lift, level.storey)
        for door_name in door_names:
            _add_lift_door(draft, level, lift, cabin, name_text(door_name), doors[door_name])
    if not data.get("level_doors"):
        draft.notes.add(Rank.ASSUMED, lift, "the lift has no doors in the file, so it stops at no storey; add them in the traffic editor")
    return lift


def _add_lift_door(draft: Draft, level: Level, lift: str, cabin: Box, name: str, data: dict[str, Any]) -> None:
    x, y = cabin.world((number(data["x"]), number(data["y"])))
    door = Box(x, y, positive(data, "width"), _WALL_THICKNESS, cabin.yaw + number(data.get("motion_axis_orientation", 0.0)))
    values: dict[str, Value] = {**pose(door, level.elevation), **box_shape(door, _DOOR_HEIGHT), "Open": False}
    kind = _LIFT_DOOR_KINDS.get(int(number(data.get("door_type", 0))))
    if kind is not None:
        values["DoorKind"] = kind
    object = draft.add(draft.fresh(identifier(f"{lift}_{name}_{level.name}")), "LiftDoor", values, level.storey)
    draft.relate("leadsInto", object, lift)
