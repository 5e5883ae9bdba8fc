"""Which offers pass between two Registries: those of some service types, devices or areas."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache

from msgspec import Struct

from somrs.errors import SimulationError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.qualified_names import plain_name
from somrs.ontology.services import ServiceType
from somrs.ontology.types import PART_OF, Ontology, Value
from somrs.protocol.messages.directory import Offer
from somrs.space.solids import area_of
from somrs.space.storeys import BELOW_FLOOR, elevation_of

AT, STANDS_AT, STOREY, FLOOR = "isAt", "standsAt", "Storey", "Floor"

ROOM_HEIGHT = 3.0
"""How high over a floor a device is still in its room, m."""


class Selection(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Selects offers that meet every criterion that is given; without criteria, all offers.

    `types`: of one of these service types or their sub-types. `providers`: of one of these devices. `areas`: of a device that is in one of
    these rooms, storeys or other objects of the map.
    """

    types: tuple[str, ...] = ()
    providers: tuple[str, ...] = ()
    areas: tuple[str, ...] = ()


class Selector:
    """Applies a selection to offers, by an ontology and a map. Without a map, no device is in any area."""

    def __init__(self, selection: Selection, ontology: Ontology, map: Map | None) -> None:
        self._selection, self._ontology, self._map = selection, ontology, map
        self._is_inside = cache(self._is_in_areas)

    def selects(self, offer: Offer) -> bool:
        """Whether the offer is one of the selected."""
        selection = self._selection
        return (
            (not selection.providers or not {offer.provider, plain_name(offer.provider)}.isdisjoint(selection.providers))
            and (not selection.types or not type_names(offer.service_type, self._ontology).isdisjoint(selection.types))
            and (not selection.areas or self._is_inside(offer.provider))
        )

    def _is_in_areas(self, device: str) -> bool:
        if self._map is None:
            return False
        enclosing = _enclosing(device, self._map, self._ontology)
        return any(area in enclosing or _is_within(device, area, self._map, self._ontology) for area in self._selection.areas)


def type_names(service_type: ServiceType, ontology: Ontology) -> frozenset[str]:
    """The name of a service type, and the names of its ancestors."""
    names, parent = {service_type.name}, service_type.parent
    while parent is not None and parent not in names:
        names.add(parent)
        parent = ontology.services[parent].parent if parent in ontology.services else None
    return frozenset(names)


def _enclosing(name: str, map: Map, ontology: Ontology) -> set[str]:
    """What the object is part of, on, in or at, directly or through others."""
    exclusive = (relation.name for relation in ontology.relations.values() if relation.excludes and len(relation.joins) == 2)
    relations = (PART_OF, AT, STANDS_AT, *exclusive)
    pending, reached = [name], set[str]()
    while pending:
        inner = pending.pop()
        outer = {arguments[1] for relation in relations for arguments in map.facts_with(relation, 0, inner)}
        pending += outer - reached
        reached |= outer
    return reached


def _is_within(name: str, area: str, map: Map, ontology: Ontology) -> bool:
    """Whether the position of the object is in the area: at the height of a storey, over a floor of a room, or in a zone."""
    object, outer = map.objects.get(name), map.objects.get(area)
    if object is None or outer is None:
        return False
    x, y, z = (_number(object.values.get(path)) for path in ("PositionX", "PositionY", "PositionZ"))
    if x is None or y is None:
        return False
    if ontology.is_subtype(outer.type, STOREY):
        elevation = elevation_of(area, map, ontology)
        higher = (other for other in _elevations(map, ontology) if other > elevation)
        return elevation - BELOW_FLOOR <= (z or 0.0) < min(higher, default=math.inf) - BELOW_FLOOR
    floors = (outer, *(part for part in map.parts(area) if ontology.is_subtype(part.type, FLOOR)))
    return any(_is_over(x, y, z, floor, ontology) for floor in floors)


def _is_over(x: float, y: float, z: float | None, floor: Object, ontology: Ontology) -> bool:
    try:
        solid = area_of(floor, ontology)
    except SimulationError:  # an object without extent, in which nothing is
        return False
    if solid is None or solid.distance(x, y) > 0:
        return False
    return z is None or solid.z - BELOW_FLOOR <= z < solid.z + ROOM_HEIGHT


def _elevations(map: Map, ontology: Ontology) -> Iterator[float]:
    """The heights of all storeys, m."""
    for type_name in (STOREY, *ontology.subtypes(STOREY)):
        yield from (elevation_of(storey, map, ontology) for storey in map.of_type(type_name))


def _number(value: Value | None) -> float | None:
    return float(value) if isinstance(value, int | float) else None
