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
from tests.support.laboratory import MAP, TRANSFER, laboratory

ON_PLATFORM, ON_SHELF = "?Object isOn Platform001", "?Object isOn Shelf1"


def handler(
    effect: str = ON_PLATFORM, condition: str | None = None, service_type: str | None = None, occasion: Occasion = Occasion.FAILURE
) -> Handler:
    return Handler(on=occasion, effect=effect, when=condition, service_type=service_type)


@pytest.mark.parametrize(
    ("of_task", "of_type", "effects"),
    [
        ([], [], []),
        (
            [handler(ON_PLATFORM), handler(ON_SHELF)],
            [handler("?Provider.Working = TRUE")],
            [ON_PLATFORM, ON_SHELF, "?Provider.Working = TRUE"],
        ),
        ([handler(service_type="TransferObject")], [], [ON_PLATFORM]),
        ([handler(service_type="WashJar"), handler(ON_SHELF)], [], [ON_SHELF]),
        ([handler(occasion=Occasion.COMPENSATION), handler(ON_SHELF)], [], [ON_SHELF]),
        ([handler(condition="?Object isOn Shelf1")], [], [ON_PLATFORM]),
        ([handler(condition="?Provider isInside ?Somewhere")], [], [ON_PLATFORM]),
        ([handler(condition="?Object isOn Shelf2"), handler(ON_SHELF)], [], [ON_SHELF]),
        ([handler(condition="?Object isOn Gone"), handler(ON_SHELF)], [], [ON_SHELF]),
        ([handler("no formula"), handler(ON_SHELF)], [], [ON_SHELF]),
        ([handler(condition="EXISTS ?Other: Jar (?Other isOn Shelf1)")], [], [ON_PLATFORM]),
        ([handler(condition="FORALL ?Object: Jar (?Object isOn Shelf2)"), handler(ON_SHELF)], [], [ON_SHELF]),
        ([handler("FORALL ?J: Jar (NOT ?J isOn Shelf2 OR ?Object = ?J)")], [], ["FORALL ?J: Jar (NOT ?J isOn Shelf2 OR ?Object = ?J)"]),
        ([], [handler(ON_SHELF, service_type="WashJar")], [ON_SHELF]),
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
    handlers = fitting_handlers(of_task, work, Occasion.FAILURE, Replica("tm", "repository", laboratory(), MAP))
    bound = [effect.replace("?Object", "Jar001").replace("?Provider", "Robot1") for effect in effects]
    assert handlers == [Handler(on=Occasion.FAILURE, effect=effect) for effect in bound]
