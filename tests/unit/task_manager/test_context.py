"""What is known of services' prices, of the map, and of what a task is as a problem for the planner."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.objects import ValueSet
from somrs.ontology.services import Handler, Occasion
from somrs.ontology.types import UNKNOWN, Value
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.submission import Policy, Submit
from somrs.task_manager.context import Quotes, find_task_error, known_to_hold, planning_problem
from tests.unit.task_manager.transaction.test_participant_events import GOAL, INITIAL_SITUATION, TaskManagerHarness


def offer(harness: TaskManagerHarness, provider: str, attributes: dict[str, Value]) -> Offer:
    return Offer(
        service=f"{provider}.TransferObject",
        provider=provider,
        provider_type="",
        address="",
        service_type=harness.offers[0].service_type,
        attributes=attributes,
    )


@pytest.mark.parametrize(
    ("attributes", "recorded", "expected"),
    [
        ({}, None, None),
        ({"Price": 3.0}, None, None),
        ({"Duration": 4.0}, None, None),
        ({"Price": 3, "Duration": 4}, None, (3.0, 4.0)),
        ({"Price": 3.0, "Duration": 4.0}, (1.0, 2.0), (1.0, 2.0)),
        ({}, (1.0, 2.0), (1.0, 2.0)),
        ({"Price": "much", "Duration": 4.0}, None, None),
    ],
)
def test_what_a_service_asked_last_or_says_that_it_always_asks(
    attributes: dict[str, Value], recorded: tuple[float, float] | None, expected: tuple[float, float] | None
) -> None:
    quotes, service_offer = Quotes(), offer(TaskManagerHarness(), "Robot1", attributes)
    if recorded is not None:
        quotes.record_quote(service_offer.service, *recorded)
    assert quotes.last_quote(service_offer) == expected


@pytest.mark.parametrize(
    ("unknown", "formula", "expected"),
    [
        (None, INITIAL_SITUATION, True),
        (None, GOAL, False),
        (True, INITIAL_SITUATION, False),
        (False, INITIAL_SITUATION, True),
        (True, "Jar001 isOn Cupboard002", True),
        (None, "Gone isOn Cupboard001", False),
        (None, "Jar002.Weight > ?Weight", False),
    ],
)
def test_what_is_known_to_be_so(unknown: bool | None, formula: str, expected: bool) -> None:
    harness = TaskManagerHarness()
    if unknown is not None:
        harness.replica.map = harness.replica.map.changed([ValueSet("Jar002", UNKNOWN, unknown)])
    assert known_to_hold(parse(formula), harness.replica) is expected


def test_a_task_as_a_problem() -> None:
    harness = TaskManagerHarness()
    harness.replica.map = harness.replica.map.changed([ValueSet("Tin001", UNKNOWN, True)])
    offers = [offer(harness, "Robot2", {"Price": 5.0}), offer(harness, "Robot1", {}), offer(harness, "Robot3", {"Price": 6.0})]
    quotes = {"Robot3.TransferObject": 7.0}
    result = planning_problem(
        Submit(effect=GOAL, precondition=INITIAL_SITUATION, policy=Policy.TIME), harness.replica, offers, frozenset({"Jar001"}), quotes
    )
    assert (str(result.goal), str(result.precondition), result.hurry) == (GOAL, INITIAL_SITUATION, True)
    assert result.excluded == {"Jar001", "Tin001"}
    (available,) = result.services
    assert available.providers == ("Robot1", "Robot2", "Robot3")
    assert available.prices == (("Robot2", 5.0), ("Robot3", 7.0))
    assert available.service_type == harness.offers[0].service_type
    plain = planning_problem(Submit(effect=GOAL), harness.replica, [])
    assert (plain.precondition, plain.hurry, plain.services, plain.excluded) == (None, False, (), frozenset({"Tin001"}))


@pytest.mark.parametrize(
    ("service_type", "condition", "effect", "fits"),
    [
        (None, None, "?Provider.Working = TRUE", True),
        (None, None, "?Object isOn Platform001", True),
        ("TransferObject", None, "?Object isOn Platform001", True),
        (None, None, "?Object.Working = TRUE", True),
        ("TransferObject", None, "?Object.Working = TRUE", False),
        ("TransferObject", "?Object isOn Nothing", "?Object isOn Platform001", False),
        ("TransferObjects", None, "Jar001 isOn Platform001", False),
    ],
)
def test_a_procedure_speaks_of_the_steps_that_it_is_for(service_type: str | None, condition: str | None, effect: str, fits: bool) -> None:
    handler = Handler(on=Occasion.FAILURE, effect=effect, when=condition, service_type=service_type)
    assert (find_task_error(Submit(effect=GOAL, handlers=(handler,)), TaskManagerHarness().replica) is None) is fits


def test_a_task_whose_goal_takes_too_much_work_is_refused() -> None:
    replica = TaskManagerHarness().replica
    pairs = " AND ".join(f"?A{number}.PositionX <= ?B{number}.PositionX" for number in range(8))
    goal = "".join(f"FORALL ?A{number} (EXISTS ?B{number} (" for number in range(8)) + pairs + "))" * 8
    refusal = find_task_error(Submit(effect=goal), replica)
    assert "steps" in str(refusal)
