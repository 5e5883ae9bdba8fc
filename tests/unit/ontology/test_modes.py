"""The modes of buildings, lifts and doors on a map."""

from __future__ import annotations

from somrs.ontology.files.loading import load_text
from somrs.ontology.modes import Mode, closed_passages, freed_devices, hold_reason, modes
from somrs.ontology.objects import ValueSet
from somrs.ontology.types import IN_SERVICE, MODE, WORKING
from somrs.ontology.values import takes_work
from tests.support.building import building

SHAPE = "Shape: {Form: Box, Width: 1, Depth: 0.1, Height: 2}"
LOADED = load_text(
    building("House", 4, 4, f"Door1: {{type: PoweredDoor, at: [1, 1, 0], {SHAPE}}}", f"Lift1: {{type: Lift, at: [3, 1, 0], {SHAPE}}}"),
    "house.yaml",
)


def test_everything_is_normal_unless_the_map_says_otherwise() -> None:
    map, ontology = LOADED.map, LOADED.ontology
    assert map is not None
    assert (modes(map), hold_reason(modes(map)), closed_passages(map, ontology)) == ({}, "", ())


def test_a_fire_holds_robots_and_a_door_out_of_order_does_not() -> None:
    map, ontology = LOADED.map, LOADED.ontology
    assert map is not None
    burning = map.changed([ValueSet("Building1", MODE, "Fire"), ValueSet("Door1", MODE, "OutOfOrder")])
    assert modes(burning) == {"Building1": Mode.FIRE, "Door1": Mode.OUT_OF_ORDER}
    assert hold_reason(modes(burning)) == "fire alarm in Building1"
    assert closed_passages(burning, ontology) == ("Door1",)
    assert (takes_work("Door1", map, ontology), takes_work("Door1", burning, ontology)) == (True, False)


def test_nobody_uses_a_lift_that_does_not_work_or_is_out_of_service_and_a_door_may_stand_open() -> None:
    map, ontology = LOADED.map, LOADED.ontology
    assert map is not None
    for path in (WORKING, IN_SERVICE):
        broken = map.changed([ValueSet("Lift1", path, False), ValueSet("Door1", path, False)])
        assert closed_passages(broken, ontology) == ("Lift1",)
        assert closed_passages(broken.changed([ValueSet("Lift1", path, True)]), ontology) == ()


def test_those_that_wait_for_a_lift_try_again_when_it_works_again() -> None:
    map, ontology = LOADED.map, LOADED.ontology
    assert map is not None
    assert freed_devices([ValueSet("Lift1", WORKING, True)], map, ontology) == {"Lift1"}
    assert freed_devices([ValueSet("Lift1", WORKING, None)], map, ontology) == {"Lift1"}
    assert not freed_devices([ValueSet("Lift1", WORKING, False)], map, ontology)
