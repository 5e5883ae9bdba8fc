"""Who can be asked for a step, and whose terms are taken."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.entish import Name, Term
from somrs.entish.parse import parse
from somrs.kernel.offers import Offers
from somrs.ontology.services import ServiceType
from somrs.planner.model.plan import Step
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import Terms
from somrs.protocol.messages.submission import Policy, Submit
from somrs.task_manager.execution.bids import (
    Bid,
    able_offers,
    choose_bid,
    fit_bid,
    make_bid,
    precondition_now,
    relevant_situation,
)
from tests.support.laboratory import MAP, TRANSFER, laboratory

TYPES = {
    "Work": ServiceType(name="Work", effect=""),
    "FineWork": ServiceType(name="FineWork", effect="", parent="Work"),
    "FinestWork": ServiceType(name="FinestWork", effect="", parent="FineWork"),
    "Round": ServiceType(name="Round", effect="", parent="Circle"),
    "Circle": ServiceType(name="Circle", effect="", parent="Round"),
    "Lost": ServiceType(name="Lost", effect="", parent="Unknown"),
}


def offered(participant: str, price: float, start: float, finish: float) -> Bid:
    terms = Terms(effect="", price=price, duration=finish - start)
    return Bid(participant=participant, terms=terms, terms_id="", start=start, finish=finish)


@pytest.mark.parametrize(("start_from", "start"), [(None, 5.0), (3.0, 5.0), (8.0, 8.0), (0.0, 5.0)])
def test_a_bid_starts_when_the_step_can_and_the_service_is_free(start_from: float | None, start: float) -> None:
    terms = Terms(effect="", price=1.0, duration=10.0, start_from=start_from)
    assert make_bid("who", terms, "id", 5.0) == Bid(participant="who", terms=terms, terms_id="id", start=start, finish=start + 10.0)


@pytest.mark.parametrize(
    ("busy", "start"),
    [
        ([], 10.0),
        ([(0.0, 10.0)], 10.0),
        ([(20.0, 30.0)], 10.0),
        ([(19.0, 30.0)], 30.0),
        ([(0.0, 11.0)], 11.0),
        ([(20.0, 30.0), (5.0, 15.0)], 30.0),
        ([(25.0, 30.0), (5.0, 15.0)], 15.0),
    ],
)
def test_a_bid_begins_after_what_its_device_is_committed_to(busy: list[tuple[float, float]], start: float) -> None:
    fitted_bid = fit_bid(offered("who", 1.0, 10.0, 20.0), busy)
    assert (fitted_bid.start, fitted_bid.finish, fitted_bid.participant) == (start, start + 10.0, "who")


@pytest.mark.parametrize(
    ("policy", "value", "bids", "chosen"),
    [
        (Policy.PRICE, 0.0, [("a", 2, 5), ("b", 1, 9)], "b"),
        (Policy.PRICE, 0.0, [("a", 1, 9), ("b", 1, 5)], "b"),
        (Policy.PRICE, 0.0, [("b", 1, 5), ("a", 1, 5)], "a"),
        (Policy.TIME, 0.0, [("a", 2, 5), ("b", 1, 9)], "a"),
        (Policy.TIME, 0.0, [("a", 2, 5), ("b", 1, 5)], "b"),
        (Policy.TIME, 0.0, [("b", 1, 5), ("a", 1, 5)], "a"),
        (Policy.WEIGHTED, 1.0, [("a", 2, 5), ("b", 1, 9)], "a"),
        (Policy.WEIGHTED, 0.1, [("a", 2, 5), ("b", 1, 9)], "b"),
        (Policy.WEIGHTED, 0.25, [("a", 1, 9), ("b", 2, 5)], "b"),
        (Policy.WEIGHTED, 1.0, [("b", 1, 5), ("a", 1, 5)], "a"),
    ],
)
def test_the_policy_prefers(policy: Policy, value: float, bids: list[tuple[str, float, float]], chosen: str) -> None:
    candidates = [offered(participant, price, 0.0, finish) for participant, price, finish in bids]
    assert choose_bid(candidates, Submit(effect="", policy=policy, time_value=value), 3.0).participant == chosen


@pytest.mark.parametrize(("policy", "attempts", "chosen"), [("price", 2, "a"), ("price", 4, "b"), ("time", 1, "a"), ("time", 2, "b")])
def test_each_expected_attempt_costs_its_price_and_time(policy: str, attempts: int, chosen: str) -> None:
    cheap, dear = offered("a", 1.0, 3.0, 13.0), offered("b", 3.0, 3.0, 18.0)
    assert (
        choose_bid([structs.replace(cheap, attempts=attempts), dear], Submit(effect="", policy=Policy(policy)), 3.0).participant == chosen
    )


def offer(service_type: str, provider: str = "Robot1") -> Offer:
    return Offer(service=f"{provider}.{service_type}", provider=provider, provider_type="", address="", service_type=TYPES[service_type])


@pytest.mark.parametrize(
    ("service_type", "provider", "alike", "excluded", "services"),
    [
        ("Work", None, (), (), ["Robot1.FinestWork", "Robot1.Work", "Robot2.Work"]),
        ("FineWork", None, (), (), ["Robot1.FinestWork"]),
        ("Work", "Robot2", (), (), ["Robot2.Work"]),
        ("Work", "Robot3", ("Robot1",), (), ["Robot1.FinestWork", "Robot1.Work"]),
        ("Work", None, (), ("Robot1.Work",), ["Robot1.FinestWork", "Robot2.Work"]),
        ("Lost", None, (), (), ["Robot1.Lost"]),
        ("Unknown", None, (), (), ["Robot1.Lost"]),
        ("Round", None, (), (), ["Robot1.Circle"]),
    ],
)
def test_who_can_be_asked(
    service_type: str, provider: str | None, alike: tuple[str, ...], excluded: tuple[str, ...], services: list[str]
) -> None:
    offers = [offer("Work"), offer("Work", "Robot2"), offer("FinestWork"), offer("Lost"), offer("Circle")]
    step = Step("step1", service_type, {}, parse("Jar001.Clean = TRUE"), provider=provider, alternative_providers=alike)
    assert [able_offer.service for able_offer in able_offers(step, Offers(offers), TYPES, excluded)] == services


JAR: dict[str, Term] = {"Object": Name("Jar001"), "Destination": Name("Shelf2")}
STEP = Step("step1", "TransferObject", JAR, parse("Jar001 isOn Shelf2"))


def test_a_precondition_is_as_the_map_makes_it_true_now() -> None:
    assert str(precondition_now(STEP, TRANSFER, MAP, laboratory())) == "Jar001 isOn Shelf1"
    assert precondition_now(STEP, ServiceType(name="Work", effect=""), MAP, laboratory()) is None


@pytest.mark.parametrize(
    ("precondition", "reason"), [("?Object isOn Shelf2", "Jar001 isOn Shelf2 does not hold"), ("?Object isOn Nothing", "Nothing")]
)
def test_a_precondition_that_cannot_hold_is_an_error(precondition: str, reason: str) -> None:
    with pytest.raises(LookupError, match=reason):
        precondition_now(STEP, ServiceType(name="Work", effect="", precondition=precondition), MAP, laboratory())


@pytest.mark.parametrize(
    ("situation", "expected_text"),
    [
        (None, None),
        ("Jar001 isOn Shelf1", "Jar001 isOn Shelf1"),
        ("Jar001 isOn Shelf1 AND Jar002 isOn Shelf1 AND Robot1 isInside RoomA", "Jar001 isOn Shelf1"),
        ("Jar001 isOn Shelf2", None),
        ("Jar002 isOn Shelf1", None),
    ],
)
def test_of_a_situation_that_is_told_which_concerns_the_step_and_is_still_so(situation: str | None, expected_text: str | None) -> None:
    relevant_part = relevant_situation(STEP, parse(situation) if situation is not None else None, MAP, laboratory())
    assert (str(relevant_part) if relevant_part is not None else None) == expected_text


def test_what_takes_too_much_work_to_find_out_is_no_part_of_a_situation() -> None:
    pairs = " AND ".join(f"?A{number}.PositionX <= ?B{number}.PositionX" for number in range(9))
    heavy = "".join(f"FORALL ?A{number} (EXISTS ?B{number} (" for number in range(9)) + f"{pairs} AND Jar001.PositionX >= 0" + "))" * 9
    assert relevant_situation(STEP, parse(heavy), MAP, laboratory()) is None
