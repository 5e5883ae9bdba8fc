"""What is known of services' prices, of the map, and of what a task is as a problem for the planner."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.objects import ValueSet
from somrs.ontology.services import Handler, Occasion
from somrs.ontology.types import UNKNOWN, Value
from somrs.protocol.messages.clients import Policy, Submit
from somrs.protocol.messages.directory import Offer
from somrs.task_manager.context import Quotes, find_task_error, known_to_hold, planning_problem
from tests.unit.task_manager.transaction.test_participant_events import BEFORE, WISH, Desk


def offer(desk: Desk, provider: str, attributes: dict[str, Value]) -> Offer:
    return Offer(
        service=f"{provider}.TransferObject",
        provider=provider,
        provider_type="",
        address="",
        service_type=desk.offers[0].service_type,
        attributes=attributes,
    )


@pytest.mark.parametrize(
    ("attributes", "given", "last"),
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
    attributes: dict[str, Value], given: tuple[float, float] | None, last: tuple[float, float] | None
) -> None:
    quotes, one = Quotes(), offer(Desk(), "Robot1", attributes)
    if given is not None:
        quotes.record_quote(one.service, *given)
    assert quotes.last_quote(one) == last


@pytest.mark.parametrize(
    ("unknown", "formula", "known"),
    [
        (None, BEFORE, True),
        (None, WISH, False),
        (True, BEFORE, False),
        (False, BEFORE, True),
        (True, "Jar001 isOn Cupboard002", True),
        (None, "Gone isOn Cupboard001", False),
        (None, "Jar002.Weight > ?Weight", False),
    ],
)
def test_what_is_known_to_be_so(unknown: bool | None, formula: str, known: bool) -> None:
    desk = Desk()
    if unknown is not None:
        desk.replica.map = desk.replica.map.changed([ValueSet("Jar002", UNKNOWN, unknown)])
    assert known_to_hold(parse(formula), desk.replica) is known


def test_a_task_as_a_problem() -> None:
    desk = Desk()
    desk.replica.map = desk.replica.map.changed([ValueSet("Tin001", UNKNOWN, True)])
    offers = [offer(desk, "Robot2", {"Price": 5.0}), offer(desk, "Robot1", {}), offer(desk, "Robot3", {"Price": 6.0})]
    quotes = {"Robot3.TransferObject": 7.0}
    found = planning_problem(
        Submit(effect=WISH, precondition=BEFORE, policy=Policy.TIME), desk.replica, offers, frozenset({"Jar001"}), quotes
    )
    assert (str(found.goal), str(found.precondition), found.hurry) == (WISH, BEFORE, True)
    assert found.excluded == {"Jar001", "Tin001"}
    (available,) = found.services
    assert available.providers == ("Robot1", "Robot2", "Robot3")
    assert available.prices == (("Robot2", 5.0), ("Robot3", 7.0))
    assert available.service_type == desk.offers[0].service_type
    plain = planning_problem(Submit(effect=WISH), desk.replica, [])
    assert (plain.precondition, plain.hurry, plain.services, plain.excluded) == (None, False, (), frozenset({"Tin001"}))


@pytest.mark.parametrize(
    ("service_type", "when", "effect", "fits"),
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
def test_a_procedure_speaks_of_the_steps_that_it_is_for(service_type: str | None, when: str | None, effect: str, fits: bool) -> None:
    handler = Handler(on=Occasion.FAILURE, effect=effect, when=when, service_type=service_type)
    assert (find_task_error(Submit(effect=WISH, handlers=(handler,)), Desk().replica) is None) is fits
