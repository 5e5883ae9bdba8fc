"""Imports buildings from files of Open-RMF's traffic editor (`.building.yaml`).

Walls are 0.1 m thick and 2.5 m high, and extend beyond their ends by half their thickness, as in Open-RMF's own
`building_map_tools` (wall.py); a model's yaw is counter-clockwise (model.py). Lanes are ignored: robots plan their own paths.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from somrs.entish.parse import KEYWORDS
from somrs.errors import InputError, ModelError, Problem
from somrs.ontology.conformance import violations
from somrs.ontology.files.loading import upper
from somrs.ontology.files.nodes import Path as YamlPath
from somrs.ontology.files.nodes import Source
from somrs.ontology.objects import Fact, Map, Object
from somrs.ontology.types import PART_OF, ObjectType, Value
from somrs.sites.plan import Box, Point, clearance, cleared, roomiest, without_gap
from somrs.sites.rmf_models import MODELS, THINGS, UNKNOWN, Model
from somrs.sites.site import Site

_WALL_THICKNESS, _WALL_HEIGHT, _DOOR_HEIGHT, _FLOOR_THICKNESS = 0.1, 2.5, 2.1, 0.1
_PLACE_RADIUS = 0.4
EDGE = 0.15
"""The largest distance, in metres, from a free edge of its support at which a gripper can reach an object."""
_NEAR_EDGE = 0.1


def import_building(path: str | Path) -> Site:
    """The building in the file. Raises InputError for an unreadable file, and ModelError for wrong content."""
    try:
        text = Path(path).read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read ({error}); give the path of an Open-RMF .building.yaml file") from error
    return import_text(text, str(path))


def import_text(text: str, file: str = "building.yaml") -> Site:
    """The building in the text. Raises ModelError for wrong content."""
    source = Source(file, text)
    if source.problems:
        raise ModelError(source.problems)
    if not isinstance(source.data, dict) or not isinstance(source.data.get("levels"), dict) or not source.data["levels"]:
        message = "an Open-RMF building has levels: with at least one level; is this a .building.yaml file?"
        raise ModelError([Problem(file=file, line=1, subject="file", rule="structure", message=message)])
    return _Import(source).building()


@dataclass(slots=True)
class _Level:
    """A storey during the import."""

    name: str
    data: dict[str, Any]
    storey: str
    elevation: float
    points: list[Point]
    walls: list[Box] = field(default_factory=list)
    furniture: dict[str, tuple[Box, float, bool]] = field(default_factory=dict)
    """By object: its rectangle, the height of its top above the storey's floor, and whether it can support other objects."""

    def solid(self) -> list[Box]:
        return [*self.walls, *(box for box, _, _ in self.furniture.values())]


@dataclass(slots=True)
class _Import:
    source: Source
    objects: dict[str, Object] = field(default_factory=dict)
    facts: list[Fact] = field(default_factory=list)
    types: dict[str, ObjectType] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    reserved: set[str] = field(default_factory=set)
    numbers: Counter[str] = field(default_factory=Counter)

    def building(self) -> Site:
        data = self.source.data
        name = _identifier(str(data.get("name") or "Building"))
        building = self._add(name, "Building", {}, None)
        levels = [level for key in data["levels"] if (level := self._level(str(key), building)) is not None]
        if self.problems:
            raise ModelError(self.problems)
        self._align(levels)
        for stage in (self._reserve, self._fabric, self._models, self._places):
            for level in levels:
                with self._reading(f"level {level.name}", ("levels", level.name)):
                    stage(level)
        with self._reading("lifts", ("lifts",)):
            self._lifts(levels)
        ontology, map = upper().extended(self.types.values()), Map(self.objects.values(), self.facts)
        if not self.problems:
            for broken in violations(map, ontology):
                self.problems.append(
                    Problem(file=self.source.file, line=None, subject=broken.subject, rule=broken.rule, message=broken.message)
                )
        if self.problems:
            raise ModelError(self.problems)
        return Site(name=name, ontology=ontology, map=map, notes=tuple(self.notes))

    # Levels and their coordinates

    def _level(self, key: str, building: str) -> _Level | None:
        data = self.source.data["levels"][key]
        with self._reading(f"level {key}", ("levels", key)):
            elevation = float(data.get("elevation", 0.0))
            scale, flip = self._scale(key, data)
            points = [(float(v[0]) * scale, float(v[1]) * scale * flip) for v in data.get("vertices", ())]
            storey = self._add(self._fresh(_identifier(key)), "Storey", {"Elevation": elevation}, building)
            return _Level(key, data, storey, elevation, points)
        return None

    def _scale(self, key: str, data: dict[str, Any]) -> tuple[float, float]:
        """Metres per unit of the file, and the sign of y: reference images have pixels as unit, and y points down."""
        system = self.source.data.get("coordinate_system", "reference_image")
        if system != "reference_image":
            if system != "cartesian_meters":
                self.notes.append(f"coordinate system {system} is not known; its unit is taken as metres")
            return 1.0, 1.0
        ratios = []
        for start, end, parameters, *_ in data.get("measurements", ()):
            first_point, second_point = (data["vertices"][int(index)][:2] for index in (start, end))
            pixels, metres = math.dist(first_point, second_point), float(_parameter(parameters, "distance", 0.0))
            if pixels > 0 and metres > 0:
                ratios.append(metres / pixels)
        if not ratios:
            first = next(iter(self.source.data["levels"]))
            if key != first:
                return self._scale(first, self.source.data["levels"][first])
            self.notes.append(f"level {key} has no measurement; one pixel is taken as 0.05 m")
            return 0.05, -1.0
        return sum(ratios) / len(ratios), -1.0

    def _align(self, levels: list[_Level]) -> None:
        """Align the levels with the first one by their shared fiducials."""
        marks = [self._fiducials(level) for level in levels]
        for level, mine in list(zip(levels, marks, strict=True))[1:]:
            shared = mine.keys() & marks[0].keys()
            if not shared:
                self.notes.append(f"level {level.name} shares no fiducial with level {levels[0].name}; its origin is taken to be the same")
                continue
            dx, dy = (sum(marks[0][name][axis] - mine[name][axis] for name in shared) / len(shared) for axis in (0, 1))
            level.points = [(x + dx, y + dy) for x, y in level.points]
            deviation = max(math.dist((mine[name][0] + dx, mine[name][1] + dy), marks[0][name]) for name in shared)
            if deviation > 0.2:
                self.notes.append(f"level {level.name} fits level {levels[0].name} only to {deviation:.1f} m: it seems to be rotated")

    def _fiducials(self, level: _Level) -> dict[str, Point]:
        with self._reading(f"fiducials of {level.name}", ("levels", level.name, "fiducials")):
            return {str(name): self._point(level, x, y) for x, y, name, *_ in level.data.get("fiducials") or () if name}
        return {}

    def _point(self, level: _Level, x: Any, y: Any) -> Point:
        """The map coordinates of a point in the file that is not a vertex, by the transformation of the vertices."""
        scale, flip = self._scale(level.name, level.data)
        shift = (0.0, 0.0)
        if level.points:
            raw = level.data["vertices"][0]
            shift = (level.points[0][0] - float(raw[0]) * scale, level.points[0][1] - float(raw[1]) * scale * flip)
        return float(x) * scale + shift[0], float(y) * scale * flip + shift[1]

    def _reserve(self, level: _Level) -> None:
        """Reserve the names of places, so that no numbered object takes one of them."""
        for vertex in level.data.get("vertices", ()):
            if isinstance(vertex, list) and len(vertex) > 3 and vertex[3]:
                self.reserved.add(_identifier(str(vertex[3])))

    # Elements of the building

    def _fabric(self, level: _Level) -> None:
        gaps: list[tuple[Point, Point]] = []
        for index, edge_start, edge_end, parameters in self._edges(level, "doors"):
            gaps.append((edge_start, edge_end))
            name = _identifier(str(_parameter(parameters, "name", "") or f"Door{index + 1:03}"))
            self._wall_like(level, self._fresh(name), "Door", edge_start, edge_end, _DOOR_HEIGHT, {"Open": True})
        for _, edge_start, edge_end, _ in self._edges(level, "walls"):
            pieces = [(edge_start, edge_end)]
            for gap in gaps:
                pieces = [rest for piece in pieces for rest in without_gap(*piece, gap)]
            for start, end in pieces:
                level.walls.append(self._wall_like(level, self._numbered("Wall"), "Wall", start, end, _WALL_HEIGHT, {"Color": "White"}))
        for index, floor in enumerate(level.data.get("floors") or ()):
            with self._reading(f"floor {index + 1} of {level.name}", ("levels", level.name, "floors", index)):
                self._floor(level, [level.points[int(vertex)] for vertex in floor["vertices"]])
        if not level.data.get("floors"):
            self.notes.append(f"level {level.name} has no floor; one is laid under all of it")
            xs, ys = zip(*(level.points or [(0.0, 0.0)]), strict=True)
            low, high = (min(xs) - 1, min(ys) - 1), (max(xs) + 1, max(ys) + 1)
            self._floor(level, [low, (high[0], low[1]), high, (low[0], high[1])])

    def _edges(self, level: _Level, kind: str) -> Iterator[tuple[int, Point, Point, dict[str, Any]]]:
        for index, edge in enumerate(level.data.get(kind) or ()):
            with self._reading(f"{kind[:-1]} {index + 1} of {level.name}", ("levels", level.name, kind, index)):
                start, end = level.points[int(edge[0])], level.points[int(edge[1])]
                yield index, start, end, edge[2] if len(edge) > 2 else {}

    def _wall_like(self, level: _Level, name: str, type: str, start: Point, end: Point, height: float, values: dict[str, Value]) -> Box:
        overlap = _WALL_THICKNESS if type == "Wall" else 0.0
        yaw = math.atan2(end[1] - start[1], end[0] - start[0])
        box = Box((start[0] + end[0]) / 2, (start[1] + end[1]) / 2, math.dist(start, end) + overlap, _WALL_THICKNESS, yaw)
        self._add(name, type, {**_pose(box, level.elevation), **_shape(box, height), **values}, level.storey)
        return box

    def _floor(self, level: _Level, outline: list[Point]) -> None:
        xs, ys = zip(*outline, strict=True)
        x, y = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
        corners = " ".join(f"{round(px - x, 3):g},{round(py - y, 3):g}" for px, py in outline)
        values: dict[str, Value] = {
            "PositionX": round(x, 3),
            "PositionY": round(y, 3),
            "PositionZ": round(level.elevation - _FLOOR_THICKNESS, 3),
            "Shape.Form": "Polygon",
            "Shape.Height": _FLOOR_THICKNESS,
            "Shape.Outline": corners,
            "Color": "Grey",
        }
        self._add(self._numbered("Floor"), "Floor", values, level.storey)

    # Furniture and movable objects

    def _models(self, level: _Level) -> None:
        things: list[tuple[int, str, dict[str, Any]]] = []
        for index, model in enumerate(level.data.get("models") or ()):
            with self._reading(f"model {index + 1} of {level.name}", ("levels", level.name, "models", index)):
                kind = str(model["model_name"]).rpartition("/")[2]
                if kind.startswith(("TeleportDispenser", "TeleportIngestor")):
                    self.notes.append(
                        f"{model.get('name', kind)}: dispensers and ingestors are left out; robots take things and put them down"
                    )
                elif kind in THINGS and not model.get("static", True):
                    things.append((index, kind, model))
                else:
                    self._furniture(level, kind, model)
        for index, kind, model in things:  # after the furniture that supports them
            with self._reading(f"model {index + 1} of {level.name}", ("levels", level.name, "models", index)):
                self._thing(level, kind, model)

    def _furniture(self, level: _Level, kind: str, model: dict[str, Any]) -> None:
        known_size = MODELS.get(kind)
        if known_size is None:
            self.notes.append(f"{kind} is not known; an obstacle of 0.5 m represents it")
        size = known_size or UNKNOWN
        x, y = self._point(level, model["x"], model["y"])
        wanted_box = Box(x, y, size.width, size.depth, float(model.get("yaw", 0.0)))
        type_name = self._model_type(kind, size)
        name = self._numbered(_identifier(kind))
        box = cleared(wanted_box, level.walls)
        if box is None:
            self.notes.append(f"{name} overlaps walls and cannot be moved clear of them; it is left out")
            return
        if math.dist((box.x, box.y), (x, y)) > 0.3:
            self.notes.append(f"{name} is moved by {math.dist((box.x, box.y), (x, y)):.2f} m, out of a wall")
        self._add(name, type_name, _pose(box, level.elevation + float(model.get("z", 0.0))), None)
        level.furniture[name] = (box, float(model.get("z", 0.0)) + size.height, upper().is_subtype(size.parent, "Support"))

    def _model_type(self, kind: str, size: Model) -> str:
        """Define a type with the size of the model. It has Open-RMF's name, unless the upper ontology uses that name."""
        name = "UnknownModel" if size is UNKNOWN else f"{kind}Model" if kind in upper().types else kind
        defaults: dict[str, Value] = {**_shape(Box(0, 0, size.width, size.depth), size.height), "Color": size.color}
        self.types[name] = ObjectType(name=name, parent=size.parent, defaults=defaults)
        return name

    def _thing(self, level: _Level, kind: str, model: dict[str, Any]) -> None:
        name = self._numbered(_identifier(kind))
        point, z = self._point(level, model["x"], model["y"]), float(model.get("z", 0.0))
        candidates = [
            (abs(top - z), support) for support, (box, top, is_support) in level.furniture.items() if is_support and box.gap(point) < 0.05
        ]
        if candidates:
            support = min(candidates)[1]
            box, top, _ = level.furniture[support]
            moved = self._to_edge(level, support, box, point)
            if moved != point:
                self.notes.append(f"{name} is moved by {math.dist(moved, point):.2f} m, to an edge of {support} that robots can reach")
            point, z = moved, top
        else:
            support, z = next(name for name, object in self.objects.items() if object.type == "Floor"), 0.0
            self.notes.append(f"nothing is below {name}; it lies on the floor")
        self._add(name, THINGS[kind], _pose(Box(*point, 0, 0, float(model.get("yaw", 0.0))), level.elevation + z), None)
        self.facts.append(Fact("isOn", (name, support)))

    def _to_edge(self, level: _Level, support: str, box: Box, point: Point) -> Point:
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

    # Places, chargers and robots

    def _places(self, level: _Level) -> None:
        for index, vertex in enumerate(level.data.get("vertices") or ()):
            parameters = vertex[4] if len(vertex) > 4 else {}
            robot = str(_parameter(parameters, "spawn_robot_name", "") or "")
            label = str(vertex[3]) if len(vertex) > 3 and vertex[3] else ""
            if not label and not robot:
                continue
            name = _identifier(label or f"{robot}_start")
            if name in self.objects:
                name = self._fresh(f"{name}_{_identifier(level.name)}")
            point = self._free(level, name, level.points[index])
            charger = bool(_parameter(parameters, "is_charger", False))
            values = {**_pose(Box(*point, 0, 0), level.elevation), "Label": label or name}
            self._add(name, "Charger" if charger else "Place", values, level.storey)
            if robot:
                self._add(self._fresh(_identifier(robot)), "DeliveryRobot", _pose(Box(*point, 0, 0), level.elevation), None)

    def _free(self, level: _Level, name: str, point: Point) -> Point:
        """The point, or the nearest one where the disc of the place is free, so that robots can stand and put objects there."""
        free = roomiest(point, level.solid(), _PLACE_RADIUS, 1.0)
        if free is None:
            self.notes.append(f"there is no room for a robot at {name}")
            return point
        if math.dist(free, point) > 0.05:
            self.notes.append(f"{name} is moved by {math.dist(free, point):.2f} m, to where a robot has room")
        return free

    def _lifts(self, levels: list[_Level]) -> None:
        for key, data in (self.source.data.get("lifts") or {}).items():
            with self._reading(f"lift {key}", ("lifts", key)):
                x, y = self._point(levels[0], data["x"], data["y"])
                box = Box(x, y, float(data["width"]), float(data["depth"]), float(data.get("yaw", 0.0)))
                values = {**_pose(box, levels[0].elevation), **_shape(box, _WALL_HEIGHT)}
                self._add(self._fresh(_identifier(str(key))), "Lift", values, next(iter(self.objects)))
                self.notes.append(f"lift {key} is on the map as a device; robots can use it when a program serves it")

    # Names, objects, problems

    def _add(self, name: str, type: str, values: dict[str, Value], whole: str | None) -> str:
        self.objects[name] = Object(name=name, type=type, values=values)
        if whole is not None:
            self.facts.append(Fact(PART_OF, (name, whole)))
        return name

    def _fresh(self, name: str) -> str:
        return name if name not in self.objects else self._numbered(name)

    def _numbered(self, stem: str) -> str:
        while True:
            self.numbers[stem] += 1
            name = f"{stem}{self.numbers[stem]:03}"
            if name not in self.objects and name not in self.reserved:
                return name

    @contextmanager
    def _reading(self, subject: str, path: YamlPath) -> Iterator[None]:
        """Turn errors from missing or wrong values in the file into a problem with its line."""
        try:
            yield
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError, StopIteration) as error:
            missing = f"{error.args[0]} is missing" if isinstance(error, KeyError) else str(error)
            message = f"cannot be read: {missing}; correct it in the traffic editor"
            self.problems.append(
                Problem(file=self.source.file, line=self.source.line(path), subject=subject, rule="structure", message=message)
            )


def _parameter(parameters: Any, key: str, default: Any) -> Any:
    """The value of a parameter, which the file has as [type code, value]."""
    value = parameters.get(key) if isinstance(parameters, dict) else None
    return value[1] if isinstance(value, list) and len(value) == 2 else default


def _identifier(text: str) -> str:
    """The text as a valid name: `OpenRobotics/Metal Cabinet` becomes `Metal_Cabinet`."""
    name = re.sub(r"\W+", "_", text.rpartition("/")[2] or text).strip("_")
    name = name if name and not name[0].isdigit() else f"n{name}"
    return f"{name}_" if name in KEYWORDS else name


def _pose(box: Box, z: float) -> dict[str, Value]:
    yaw = math.remainder(box.yaw, math.tau)
    turned: dict[str, Value] = {"RotationZ": round(yaw, 4)} if abs(yaw) > 1e-4 else {}
    return {"PositionX": round(box.x, 3), "PositionY": round(box.y, 3), "PositionZ": round(z, 3), **turned}


def _shape(box: Box, height: float) -> dict[str, Value]:
    return {"Shape.Form": "Box", "Shape.Width": round(box.width, 3), "Shape.Depth": round(box.depth, 3), "Shape.Height": round(height, 3)}
