"""What a plan needs to itself."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.types import RelationType
from somrs.planner.model.plan import Step
from somrs.task_manager.arrangement.plan_reservation import plan_reservation
from tests.support.laboratory import laboratory

ONTOLOGY = laboratory().extended([RelationType(name="isNextTo", joins=("Object", "Object"), symmetric=True)])


@pytest.mark.parametrize(
    ("effect", "precondition", "goal", "expected"),
    [
        ("Jar001 isOn Shelf2", "Jar001 isOn Shelf1", "Jar001 isOn Shelf2", (["Jar001"], [])),
        ("NOT Jar001 isOn Shelf1", None, "Jar001.Clean = TRUE", (["Jar001"], [])),
        ("Jar001 isOn Shelf2", "Jar002.Clean = TRUE", "Jar001 isOn Shelf2", (["Jar001"], ["Jar002"])),
        ("Jar001 isOn Shelf2", "NOT Jar002 isOn Shelf1", "Jar001 isOn Shelf2", (["Jar001"], ["Jar002"])),
        ("Jar001.PositionX = Jar002.PositionX", None, "Jar001 isOn Shelf2", (["Jar001"], ["Jar002"])),
        ("5 = Jar001.PositionX", None, "Jar001 isOn Shelf2", (["Jar001"], [])),
        ("Jar001.PositionX = 5", "Jar002.PositionX > Shelf1.PositionX", "Jar001 isOn Shelf2", (["Jar001"], ["Jar002", "Shelf1"])),
        ("Jar001 isNextTo Jar002", None, "Jar001 isNextTo Jar002", (["Jar001", "Jar002"], [])),
        ("Jar001 isOn Shelf2", None, "Jar001 isOn Shelf2 AND Jar002 isOn Shelf1", (["Jar001"], ["Jar002"])),
        ("Jar001 isOn Shelf2", None, "Jar001 isOn Shelf2 OR Jar002 isOn Shelf1", (["Jar001"], [])),
        ("Jar001 isOn Shelf2", "distance(Jar002, Shelf1) < 5", "Jar001 isOn Shelf2", (["Jar001"], ["Jar002", "Shelf1"])),
    ],
)
def test_what_a_plan_needs_to_itself(effect: str, precondition: str | None, goal: str, expected: tuple[list[str], list[str]]) -> None:
    step = Step("step1", "Any", {}, parse(effect), parse(precondition) if precondition is not None else None)
    result = plan_reservation([step], parse(goal), ONTOLOGY)
    assert (sorted(result.changes), sorted(result.relies_on)) == expected
