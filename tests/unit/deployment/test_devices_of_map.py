"""Which devices a system starts programs for."""

from __future__ import annotations

from msgspec import structs

from somrs.deployment.devices_of_map import devices
from somrs.ontology.objects import ObjectAdded
from tests.support.lab import lab


def test_devices_of_neighbours_have_programs_there() -> None:
    ontology, map = lab()
    own = devices(map, ontology)
    assert [name for name, _ in own] == ["Robot1"]
    with_neighbour = map.changed([ObjectAdded(structs.replace(map.objects["Robot1"], name="Barn:Robot1"))])
    assert devices(with_neighbour, ontology) == own
