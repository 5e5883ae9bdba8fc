"""The modes of buildings, lifts and doors on a map."""

from __future__ import annotations

from somrs.ontology.files.loading import load_text
from somrs.ontology.modes import Mode, hold_reason, mode_of, modes, passages_out_of_order
from somrs.ontology.objects import ValueSet
from somrs.ontology.types import MODE
from somrs.ontology.values import takes_work
from tests.support.building import building

LOADED = load_text(
    building("House", 4, 4, "Door1: {type: PoweredDoor, at: [1, 1, 0], Shape: {Form: Box, Width: 1, Depth: 0.1, Height: 2}}"), "house.yaml"
)


def test_everything_is_normal_unless_the_map_says_otherwise() -> None:
    map, ontology = LOADED.map, LOADED.ontology
    assert map is not None
    assert (modes(map), hold_reason(modes(map)), passages_out_of_order(modes(map))) == ({}, "", ())
    assert mode_of("Building1", map, ontology) is Mode.NORMAL
    assert mode_of("Floor1", map, ontology) is Mode.NORMAL


def test_a_fire_holds_robots_and_a_door_out_of_order_does_not() -> None:
    map, ontology = LOADED.map, LOADED.ontology
    assert map is not None
    burning = map.changed([ValueSet("Building1", MODE, "Fire"), ValueSet("Door1", MODE, "OutOfOrder")])
    assert modes(burning) == {"Building1": Mode.FIRE, "Door1": Mode.OUT_OF_ORDER}
    assert hold_reason(modes(burning)) == "fire alarm in Building1"
    assert passages_out_of_order(modes(burning)) == ("Door1",)
    assert (takes_work("Door1", map, ontology), takes_work("Door1", burning, ontology)) == (True, False)
