"""What has to be restored when a step is to be undone."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.objects import ValueSet
from somrs.planner.model.plan import Step
from somrs.task_manager.execution.execution_log import undone
from tests.unit.planner.test_planning import MAP, laboratory

NOW = MAP.changed([ValueSet("DoorAB", "Open", False), ValueSet("Jar001", "Weight", 0.3)])


@pytest.mark.parametrize(
    ("effect", "restored"),
    [
        ("Jar001 isOn Shelf2", "Jar001 isOn Shelf1"),
        ("Jar001 isOn Shelf1", "Jar001 isOn Shelf1"),  # it is so already, and may be left otherwise
        ("DoorAB.Open = TRUE", "DoorAB.Open = FALSE"),
        ("Jar001.Weight = 500 g", "Jar001.Weight = 0.3 kg"),
        ("Jar001.Color = Red", None),  # it had none
        ("Jar001 isOn Shelf2 AND DoorAB.Open = TRUE", "Jar001 isOn Shelf1 AND DoorAB.Open = FALSE"),
        ("connects(DoorAB, RoomA, RoomA)", "NOT connects(DoorAB, RoomA, RoomA)"),
        ("Nothing isOn Shelf1", None),  # it does not fit the map any more
    ],
)
def test_what_is_restored(effect: str, restored: str | None) -> None:
    step = Step(id="s1", service_type="Any", inputs={}, effect=parse(effect))
    found = undone(step, NOW, laboratory())
    assert (str(found) if found is not None else None) == restored
