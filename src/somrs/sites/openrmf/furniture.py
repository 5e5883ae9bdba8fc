"""Furniture, things that robots carry, and stations, from the models of a level.

A model's yaw is counter-clockwise, as in Open-RMF's model.py.
"""

from __future__ import annotations

import math
from typing import Any

from somrs.ontology.files.loading import upper
from somrs.ontology.objects import Fact
from somrs.ontology.types import ObjectType, Value
from somrs.sites.draft import Draft, box_shape, identifier, pose
from somrs.sites.models import ADVICE, UNKNOWN, Furniture, ModelTable
from somrs.sites.notes import Rank
from somrs.sites.openrmf.document import Document, number
from somrs.sites.openrmf.levels import Level
from somrs.sites.plan import Box, Point, clearance, cleared, is_in_polygon

EDGE = 0.15
"""The largest distance, in metres, from a free edge of its support at which a gripper can reach an object."""
_NEAR_EDGE = 0.1
_PLACE_RADIUS = 0.4
_STATIONS = ("TeleportDispenser", "TeleportIngestor")


def add_models(document: Document, draft: Draft, level: Level, table: ModelTable) -> None:
    """Add the models of a level; things come after the furniture that supports them."""
    things: list[tuple[int, str, dict[str, Any]]] = []
    for index, model in enumerate(level.data.get("models") or ()):
        with document.reading(f"model {index + 1} of {level.name}", ("levels", level.name, "models", index)):
            kind = str(model["model_name"]).rpartition("/")[2]
            if kind.startswith(_STATIONS):
                _add_station(draft, level, str(model.get("name") or kind), model)
            elif kind in table.scenery:
                draft.notes.add(Rank.LEFT_OUT, kind, "scenery: it is only looked at, and no robot has to keep clear of it")
            elif kind in table.things and not model.get("static", True):
                things.append((index, kind, model))
            else:
                _add_furniture(draft, level, kind, model, table)
    for index, kind, model in things:
        with document.reading(f"model {index + 1} of {level.name}", ("levels", level.name, "models", index)):
            _add_thing(draft, level, kind, table.things[kind], model)


def _add_station(draft: Draft, level: Level, label: str, model: dict[str, Any]) -> None:
    """Add a dispenser or an ingestor, where robots load and unload. `lanes.py` relates it to its waypoint by its name in the file."""
    x, y = level.point(model["x"], model["y"])
    values = pose(Box(x, y, 0, 0, level.heading(model.get("yaw", 0.0))), level.elevation + number(model.get("z", 0.0)))
    draft.add(draft.fresh(identifier(label)), "Station", {**values, "ExternalId": label}, level.storey)


def _add_furniture(draft: Draft, level: Level, kind: str, model: dict[str, Any], table: ModelTable) -> None:
    by_word = table.by_word(kind) if kind not in table.furniture else None
    entry = table.furniture.get(kind) or (by_word[1] if by_word is not None else UNKNOWN)
    width, depth, height = entry.size
    point = level.point(model["x"], model["y"])
    name = draft.numbered(identifier(kind))
    if by_word is not None:
        draft.notes.add(Rank.ASSUMED, name, f"{kind}: the size is that of a typical {by_word[0]}", ADVICE)
    elif entry is UNKNOWN:
        draft.notes.add(Rank.ASSUMED, name, f"{kind}: the size is not known; an obstacle of {width} m represents it", ADVICE)
    box = cleared(Box(*point, width, depth, level.heading(model.get("yaw", 0.0))), level.walls)
    if box is None:
        draft.notes.add(Rank.LEFT_OUT, name, "overlaps walls and cannot be moved clear of them; move it in the traffic editor")
        return
    if (distance := math.dist((box.x, box.y), point)) > 0.3:
        draft.notes.add(Rank.MOVED, f"{name} ({distance:.2f} m)", "moved out of a wall")
    type_name = _model_type(draft, kind, entry)
    z = number(model.get("z", 0.0))
    draft.add(name, type_name, pose(box, level.elevation + z))
    level.furniture[name] = (box, z + height, upper().is_subtype(entry.type, "Support"))


def _model_type(draft: Draft, kind: str, entry: Furniture) -> str:
    """Define a type with the size of the model. It has the model's name, unless the upper ontology uses that name."""
    name = identifier(kind)
    name = "UnknownModel" if entry is UNKNOWN else f"{name}Model" if name in upper().types else name
    width, depth, height = entry.size
    defaults: dict[str, Value] = {**box_shape(Box(0, 0, width, depth), height), "Color": entry.color}
    draft.types[name] = ObjectType(name=name, parent=entry.type, defaults=defaults)
    return name


def _add_thing(draft: Draft, level: Level, kind: str, type: str, model: dict[str, Any]) -> None:
    name = draft.numbered(identifier(kind))
    point, z = level.point(model["x"], model["y"]), number(model.get("z", 0.0))
    candidates = [
        (abs(top - z), support) for support, (box, top, is_support) in level.furniture.items() if is_support and box.gap(point) < 0.05
    ]
    if candidates:
        support = min(candidates)[1]
        box, top, _ = level.furniture[support]
        moved = _to_edge(level, support, box, point)
        if moved != point:
            distance = math.dist(moved, point)
            draft.notes.add(Rank.MOVED, f"{name} ({distance:.2f} m)", f"moved to an edge of {support} that robots can reach")
        point, z = moved, top
    else:
        support, z = _floor_under(level, point), 0.0
        draft.notes.add(Rank.MOVED, name, "nothing is below it; it lies on the floor")
    draft.add(name, type, pose(Box(*point, 0, 0, level.heading(model.get("yaw", 0.0))), level.elevation + z))
    draft.facts.append(Fact("isOn", (name, support)))


def _floor_under(level: Level, point: Point) -> str:
    """The floor of the level under the point, or else the first one of the level."""
    under = (floor for floor, outline in level.floors.items() if is_in_polygon(point, outline))
    return next(under, next(iter(level.floors)))


def _to_edge(level: Level, support: str, box: Box, point: Point) -> Point:
    """A point on the support that robots can reach: the point itself, or one near the closest edge with room for a robot in front."""
    obstacles = [*level.walls, *(other_box for name, (other_box, _, _) in level.furniture.items() if name != support)]
    u, v = box.local(point)
    half = (box.width / 2, box.depth / 2)
    u, v = (max(-h + _NEAR_EDGE, min(h - _NEAR_EDGE, t)) for t, h in zip((u, v), half, strict=True))
    best: tuple[float, Point] | None = None
    for axis in (0, 1):
        for sign in (-1, 1):
            edge, stand = [u, v], [u, v]
            edge[axis], stand[axis] = sign * (half[axis] - _NEAR_EDGE), sign * (half[axis] + _PLACE_RADIUS)
            gap = half[axis] - sign * (u, v)[axis]
            if clearance(box.world((stand[0], stand[1])), obstacles) >= 0.3 and (best is None or gap < best[0]):
                best = gap, (u, v) if gap <= EDGE else (edge[0], edge[1])
    return box.world(best[1]) if best is not None and (best[0] > EDGE or (u, v) != box.local(point)) else point
