"""The price and the duration of plans with foreseen steps."""

from __future__ import annotations

import pytest

from somrs.client.outlook_text import outlook_note, outlook_price
from somrs.entish.parse import parse
from somrs.ontology.services import ServiceKind
from somrs.planner.model.plan import Link, Plan, Step
from somrs.protocol.messages.previews import Outlook
from somrs.task_manager.outlook import foresee

TERMS = {"Open": [(1.0, 10.0), (3.0, 8.0)], "Carry": [(4.0, 20.0)], "Seal": [(2.0, 5.0)], "Paint": []}


def step(id: str, service_type: str, kind: ServiceKind = ServiceKind.PHYSICAL) -> Step:
    return Step(id, service_type, {}, parse("A isOn B"), kind=kind)


def plan(*foreseen: str, links: tuple[tuple[str, str], ...] = ()) -> Plan:
    """A look, and then these steps, which depend on it."""
    steps = [step("step1", "Look", ServiceKind.COGNITIVE), *(step(f"step{n}", name) for n, name in enumerate(foreseen, 2))]
    found = [Link("step1", other.id, "A isOn B") for other in steps[1:]]
    return Plan(tuple(steps), (*found, *(Link(before, after, "A isOn B") for before, after in links)))


def outlook(plan: Plan) -> Outlook | None:
    return foresee(plan, 1.0, 3.0, lambda step: TERMS[step.service_type])


def test_a_plan_that_is_certain_has_no_outlook() -> None:
    assert outlook(Plan((step("step1", "Carry"),), ())) is None


def test_foreseen_steps_cost_what_services_asked_last_one_after_another_and_side_by_side() -> None:
    assert outlook(plan("Open", "Carry", links=(("step2", "step3"),))) == Outlook(least_price=6, most_price=8, least_seconds=31)
    assert outlook(plan("Open", "Carry")) == Outlook(least_price=6, most_price=8, least_seconds=23)


def test_steps_without_known_terms_leave_the_price_open() -> None:
    assert outlook(plan("Paint", "Seal")) == Outlook(least_price=3, least_seconds=8, unknown=("step2",))


@pytest.mark.parametrize(
    ("outlook", "price", "note"),
    [
        (Outlook(least_price=3, most_price=8), "3 to 8 EUR", "the last terms of the services"),
        (Outlook(least_price=3, most_price=3), "about 3 EUR", "the last terms of the services"),
        (Outlook(least_price=3, unknown=("step2",)), "from 3 EUR", "without step 2, for which no terms are known yet"),
        (Outlook(least_price=3, unknown=("step2", "step4")), "from 3 EUR", "without steps 2, 4, for which"),
    ],
)
def test_outlooks_as_text(outlook: Outlook, price: str, note: str) -> None:
    assert outlook_price(outlook, "EUR") == price
    assert note in outlook_note(outlook)
