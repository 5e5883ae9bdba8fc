"""Which of the procedures that were laid down fit a piece of work."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.replica import Replica
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.plan import Step
from somrs.task_manager.execution.execution_log import Work
from somrs.task_manager.recovery.handlers import fitting_handlers
from tests.unit.planner.test_planning import MAP, TRANSFER, laboratory

AWAY, BACK = "?Object isOn Platform001", "?Object isOn Shelf1"


def handler(effect: str = AWAY, when: str | None = None, service_type: str | None = None, on: Occasion = Occasion.FAILURE) -> Handler:
    return Handler(on=on, effect=effect, when=when, service_type=service_type)


@pytest.mark.parametrize(
    ("of_task", "of_type", "effects"),
    [
        ([], [], []),
        ([handler(AWAY), handler(BACK)], [handler("?Provider.Working = TRUE")], [AWAY, BACK, "?Provider.Working = TRUE"]),
        ([handler(service_type="TransferObject")], [], [AWAY]),
        ([handler(service_type="WashJar"), handler(BACK)], [], [BACK]),
        ([handler(on=Occasion.COMPENSATION), handler(BACK)], [], [BACK]),
        ([handler(when="?Object isOn Shelf1")], [], [AWAY]),
        ([handler(when="?Provider isInside ?Somewhere")], [], [AWAY]),
        ([handler(when="?Object isOn Shelf2"), handler(BACK)], [], [BACK]),
        ([handler(when="?Object isOn Gone"), handler(BACK)], [], [BACK]),
        ([handler("no formula"), handler(BACK)], [], [BACK]),
        ([], [handler(BACK, service_type="WashJar")], [BACK]),
    ],
)
def test_those_fit_that_are_for_the_step_and_the_situation(of_task: list[Handler], of_type: list[Handler], effects: list[str]) -> None:
    inputs = {"Object": Name("Jar001"), "Destination": Name("Shelf2")}
    work = Work(
        number=1,
        label="step1",
        key="1.1/step1",
        step=Step("step1", "TransferObject", {**inputs}, parse("Jar001 isOn Shelf2")),
        service_type=structs.replace(TRANSFER, handlers=tuple(of_type)),
        participant="p",
        service="Robot1.TransferObject",
        provider="Robot1",
        started_at=1.0,
    )
    found = fitting_handlers(of_task, work, Occasion.FAILURE, Replica("tm", "repository", laboratory(), MAP))
    bound = [effect.replace("?Object", "Jar001").replace("?Provider", "Robot1") for effect in effects]
    assert found == [Handler(on=Occasion.FAILURE, effect=effect) for effect in bound]
