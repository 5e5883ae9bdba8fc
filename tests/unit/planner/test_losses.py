"""Why services are lost to a plan, in words."""

from __future__ import annotations

import pytest

from somrs.planner.losses import losses_text
from somrs.planner.model.problem import LostService
from tests.support.laboratory import TRANSFER


@pytest.mark.parametrize(
    ("losses", "text"),
    [
        ([("Robot1.Go", "Robot1 holds Jar1")], "Robot1.Go: Robot1 holds Jar1"),
        (
            [("Robot1.Go", "did not answer"), ("Robot2.Go", "is broken"), ("Robot3.Go", "did not answer")],
            "Robot1.Go and Robot3.Go: did not answer; Robot2.Go: is broken",
        ),
        (
            [("Robot1.Go", "Robot1 finds no path to Robot11"), ("Robot2.Go", "Robot2 finds no path to Robot11")],
            "Robot1.Go and Robot2.Go: each finds no path to Robot11",
        ),
        (
            [(f"Door{number}.OpenDoor", f"Door{number} opens and closes only itself") for number in range(1, 14)],
            "Door1.OpenDoor and Door2.OpenDoor and 11 more: each opens and closes only itself",
        ),
    ],
)
def test_services_that_say_the_same_of_themselves_are_named_together(losses: list[tuple[str, str]], text: str) -> None:
    assert losses_text([LostService(TRANSFER, *loss) for loss in losses]) == text
