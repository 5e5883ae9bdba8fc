"""Proposals for the obligatory parts of new furniture: a top and legs, from its shape."""

from __future__ import annotations

import math
from collections.abc import Iterator

from somrs.gui.pages.map.moves import TURNED, X, Y, Z
from somrs.ontology.objects import Change, Fact, FactAdded, Object, ObjectAdded
from somrs.ontology.types import PART_OF, Ontology, Value

LEG, TOP = "FurnitureLeg", "TableTop"
CUBOID_LEG = "CuboidFurnitureLeg"

LEG_SIZE = 0.045
"""Width and depth of a leg, m."""

THICKNESS = 0.035
"""Of a top, m; at most a quarter of the height."""


def part_changes(whole: Object, ontology: Ontology) -> Iterator[Change]:
    """The changes that add the top and the legs that the type of the object demands; none if its shape is not known."""
    demanded = {part.type for part in ontology.parts_of(whole.type) if part.minimum > 0}
    size = {path.removeprefix("Shape."): value for path, value in whole.values.items() if path.startswith("Shape.")}
    height = size.get("Height")
    if not isinstance(height, int | float):
        return
    thickness = min(THICKNESS, height / 4)
    if TOP in demanded:
        shape = {f"Shape.{name}": value for name, value in size.items() if name != "Height"}
        yield from _part(whole, TOP, "Top", {**shape, "Shape.Height": round(thickness, 4)}, (0.0, 0.0, height - thickness))
    if LEG in demanded and CUBOID_LEG in ontology.types:
        leg: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": LEG_SIZE, "Shape.Depth": LEG_SIZE}
        leg["Shape.Height"] = round(height - thickness, 4)
        for number, (x, y) in enumerate(_corners(size), 1):
            yield from _part(whole, CUBOID_LEG, f"Leg{number}", leg, (x, y, 0.0))


def _corners(size: dict[str, Value]) -> list[tuple[float, float]]:
    """The places of four legs within a box or a cylinder, in the object's own frame."""
    radius, width, depth = (size.get(name) for name in ("Radius", "Width", "Depth"))
    if isinstance(width, int | float) and isinstance(depth, int | float):
        half_width, half_depth = width / 2 - LEG_SIZE, depth / 2 - LEG_SIZE
    elif isinstance(radius, int | float):
        half_width = half_depth = (radius - LEG_SIZE) / math.sqrt(2)
    else:
        return []
    return [(x * half_width, y * half_depth) for x in (-1, 1) for y in (-1, 1)]


def _part(whole: Object, type_name: str, suffix: str, values: dict[str, Value], place: tuple[float, float, float]) -> Iterator[Change]:
    """The changes that add a part; `place` is its position in the frame of the whole."""
    position = [whole.values.get(path) for path in (X, Y)]
    floor, turned = whole.values.get(Z, 0.0), whole.values.get(TURNED, 0.0)
    if all(isinstance(value, int | float) for value in (*position, floor, turned)):
        cos, sin = math.cos(float(turned)), math.sin(float(turned))
        x, y = (float(value or 0.0) for value in position)
        placed = {X: x + cos * place[0] - sin * place[1], Y: y + sin * place[0] + cos * place[1], Z: float(floor) + place[2]}
        values = {**{path: round(value, 4) for path, value in placed.items()}, **({TURNED: turned} if turned else {}), **values}
    name = f"{whole.name}{suffix}"
    yield ObjectAdded(Object(name=name, type=type_name, values=values))
    yield FactAdded(Fact(PART_OF, (name, whole.name)))
