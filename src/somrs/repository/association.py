"""Data association: which objects of the map the sighted objects of a report are (paper, "Environment representation": attributes are
recognised and measured by robots' sensors).

A sighting and an object may be the same if one's type is the other's or a super-type of it, and if every attribute that the report states
agrees with the object's within the attribute's tolerance. Attributes that change (the pose, truth values, and what services change) do not
count. Among the possible pairs, the assignment with the least total cost is taken, each object for at most one sighting:

| the object | cost |
|---|---|
| is near: at most `NEAR` from where the map has it, or, where no position is known, in the same place | the distance, in metres |
| may be anywhere: it is sought, unknown, a device, or missed where the report searched; or one has no place | `NEAR` or more |
| may have been here: a device holds it, or it was moved or removed after the report | almost `2 * NEAR`; nothing is decided |
| none: the sighting is of a new object | `2 * NEAR` |
"""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from somrs.entish.formula import Attribute, Comparison, literals
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import PHYSICAL, UNKNOWN, Kind, Ontology
from somrs.ontology.units import convert_unit
from somrs.ontology.values import MeasuredValue, attribute_at, compare, constant, value_of
from somrs.repository.assignment import assign

NEAR = 0.5
"""Largest distance, in metres, between a sighting and the place of an object on the map that counts as the same place."""

SAME_PLACE = 0.1
"""Distance in metres within which two things that look the same are one: solid things are not in one place."""

DEVICE = "Device"
"""The type of objects that move by themselves, and that put themselves on the map when they join."""

MOST_COMPARED = 1000
"""With more objects of its types, a sighting is compared only with those that are near, or that may be anywhere."""

_NEW = 2 * NEAR
_HELD_BACK, _DOUBTFUL = _NEW - 2e-6, _NEW - 1e-6
_POSITION = ("PositionX", "PositionY", "PositionZ")
_POSE = ("Position", "Rotation")
"""Beginnings of the attributes of the pose."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """An object as a report describes it. `object` has its type and its stated values; `place`: what it is on, in or held by."""

    variable: str
    object: Object
    place: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """What the association knows besides the map.

    `anywhere`: objects whose place on the map does not count; `sought`: those of them that the report looked for.
    `held`: objects that are on their way with a device. `moved`: objects that the map has somewhere only since after the report.
    `departed`: objects that were removed after the report. `provisional`: objects that are known from sightings only.
    """

    anywhere: Collection[str] = ()
    sought: Collection[str] = ()
    held: Collection[str] = ()
    moved: Collection[str] = ()
    departed: Sequence[Object] = ()
    provisional: Collection[str] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Association:
    """`names`: the object of each sighting that is on the map. `new`: sightings of no object of the map. `undecided`: the others.

    `duplicates`: provisional objects, with the sought object that each turned out to be.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    new: Collection[str] = ()
    undecided: Collection[str] = ()
    duplicates: Mapping[str, str] = field(default_factory=dict)


def associate(sightings: Sequence[Sighting], map: Map, ontology: Ontology, near_objects: Surroundings) -> Association:
    """Associate the sightings of one report with the objects of the map."""
    associating = _Associating(map, ontology, near_objects)
    costs = [associating.costs(sighting) for sighting in sightings]
    assigned = assign(costs, _NEW)
    names: dict[str, str] = {}
    new: list[str] = []
    undecided: list[str] = []
    for sighting, row, name in zip(sightings, costs, assigned, strict=True):
        if name is None:
            new.append(sighting.variable)
        elif row[name] == _DOUBTFUL:
            undecided.append(sighting.variable)
        else:
            names[sighting.variable] = name
    return Association(names=names, new=new, undecided=undecided, duplicates=dict(associating.duplicates(sightings, costs, names)))


def coinciding(name: str, others: Iterable[str], map: Map, ontology: Ontology) -> list[str]:
    """Those of the other objects that look like the object and are in its place, as the map has both."""
    associating = _Associating(map, ontology, Surroundings())
    sighting = Sighting(variable=name, object=map.objects[name], place=place_of(name, map, ontology))
    return [other for other in others if associating.coincides(sighting, other)]


class _Associating:
    def __init__(self, map: Map, ontology: Ontology, near_objects: Surroundings) -> None:
        self.map, self.ontology, self.around = map, ontology, near_objects
        self._changing = changing_attributes(ontology)
        self._to_metres = {path: _metres(path, ontology) for path in _POSITION}
        self._compatible = functools.cache(lambda type_name: compatible_types(type_name, ontology))

    def costs(self, sighting: Sighting) -> dict[str, float]:
        """The cost of each object that the sighting may be of."""
        costs = {name: cost for name in self._candidates(sighting) if (cost := self._cost(sighting, name)) is not None}
        if any(name in self.around.sought for name in costs):
            # What is known from a sighting alone may be the very object that is sought.
            costs.update((name, _HELD_BACK) for name, cost in costs.items() if name in self.around.provisional and cost <= NEAR)
        costs.update((f" {object.name}", _DOUBTFUL) for object in self.around.departed if self._agrees(sighting, object, Map([object])))
        return costs

    def duplicates(
        self, sightings: Sequence[Sighting], costs: Sequence[Mapping[str, float]], names: Mapping[str, str]
    ) -> Iterator[tuple[str, str]]:
        """The provisional objects at the place of a sighting that turned out to be of a sought object from elsewhere."""
        assigned = set(names.values())
        for sighting, row in zip(sightings, costs, strict=True):
            name = names.get(sighting.variable)
            if name is not None and name in self.around.sought and row[name] > NEAR:
                rivals = [rival for rival, cost in row.items() if cost == _HELD_BACK and rival not in assigned]
                if rivals:
                    yield self._nearest(sighting, rivals), name

    def _nearest(self, sighting: Sighting, names: Iterable[str]) -> str:
        return min(names, key=lambda name: (self._distance(sighting, name) or 0.0, name))

    def coincides(self, sighting: Sighting, name: str) -> bool:
        distance = self._distance(sighting, name)
        return distance is not None and distance <= SAME_PLACE and self._agrees(sighting, self.map.objects[name], self.map)

    def _candidates(self, sighting: Sighting) -> Iterable[str]:
        """The objects that the sighting may be of: those of its types, or where they are many, those of them that `_cost` considers."""
        types = self._compatible(sighting.object.type)
        x, y = (self._metric(sighting, path) for path in _POSITION[:2])
        if x is None or y is None or sum(len(self.map.of_type(name)) for name in types) <= MOST_COMPARED:
            return (name for type_name in types for name in self.map.of_type(type_name))
        places, near_objects = self.map.places, self.around
        names = {*places.near(x, y, NEAR), *near_objects.anywhere, *near_objects.held, *near_objects.moved}
        names.update(name for type_name in types for name in places.unplaced(type_name))
        names.update(name for name in types if self.ontology.is_subtype(name, DEVICE) for name in self.map.of_type(name))
        if sighting.place is not None:
            relations = exclusive_relations(self.ontology)
            names.update(arguments[0] for relation in relations for arguments in self.map.facts_with(relation, 1, sighting.place))
        return [name for name in names if name in self.map.objects and self.map.objects[name].type in types]

    def _metric(self, sighting: Sighting, path: str) -> float | None:
        """The coordinate of a sighting, if it states it in metres, as the squares of a map are."""
        value = sighting.object.values.get(path)
        return value if isinstance(value, int | float) and self._to_metres[path] == 1.0 else None

    def _cost(self, sighting: Sighting, name: str) -> float | None:
        """The cost of the pair; None if the object cannot be the sighted one."""
        object, near_objects = self.map.objects[name], self.around
        distance = self._distance(sighting, name)
        is_near = distance is not None and distance <= NEAR
        is_free = distance is None or name in near_objects.anywhere or self.ontology.is_subtype(object.type, DEVICE)
        is_doubtful = name in near_objects.held or name in near_objects.moved
        if not (is_near or is_free or is_doubtful) or not self._agrees(sighting, object, self.map):
            return None
        if is_near and distance is not None:
            return distance
        if is_doubtful and name not in near_objects.anywhere:
            return _DOUBTFUL
        far = distance if distance is not None and math.isfinite(distance) else 0.0
        return NEAR + 0.9 * NEAR * far / (1 + far)

    def _distance(self, sighting: Sighting, name: str) -> float | None:
        """The distance in metres between the sighting and the object's place; infinite in different places; None if it is not known."""
        place = place_of(name, self.map, self.ontology)
        if place is not None and place == sighting.place and name in self.around.held:
            return NEAR / 2  # the same device holds both
        if name in self.around.held:
            return None if name in self.around.anywhere else math.inf  # its position on the map is where it was before
        gaps = [self._gap(sighting.object.values.get(path), value_of(name, path, self.map, self.ontology), path) for path in _POSITION]
        if gaps[0] is not None and gaps[1] is not None:
            return math.hypot(gaps[0], gaps[1], gaps[2] or 0.0)
        if place is None or sighting.place is None:
            return None
        return NEAR / 2 if place == sighting.place else math.inf

    def _gap(self, seen: object, value: object, path: str) -> float | None:
        if isinstance(seen, int | float) and isinstance(value, int | float):
            return (seen - value) * self._to_metres[path]
        return None

    def _agrees(self, sighting: Sighting, object: Object, map: Map) -> bool:
        """Whether the stated attributes agree, and the types."""
        return object.type in self._compatible(sighting.object.type) and all(
            self._is_same(path, value, value_of(object.name, path, map, self.ontology))
            for path, value in sighting.object.values.items()
            if not path.startswith(_POSE) and path not in self._changing
        )

    def _is_same(self, path: str, seen: float | str | bool, value: float | str | bool | None) -> bool:
        attribute = attribute_at(path, self.ontology)
        if value is None or attribute is None or attribute.kind is Kind.TRUTH:
            return True
        measured = (MeasuredValue(constant(part, attribute), attribute.tolerance) for part in (seen, value))
        return compare(next(measured), "=", next(measured))


def changing_attributes(ontology: Ontology) -> set[str]:
    """The attributes that an effect of a service type sets, and that an object is not recognised by for that reason."""
    effects = [parse(service.effect) for service in ontology.services.values()]
    sides = (side for effect in effects for atom in literals(effect) if isinstance(atom, Comparison) for side in (atom.left, atom.right))
    return {UNKNOWN, *(side.path for side in sides if isinstance(side, Attribute))}


def compatible_types(type_name: str, ontology: Ontology) -> set[str]:
    """The type, its subtypes and its super-types, as far as these are physical."""
    related = {*ontology.ancestors(type_name), *ontology.subtypes(type_name)}
    return {type_name, *(related_type for related_type in related if ontology.is_subtype(related_type, PHYSICAL))}


def place_of(name: str, map: Map, ontology: Ontology) -> str | None:
    """What the object is on, in or held by: the other argument of its fact of an exclusive relation."""
    for relation in exclusive_relations(ontology):
        for arguments in map.facts_with(relation, 0, name):
            return arguments[1]
    return None


def exclusive_relations(ontology: Ontology) -> Iterable[str]:
    """The relations between two objects that exclude others: those that say where something is."""
    return (relation.name for relation in ontology.relations.values() if relation.excludes is not None and len(relation.joins) == 2)


def _metres(path: str, ontology: Ontology) -> float:
    attribute = ontology.attributes.get(path)
    metres = convert_unit(1.0, attribute.unit, "m") if attribute is not None and attribute.unit else 1.0
    return metres if metres is not None else 1.0
