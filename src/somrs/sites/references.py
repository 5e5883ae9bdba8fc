"""What settings of adapters refer to on the map of a site: objects and their types, attributes, floors, positions."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from functools import cached_property

from somrs.entish.parse import nearest
from somrs.errors import Mistake, SimulationError
from somrs.ontology.files.nodes import Path
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.space.solids import Role, Solid, solid_of
from somrs.space.storeys import storey_heights

NEAR_FLOOR = 0.5
"""How far a height may be from that of a floor, m."""
BEYOND_FLOOR = 1.0
"""How far beside all floors a position may be, m."""


class Site:
    """The map of a site. Each method says what is wrong with something that settings have at a path."""

    def __init__(self, map: Map, ontology: Ontology) -> None:
        self.map, self.ontology = map, ontology

    def named(self, section: str, names: Iterable[str], type: str) -> Iterator[Mistake]:
        """The names in a section that are not those of objects of this type on the map."""
        for name in names:
            object = self.map.objects.get(name)
            if object is None:
                candidates = [object.name for object in self.map.objects.values() if self.ontology.is_subtype(object.type, type)]
                hint = nearest(name, candidates) or "put it there, under `objects`, with its type and where it stands"
                yield (section, name), f"there is no {name} on the map; {hint}"
            elif not self.ontology.is_subtype(object.type, type):
                yield (section, name), f"{name} is a {object.type} on the map, and no {type}; correct the name, or the type on the map"

    def attributes(self, path: Path, source: str, name: str, attributes: Iterable[str]) -> Iterator[Mistake]:
        """Those that objects of the type of this one do not have. `source`: the file that names them."""
        object = self.map.objects.get(name)
        if object is None or object.type not in self.ontology.types:
            return
        has = self.ontology.attributes_of(object.type)
        for attribute in attributes:
            if attribute not in has:
                hint = nearest(attribute, has) or f"add it to the attributes of {object.type}"
                yield path, f"{source} binds attributes.{attribute}, which {name}, a {object.type}, does not have; {hint}"

    def level(self, path: Path, height: float) -> Iterator[Mistake]:
        """A height that is not that of a floor or storey."""
        heights = sorted({*storey_heights(self.map, self.ontology).values(), *(floor.top for floor in self._floors)})
        if heights and min(abs(height - floor) for floor in heights) > NEAR_FLOOR:
            floors = [floor for index, floor in enumerate(heights) if index == 0 or floor - heights[index - 1] > NEAR_FLOOR]
            yield path, f"there is no floor at {height:g} m; there are floors at {', '.join(f'{floor:g} m' for floor in floors)}"

    def position(self, path: Path, x: float, y: float) -> Iterator[Mistake]:
        """A position beside all floors."""
        if self._floors and (distance := min(floor.distance(x, y) for floor in self._floors)) > BEYOND_FLOOR:
            yield path, f"({x:g}, {y:g}) is {distance:.0f} m beside all floors of the map; give metres on the map"

    @cached_property
    def _floors(self) -> list[Solid]:
        floors = []
        for object in self.map.objects.values():
            with contextlib.suppress(SimulationError):  # it has no shape; `somrs check` says so
                solid = solid_of(object, self.ontology)
                if solid is not None and solid.role is Role.FLOOR:
                    floors.append(solid)
        return floors
