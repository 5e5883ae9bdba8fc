"""A map during its import: objects with fresh names, facts, types, and notes."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field

from somrs.entish.parse import KEYWORDS
from somrs.errors import ModelError, Problem
from somrs.ontology.conformance import violations
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import PART_OF, ObjectType, Value
from somrs.sites.notes import NoteCollector
from somrs.sites.plan import Box, Point
from somrs.sites.site import Site

FLOOR_THICKNESS = 0.1


@dataclass(slots=True)
class Draft:
    """The objects, facts and types of a map that is being made."""

    objects: dict[str, Object] = field(default_factory=dict)
    facts: list[Fact] = field(default_factory=list)
    types: dict[str, ObjectType] = field(default_factory=dict)
    notes: NoteCollector = field(default_factory=NoteCollector)
    reserved: set[str] = field(default_factory=set)
    """Names that no numbered object may take."""
    _numbers: Counter[str] = field(default_factory=Counter)

    def add(self, name: str, type: str, values: dict[str, Value], whole: str | None = None) -> str:
        self.objects[name] = Object(name=name, type=type, values=values)
        if whole is not None:
            self.facts.append(Fact(PART_OF, (name, whole)))
        return name

    def relate(self, relation: str, *names: str) -> None:
        self.facts.append(Fact(relation, names))

    def fresh(self, name: str) -> str:
        return name if name not in self.objects else self.numbered(name)

    def numbered(self, stem: str) -> str:
        while True:
            self._numbers[stem] += 1
            name = f"{stem}{self._numbers[stem]:03}"
            if name not in self.objects and name not in self.reserved:
                return name

    def add_floor(self, outline: list[Point], elevation: float, storey: str, kind: str = "Floor", height: float = FLOOR_THICKNESS) -> str:
        """Add a floor, or what is like one, with this outline; its underside is that of the storey's floors."""
        return self.add(self.numbered(kind), kind, floor_values(outline, elevation, height), storey)

    def site(self, name: str, file: str) -> Site:
        """The finished map. Raises ModelError if it breaks a rule of the ontology."""
        ontology, map = upper().extended(self.types.values()), Map(self.objects.values(), self.facts)
        problems = [
            Problem(file=file, line=None, subject=broken.subject, rule=broken.rule, message=broken.message)
            for broken in violations(map, ontology)
        ]
        if problems:
            raise ModelError(problems)
        return Site(name=name, ontology=ontology, map=map, notes=self.notes.notes())


def identifier(text: str) -> str:
    """The text as a valid name: `OpenRobotics/Metal Cabinet` becomes `Metal_Cabinet`."""
    name = re.sub(r"\W+", "_", text.rpartition("/")[2] or text).strip("_")
    name = name if name and not name[0].isdigit() else f"n{name}"
    return f"{name}_" if name in KEYWORDS else name


def pose(box: Box, z: float) -> dict[str, Value]:
    yaw = math.remainder(box.yaw, math.tau)
    turned: dict[str, Value] = {"RotationZ": round(yaw, 4)} if abs(yaw) > 1e-4 else {}
    return {"PositionX": round(box.x, 3), "PositionY": round(box.y, 3), "PositionZ": round(z, 3), **turned}


def floor_values(outline: list[Point], elevation: float, height: float = FLOOR_THICKNESS) -> dict[str, Value]:
    """The pose, the shape and the colour of a floor with this outline, whose top is at the elevation if it has the usual thickness."""
    xs, ys = zip(*outline, strict=True)
    x, y = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
    return {
        **pose(Box(x, y, 0, 0), elevation - FLOOR_THICKNESS),
        "Shape.Form": "Polygon",
        "Shape.Height": height,
        "Shape.Outline": " ".join(f"{round(px - x, 3):g},{round(py - y, 3):g}" for px, py in outline),
        "Color": "Grey",
    }


def box_shape(box: Box, height: float) -> dict[str, Value]:
    return {"Shape.Form": "Box", "Shape.Width": round(box.width, 3), "Shape.Depth": round(box.depth, 3), "Shape.Height": round(height, 3)}
