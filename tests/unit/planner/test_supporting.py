"""Things are put only on what can carry them, and what cannot carry them is said."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.entish.parse import parse
from somrs.ontology.files.loading import load_text
from somrs.ontology.objects import ValueSet
from somrs.planner.model.plan import NoPlan, Obstacle, Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.planning import plan

SITE = """
map: Workshop
types:
  Rack: {parent: Furniture}
  Bench: {parent: Obstacle}
  Cart: {parent: MobileRobot}
  Crate: {parent: Graspable}
objects:
  Workshop: {type: Building, parts: {Level: {type: Storey}}}
  Ground: {type: Floor, at: [0, 0, 0], Shape: {Form: Box, Width: 9, Depth: 9, Height: 0.1}}
  Rack1: {type: Rack, at: [1, 0, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}}
  Bench1: {type: Bench, at: [2, 0, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}}
  Cart1: {type: Cart, at: [5, 0]}
  Spot1: {type: Place, at: [6, 0]}
  Robot1: {type: MobileManipulator, at: [4, 0]}
  Jar1: {type: Jar, at: [1, 0, 1]}
  Crate1: {type: Crate, at: [1, 0.2, 1], Shape: {Form: Box, Width: 0.3, Depth: 0.3, Height: 0.3}}
facts: [Ground isPartOf Level, Jar1 isOn Rack1, Crate1 isOn Rack1]
"""


def problem(goal: str, *offered: str) -> Problem:
    loaded = load_text(SITE)
    assert loaded.map is not None
    services = tuple(AvailableService(loaded.ontology.services[name], ("Robot1",)) for name in offered)
    return Problem(ontology=loaded.ontology, map=loaded.map, goal=parse(goal), services=services)


@pytest.mark.parametrize("destination", ["Ground", "Cart1", "Spot1", "Crate1"])
def test_things_are_put_on_whatever_does_not_state_otherwise(destination: str) -> None:
    result = plan(problem(f"Jar1 isOn {destination}", "TransferObject"))
    assert isinstance(result, Plan)
    assert [str(step) for step in result.steps] == [f"TransferObject(Object: Jar1, Destination: {destination})"]


@pytest.mark.parametrize(("destination", "type"), [("Bench1", "Bench"), ("Robot1", "MobileManipulator"), ("Level", "Storey")])
@pytest.mark.parametrize("offered", [("TransferObject", "TakeOutOf"), ("TransferObject",), ()])
def test_what_carries_nothing_is_said_whoever_is_there(destination: str, type: str, offered: tuple[str, ...]) -> None:
    result = plan(problem(f"Jar1 isOn {destination}", *offered))
    assert isinstance(result, NoPlan)
    assert result.obstacles == (Obstacle.NO_SERVICE_TYPE,), "no device that comes would help"
    assert (result.unoffered, result.missing) == ((), (f"{destination}.Supporting = TRUE",))
    assert f"{destination}.Supporting = TRUE" in result.explanation
    assert f"it is FALSE, by default for a {type} (Supporting: whether things can be put on it)" in result.explanation


def test_what_the_object_itself_states_counts() -> None:
    stated = problem("Jar1 isOn Bench1", "TransferObject")
    stated = structs.replace(stated, map=stated.map.changed([ValueSet("Bench1", "Supporting", True)]))
    assert isinstance(plan(stated), Plan)


def test_a_place_is_cleared_onto_what_can_carry_things() -> None:
    result = plan(problem("NOT ?Anything isOn Rack1", "TransferObject"))
    assert isinstance(result, Plan)
    assert all(str(step.inputs["Destination"]) in ("Ground", "Cart1", "Spot1", "Crate1") for step in result.steps)
