"""Proposals for a new object: name, position, sizes, and the object below it."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

from somrs.gui.pages.map.composition import part_changes
from somrs.gui.pages.map.moves import ON_RELATION, TURNED, X, Y, Z, number, top
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, Object, ObjectAdded
from somrs.ontology.types import PART_OF, PHYSICAL, Ontology, Value

DIGITS = 3
"""Minimum digits of the number in a name such as Jar004."""
CEILING = 2.2
"""Height of a new camera, m."""

_NUMBERED = re.compile(r"(.*?)(\d+)$")

FORMS: tuple[tuple[str, dict[str, Value]], ...] = (
    ("Wall", {"Shape.Form": "Box", "Shape.Width": 2.0, "Shape.Depth": 0.1, "Shape.Height": 2.5}),
    ("Floor", {"Shape.Form": "Box", "Shape.Width": 4.0, "Shape.Depth": 3.0, "Shape.Height": 0.1}),
    ("Ceiling", {"Shape.Form": "Box", "Shape.Width": 4.0, "Shape.Depth": 3.0, "Shape.Height": 0.1}),
    ("Passage", {"Shape.Form": "Box", "Shape.Width": 0.1, "Shape.Depth": 0.9, "Shape.Height": 2.1}),
    ("Window", {"Shape.Form": "Box", "Shape.Width": 0.1, "Shape.Depth": 1.2, "Shape.Height": 1.2}),
    ("Pillar", {"Shape.Form": "Cylinder", "Shape.Radius": 0.2, "Shape.Height": 2.5}),
    ("Chair", {"Shape.Form": "Box", "Shape.Width": 0.45, "Shape.Depth": 0.45, "Shape.Height": 0.85}),
    ("Bin", {"Shape.Form": "Cylinder", "Shape.Radius": 0.18, "Shape.Height": 0.4}),
    ("Plant", {"Shape.Form": "Cylinder", "Shape.Radius": 0.25, "Shape.Height": 1.2}),
    ("Shelf", {"Shape.Form": "Box", "Shape.Width": 0.5, "Shape.Depth": 1.2, "Shape.Height": 0.9}),
    ("Platform", {"Shape.Form": "Box", "Shape.Width": 0.8, "Shape.Depth": 0.8, "Shape.Height": 0.3}),
    ("Furniture", {"Shape.Form": "Box", "Shape.Width": 0.7, "Shape.Depth": 1.2, "Shape.Height": 0.74}),
    ("Graspable", {"Shape.Form": "Cylinder", "Shape.Radius": 0.04, "Shape.Height": 0.12}),
    (PHYSICAL, {"Shape.Form": "Box", "Shape.Width": 0.4, "Shape.Depth": 0.4, "Shape.Height": 0.4}),
)
"""Sizes of new objects for which neither their type nor another object of it gives any; the first type that fits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """The position on the plan that the user clicked. `target`: the object below it; `storey`: the storey."""

    x: float
    y: float
    turned: float = 0.0
    target: str | None = None
    storey: str = ""


def name_for(type_name: str, map: Map) -> str:
    """An unused name that continues the numbering of its type."""
    matches = [match for name in map.of_type(type_name) if (match := _NUMBERED.match(name))]
    prefixes = Counter(match[1] for match in matches)
    prefix = prefixes.most_common(1)[0][0] if prefixes else type_name
    numerals = [match[2] for match in matches if match[1] == prefix]
    digits = max((len(numeral) for numeral in numerals), default=DIGITS)
    number = max((int(numeral) for numeral in numerals), default=0) + 1
    while (name := f"{prefix}{number:0{digits}d}") in map.objects:
        number += 1
    return name


def form_for(type_name: str, map: Map, ontology: Ontology) -> dict[str, Value]:
    """The sizes of a new object whose type has no default form: those of the latest object of the type, or usual ones."""
    if "Shape" not in {path.partition(".")[0] for path in ontology.attributes_of(type_name)}:
        return {}
    if ontology.default(type_name, "Shape.Form") is not None or not _is_required(type_name, "Shape", ontology):
        return {}
    for name in reversed([*map.of_type(type_name)]):
        sizes = {path: value for path, value in map.objects[name].values.items() if path.startswith("Shape.") and path != "Shape.Outline"}
        if sizes.get("Shape.Form") in ("Box", "Cylinder"):
            return sizes
    return dict(next(form for ancestor, form in FORMS if ontology.is_subtype(type_name, ancestor)))


def _is_required(type_name: str, attribute: str, ontology: Ontology) -> bool:
    return any(attribute in ontology.types[ancestor].required for ancestor in ontology.ancestors(type_name))


def creation_changes(
    type_name: str, name: str, values: dict[str, Value], spot: Spot | None, map: Map, ontology: Ontology
) -> tuple[Change, ...]:
    """The changes that add an object of the type, with its obligatory parts, at the position, if any."""
    attributes = ontology.attributes_of(type_name)
    facts: list[Fact] = []
    if spot is not None:
        floor = _elevation(spot.storey, map, ontology)
        values = {X: round(float(spot.x), 4), Y: round(float(spot.y), 4), **values}
        z = _height(type_name, values, floor, ontology)
        if spot.target is not None and ontology.is_subtype(type_name, "Graspable"):
            facts.append(Fact(ON_RELATION, (name, spot.target)))
            z = round(top(map, ontology, spot.target), 4)
        if z != ontology.default(type_name, Z):
            values[Z] = z
        if spot.turned and TURNED in attributes:
            values[TURNED] = round(spot.turned, 5)
        if ontology.is_subtype(type_name, "BuildingElement") and (whole := _whole(type_name, spot, map, ontology)) is not None:
            facts.append(Fact(PART_OF, (name, whole)))
    elif (root := next(iter(map.roots()), None)) is not None:
        facts.append(Fact(PART_OF, (name, root)))  # otherwise it would be in no building
    known_values = {path: value for path, value in values.items() if path in attributes}
    object = Object(name=name, type=type_name, values=known_values)
    return (ObjectAdded(object), *(FactAdded(fact) for fact in facts), *part_changes(object, ontology))


def _height(type_name: str, values: dict[str, Value], floor: float, ontology: Ontology) -> float:
    thick = values.get("Shape.Height")
    if ontology.is_subtype(type_name, "Floor") and isinstance(thick, int | float):
        return round(floor - thick, 4)
    if ontology.is_subtype(type_name, "Camera"):
        return floor + CEILING
    return floor + 0.9 if ontology.is_subtype(type_name, "Window") else floor


def _elevation(storey: str, map: Map, ontology: Ontology) -> float:
    return (number(map, ontology, storey, "Elevation") if storey in map.objects else None) or 0.0


def _whole(type_name: str, spot: Spot, map: Map, ontology: Ontology) -> str | None:
    """The object of which a new wall or door becomes a part: the whole of the floor below it; of a floor, the storey."""
    if not ontology.is_subtype(type_name, "Floor") and spot.target in map.objects and spot.target is not None:
        floor = spot.target
        while floor is not None and floor in map.objects and not ontology.is_subtype(map.objects[floor].type, "AbstractObject"):
            whole = map.whole(floor)
            if whole is None:
                break
            floor = whole
        if floor in map.objects and ontology.is_subtype(map.objects[floor].type, "AbstractObject"):
            return floor
    return spot.storey or next(iter(map.roots()), None)
