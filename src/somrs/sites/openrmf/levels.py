"""The levels of a building file, and how the coordinates of each become metres on the map."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from somrs.sites.notes import NoteCollector, Rank
from somrs.sites.openrmf.document import Document, name_text, number, parameter, whole_number
from somrs.sites.plan import Box, Point
from somrs.sites.projection import Projection, from_web_mercator

PIXEL = 0.05
"""The width of a pixel of a drawing without measurements, m: the traffic editor assumes the same."""
_METRES, _IMAGE, _DEGREES, _MERCATOR = "cartesian_meters", "reference_image", "wgs84", "web_mercator"
SYSTEMS = (_IMAGE, _METRES, _DEGREES, _MERCATOR)


@dataclass(frozen=True, slots=True)
class Similarity:
    """A rotation, scaling and translation of the plane, as complex numbers: z becomes factor · z + offset."""

    factor: complex = 1
    offset: complex = 0

    def __call__(self, point: Point) -> Point:
        moved = self.factor * complex(*point) + self.offset
        return moved.real, moved.imag

    @property
    def turn(self) -> float:
        return cmath.phase(self.factor)

    @staticmethod
    def between(points: list[Point], targets: list[Point]) -> Similarity:
        """The one that brings points nearest to their targets (least squares); with one point, or all at one place, a translation."""
        sources, ends = [complex(*point) for point in points], [complex(*target) for target in targets]
        middle, end_middle = sum(sources) / len(sources), sum(ends) / len(ends)
        spread = sum(abs(source - middle) ** 2 for source in sources)
        factor = (
            sum((source - middle).conjugate() * (end - end_middle) for source, end in zip(sources, ends, strict=True)) / spread
            if spread > 1e-6
            else 1
        )
        return Similarity(factor, end_middle - factor * middle)


@dataclass(slots=True)
class Level:
    """A storey during the import."""

    name: str
    data: dict[str, Any]
    storey: str
    elevation: float
    metres: Callable[[float, float], Point]
    """From coordinates of the file to metres, before the level is aligned with the others."""
    alignment: Similarity = Similarity()
    walls: list[Box] = field(default_factory=list)
    floors: dict[str, list[Point]] = field(default_factory=dict)
    """By object: the outline of each floor."""
    furniture: dict[str, tuple[Box, float, bool]] = field(default_factory=dict)
    """By object: its rectangle, the height of its top above the storey's floor, and whether it can support other objects."""
    waypoints: dict[int, str] = field(default_factory=dict)
    """By the index of a vertex: the object that stands for it."""
    _points: list[Point] | None = None

    def point(self, x: Any, y: Any) -> Point:
        """The map coordinates of a point in the file."""
        return self.alignment(self.metres(number(x), number(y)))

    @property
    def points(self) -> list[Point]:
        """The map coordinates of the vertices."""
        if self._points is None:
            self._points = [self.point(vertex[0], vertex[1]) for vertex in self.data.get("vertices") or ()]
        return self._points

    def align(self, alignment: Similarity) -> None:
        self.alignment, self._points = alignment, None

    def vertex(self, index: Any) -> Point:
        return self.points[whole_number(index)]

    def heading(self, yaw: Any) -> float:
        return number(yaw) + self.alignment.turn

    def solid(self) -> list[Box]:
        return [*self.walls, *(box for box, _, _ in self.furniture.values())]


class Coordinates:
    """The coordinate system of a building file. Raises ValueError for one that is not known."""

    def __init__(self, document: Document, notes: NoteCollector) -> None:
        self.document, self.notes = document, notes
        self.system = str(document.data.get("coordinate_system") or _IMAGE)
        if self.system not in SYSTEMS:
            raise ValueError(f"the coordinate system {self.system} is not known; it is one of {', '.join(SYSTEMS)}")
        self.projection = Projection.about(self._geographic_points()) if self.system in (_DEGREES, _MERCATOR) else None

    def metres(self, name: str, data: dict[str, Any]) -> Callable[[float, float], Point]:
        """From coordinates of a level in the file to metres."""
        if self.projection is not None:
            projection, degrees = self.projection, self._degrees
            return lambda x, y: projection(*degrees(x, y))
        if self.system == _METRES:
            return lambda x, y: (x, y)
        scale = self._scale(name, data)
        return lambda x, y: (x * scale, -y * scale)  # y points down in an image

    def align(self, levels: list[Level]) -> None:
        """Align the levels with the reference level, by the fiducials that they share with it."""
        reference_name = name_text(self.document.data.get("reference_level_name") or levels[0].name)
        reference = next((level for level in levels if level.name == reference_name), levels[0])
        if reference.name != reference_name:
            text = f"is named as the reference level and is not there; the levels are aligned with {reference.name}"
            self.notes.add(Rank.ASSUMED, reference_name, text)
        marks = {level.name: self._fiducials(level) for level in levels}
        for level in levels:
            shared = sorted(marks[level.name].keys() & marks[reference.name].keys())
            if level is reference or self.projection is not None:
                continue
            if not shared:
                text = f"shares no fiducial with level {reference.name}; its origin is taken to be the same"
                self.notes.add(Rank.ASSUMED, f"level {level.name}", text)
                continue
            points, targets = [marks[level.name][mark] for mark in shared], [marks[reference.name][mark] for mark in shared]
            level.align(Similarity.between(points, targets))
            deviation = max(math.dist(level.alignment(point), target) for point, target in zip(points, targets, strict=True))
            if deviation > 0.2:
                text = f"its fiducials fit those of level {reference.name} only roughly; move them in the traffic editor"
                self.notes.add(Rank.ASSUMED, f"level {level.name} ({deviation:.1f} m)", text)

    def _degrees(self, x: float, y: float) -> Point:
        return from_web_mercator(x, y) if self.system == _MERCATOR else (x, y)

    def _geographic_points(self) -> list[Point]:
        vertices = [vertex for level in self.document.data["levels"].values() for vertex in level.get("vertices") or ()]
        origin = str(self.document.parameter("generate_origin_vertex", "") or "")
        named = [vertex for vertex in vertices if origin and len(vertex) > 3 and vertex[3] == origin]
        return [self._degrees(number(vertex[0]), number(vertex[1])) for vertex in named or vertices]

    def _scale(self, name: str, data: dict[str, Any]) -> float:
        """Metres per pixel, by the measurements in the drawing of the level, or else of the first level."""
        ratios = []
        for measurement in data.get("measurements") or ():
            first_point, second_point = (data["vertices"][whole_number(index)][:2] for index in measurement[:2])
            pixels, metres = math.dist(first_point, second_point), number(parameter(measurement[2], "distance", 0.0))
            if pixels > 0 and metres > 0:
                ratios.append(metres / pixels)
        if ratios:
            return sum(ratios) / len(ratios)
        first_name, first_level = next(iter(self.document.data["levels"].items()))
        if data is not first_level:
            return self._scale(name_text(first_name), first_level)
        self.notes.add(Rank.ASSUMED, f"level {name}", f"has no measurement; one pixel is taken as {PIXEL} m")
        return PIXEL

    def _fiducials(self, level: Level) -> dict[str, Point]:
        with self.document.reading(f"fiducials of {level.name}", ("levels", level.name, "fiducials")):
            return {name_text(mark[2]): level.point(mark[0], mark[1]) for mark in level.data.get("fiducials") or () if mark[2]}
        return {}
