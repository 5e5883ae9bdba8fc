"""Places, waypoints, lanes and robots, from the vertices and lanes of a level."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from somrs.ontology.files.loading import upper
from somrs.ontology.types import Value
from somrs.sites.draft import Draft, identifier, pose
from somrs.sites.models import ADVICE, UNKNOWN_ROBOT, ModelTable
from somrs.sites.notes import Rank
from somrs.sites.openrmf.document import Document, name_text, number, parameter, text_of, whole_number
from somrs.sites.openrmf.levels import Level
from somrs.sites.plan import Box, Point, roomiest

_PLACE_RADIUS = 0.4
_PURPOSES = {
    "is_holding_point": "HoldingPoint",
    "is_parking_spot": "ParkingSpot",
    "is_passthrough_point": "PassthroughPoint",
    "is_cleaning_zone": "CleaningZone",
}
_TEXTS = {"dock_name": "DockName", "mutex": "Mutex"}
_ROBOT, _ROBOT_TYPE, _CHARGER, _CABIN = "spawn_robot_name", "spawn_robot_type", "is_charger", "lift_cabin"
_STATIONS = ("pickup_dispenser", "dropoff_ingestor")
_KNOWN_OF_VERTICES = {*_PURPOSES, *_TEXTS, *_STATIONS, _ROBOT, _ROBOT_TYPE, _CHARGER, _CABIN, "human_goal_set_name"}
_KNOWN_OF_LANES = {"bidirectional", "graph_idx", "orientation", "speed_limit", "mutex", "width"}
_OBSOLETE = {"demo_mock_floor_name", "demo_mock_lift_name"}
"""Parameters of lanes from before Open-RMF had lifts; they have no effect there either."""


def reserve_names(draft: Draft, level: Level) -> None:
    """Reserve the names of places, so that no numbered object takes one of them."""
    for vertex in level.data.get("vertices") or ():
        if isinstance(vertex, list) and _label(vertex):
            draft.reserved.add(identifier(_label(vertex)))


def add_waypoints(document: Document, draft: Draft, level: Level, lifts: dict[str, str], *, crowds: bool) -> None:
    """Add an object for each vertex that has a name or a purpose, or at which a lane ends."""
    ends = {whole_number(end) for kind in lane_kinds(crowds) for edge in level.data.get(kind) or () for end in edge[:2]}
    for index, vertex in enumerate(level.data.get("vertices") or ()):
        with document.reading(f"vertex {index + 1} of {level.name}", ("levels", level.name, "vertices", index)):
            parameters = vertex[4] if len(vertex) > 4 else {}
            _note_unknown(draft, parameters, _KNOWN_OF_VERTICES, "vertices")
            values = _purposes(parameters)
            station_names = [name for key in _STATIONS if (name := text_of(parameters, key))]
            if values or station_names or index in ends or _label(vertex) or any(parameter(parameters, key) for key in (_CHARGER, _ROBOT)):
                name = level.waypoints[index] = _add_waypoint(draft, level, index, vertex, values)
                for station_name in station_names:
                    draft.relate("interactsAt", _station(draft, level, station_name, name), name)
                if (cabin := text_of(parameters, _CABIN)) and cabin in lifts:
                    draft.relate("isIn", name, lifts[cabin])


def _add_waypoint(draft: Draft, level: Level, index: int, vertex: list[Any], purposes: dict[str, Value]) -> str:
    """A Charger, a Place if it has a name or a robot starts there, or else a Waypoint, which is exactly where the file has it."""
    parameters = vertex[4] if len(vertex) > 4 else {}
    label, robot = _label(vertex), text_of(parameters, _ROBOT)
    is_charger = bool(parameter(parameters, _CHARGER, False))
    point = level.points[index]
    if not (label or robot or is_charger):
        return draft.add(draft.numbered("Waypoint"), "Waypoint", {**pose(Box(*point, 0, 0), level.elevation), **purposes}, level.storey)
    name = identifier(label or (f"{robot}_start" if robot else f"Charger_{level.name}_{index}"))
    if name in draft.objects:
        name = draft.fresh(f"{name}_{identifier(level.name)}")
    if not purposes.get("PassthroughPoint") and not text_of(parameters, _CABIN):
        point = _free(draft, level, name, point)
    values = {**pose(Box(*point, 0, 0), level.elevation), "Label": label or name, **purposes}
    return draft.add(name, "Charger" if is_charger else "Place", values, level.storey)


def _purposes(parameters: Any) -> dict[str, Value]:
    flags: dict[str, Value] = {attribute: True for key, attribute in _PURPOSES.items() if parameter(parameters, key, False) is True}
    return flags | {attribute: text for key, attribute in _TEXTS.items() if (text := text_of(parameters, key))}


def _station(draft: Draft, level: Level, label: str, waypoint: str) -> str:
    """The station of that name in the file, by default one at its waypoint: some dispensers have no model."""
    for name, object in draft.objects.items():
        if object.type == "Station" and object.values.get("ExternalId") == label:
            return name
    position = {path: value for path, value in draft.objects[waypoint].values.items() if path.startswith("Position")}
    return draft.add(draft.fresh(identifier(label)), "Station", {**position, "ExternalId": label}, level.storey)


def _free(draft: Draft, level: Level, name: str, point: Point) -> Point:
    """The point, or the nearest one where the disc of the place is free, so that robots can stand and put objects there."""
    free = roomiest(point, level.solid(), _PLACE_RADIUS, 1.0)
    if free is None:
        draft.notes.add(Rank.ASSUMED, name, "there is no room for a robot")
        return point
    if (distance := math.dist(free, point)) > 0.05:
        draft.notes.add(Rank.MOVED, f"{name} ({distance:.2f} m)", "moved to where a robot has room")
    return free


# Lanes


def lane_kinds(crowds: bool) -> tuple[str, ...]:
    return ("lanes", "human_lanes") if crowds else ("lanes",)


def add_lanes(document: Document, draft: Draft, level: Level, *, crowds: bool) -> None:
    for kind in lane_kinds(crowds):
        for index, edge in enumerate(level.data.get(kind) or ()):
            subject = f"{kind.rstrip('s').replace('_', ' ')} {index + 1} of {level.name}"
            with document.reading(subject, ("levels", level.name, kind, index)):
                parameters = edge[2] if len(edge) > 2 else {}
                if _has_unread_end(level, edge):
                    continue  # the mistake in the vertex is told
                _note_unknown(draft, parameters, _KNOWN_OF_LANES | _OBSOLETE, kind)
                name = draft.add(draft.numbered("Lane"), "Lane", dict(_lane_values(parameters)), level.storey)
                draft.relate("startsAt", name, level.waypoints[whole_number(edge[0])])
                draft.relate("endsAt", name, level.waypoints[whole_number(edge[1])])


def _has_unread_end(level: Level, edge: list[Any]) -> bool:
    ends = whole_number(edge[0]), whole_number(edge[1])
    return any(end < len(level.points) and end not in level.waypoints for end in ends)


def _lane_values(parameters: Any) -> Iterator[tuple[str, Value]]:
    yield "NavigationGraph", text_of(parameters, "graph_idx") or "0"
    if parameter(parameters, "bidirectional", False) is True:
        yield "Bidirectional", True
    for key, attribute in (("speed_limit", "SpeedLimit"), ("width", "LaneWidth")):
        if (limit := number(parameter(parameters, key, 0.0))) > 0:
            yield attribute, limit
    if (travel := text_of(parameters, "orientation").capitalize()) in ("Forward", "Backward"):
        yield "Travel", travel
    if mutex := text_of(parameters, "mutex"):
        yield "Mutex", mutex


# Robots


def add_robots(document: Document, draft: Draft, level: Level, table: ModelTable) -> None:
    """Add the robots that start at vertices. They face along their first lane, and use the graph of it, as in Open-RMF's level.py."""
    for index, vertex in enumerate(level.data.get("vertices") or ()):
        with document.reading(f"vertex {index + 1} of {level.name}", ("levels", level.name, "vertices", index)):
            parameters = vertex[4] if len(vertex) > 4 else {}
            if name := text_of(parameters, _ROBOT):
                _add_robot(draft, level, index, name, text_of(parameters, _ROBOT_TYPE).rpartition("/")[2], table)


def _add_robot(draft: Draft, level: Level, index: int, label: str, model: str, table: ModelTable) -> None:
    name = draft.fresh(identifier(label))
    entry = table.robots.get(model, UNKNOWN_ROBOT)
    if entry is UNKNOWN_ROBOT:
        text = f"{model or 'a robot without a type'}: it is not known what this robot can do; it only drives"
        draft.notes.add(Rank.ASSUMED, name, text, ADVICE)
    x, y = (float(draft.objects[level.waypoints[index]].values[path]) for path in ("PositionX", "PositionY"))
    heading, graph = _first_lane(level, index)
    values = pose(Box(x, y, 0, 0, heading), level.elevation)
    numbers = {"Shape.Radius": entry.radius, "Shape.Height": entry.height, "Speed": entry.speed, "Weight": entry.weight}
    known = {path: number for path, number in numbers.items() if number is not None and number != upper().default(entry.type, path)}
    draft.add(name, entry.type, {**values, **known, **({"NavigationGraph": graph} if graph else {})})


def _first_lane(level: Level, index: int) -> tuple[float, str]:
    for start, end, *parameters in level.data.get("lanes") or ():
        if index in (whole_number(start), whole_number(end)):
            (start_x, start_y), (end_x, end_y) = level.vertex(start), level.vertex(end)
            backward = text_of(parameters[0] if parameters else {}, "orientation") == "backward"
            heading = math.atan2(end_y - start_y, end_x - start_x) + (math.pi if backward else 0.0)
            return heading, text_of(parameters[0] if parameters else {}, "graph_idx") or "0"
    return 0.0, ""


def _label(vertex: list[Any]) -> str:
    return name_text(vertex[3]) if len(vertex) > 3 and vertex[3] not in (None, "") else ""


def _note_unknown(draft: Draft, parameters: Any, known: set[str], kind: str) -> None:
    for key in parameters if isinstance(parameters, dict) else ():
        if str(key) not in known:
            draft.notes.add(Rank.LEFT_OUT, str(key), f"parameters of {kind.replace('_', ' ')} that SO-MRS does not know")
