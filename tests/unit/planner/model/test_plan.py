"""Abstract plans: which steps can be done when, and what they say of themselves."""

from __future__ import annotations

import re

import pytest
from msgspec import structs

from somrs.entish import Name, Number, Term
from somrs.entish.parse import parse
from somrs.ontology.services import ServiceKind
from somrs.planner.model.plan import Link, NoPlan, Plan, Step, linearisations


def make_step(id: str, provider: str | None = None, alike: tuple[str, ...] = ()) -> Step:
    return Step(id=id, service_type="Do", inputs={}, effect=parse("marked(A)"), provider=provider, alternative_providers=alike)


def make_plan(ids: str, *pairs: str) -> Plan:
    """Steps with a letter each, and links as in `ab`."""
    return Plan(tuple(map(make_step, ids)), tuple(Link(pair[0], pair[1], f"fact {pair[0]}") for pair in pairs))


DIAMOND = make_plan("abcd", "ab", "ac", "bd", "cd")


def ids(steps: tuple[Step, ...]) -> str:
    return "".join(step.id for step in steps)


@pytest.mark.parametrize(
    ("plan", "order"),
    [
        (make_plan(""), ""),
        (make_plan("cab"), "cab"),
        (make_plan("cab", "bc"), "abc"),
        (make_plan("dcba", "ab", "bc", "cd"), "abcd"),
        (make_plan("dbca", "ab", "ac", "bd", "cd"), "abcd"),
        (make_plan("badc", "ab", "ab"), "abdc"),
        (DIAMOND, "abcd"),
    ],
)
def test_steps_come_after_all_that_they_wait_for_and_otherwise_as_planned(plan: Plan, order: str) -> None:
    assert ids(plan.topological()) == order


def test_links_must_not_run_in_a_circle() -> None:
    with pytest.raises(ValueError, match=re.escape("the plan's links run in a circle among ['b', 'c', 'd']")):
        make_plan("abcd", "ab", "bc", "cb", "cd").topological()


@pytest.mark.parametrize(("completed_ids", "ready"), [("", "a"), ("a", "bc"), ("ab", "c"), ("abc", "d"), ("abcd", ""), ("b", "a")])
def test_the_steps_that_can_start(completed_ids: str, ready: str) -> None:
    assert ids(DIAMOND.ready(set(completed_ids))) == ready


def test_what_is_linked_to_a_step() -> None:
    assert DIAMOND.step("c") is DIAMOND.steps[2]
    assert [DIAMOND.predecessors(id) for id in "abcd"] == [(), ("a",), ("a",), ("b", "c")]
    assert [DIAMOND.successors(id) for id in "abcd"] == [("b", "c"), ("d",), ("d",), ()]
    assert [*DIAMOND.links_to("d")] == [Link("b", "d", "fact b"), Link("c", "d", "fact c")]
    assert [*DIAMOND.links_to("a")] == []
    twice = Plan((make_step("a"), make_step("b")), (Link("a", "b", "one"), Link("a", "b", "other")))
    assert (twice.predecessors("b"), twice.successors("a"), len(twice.links_to("b"))) == (("a",), ("b",), 2)


@pytest.mark.parametrize(
    ("plan", "orders"),
    [
        (make_plan(""), {""}),
        (make_plan("ab"), {"ab", "ba"}),
        (make_plan("ab", "ba"), {"ba"}),
        (make_plan("ab", "ab", "ba"), set()),
        (DIAMOND, {"abcd", "acbd"}),
    ],
)
def test_every_order_in_which_steps_can_be_done(plan: Plan, orders: set[str]) -> None:
    found_orders = [ids(order) for order in linearisations(plan)]
    assert set(found_orders) == orders
    assert len(found_orders) == len(orders)


def test_how_steps_and_plans_are_written() -> None:
    inputs: dict[str, Term] = {"Jar": Name("Jar1"), "Height": Number(2.0, "m")}
    put_step = Step(id="step1", service_type="Put", inputs=inputs, effect=parse("marked(A)"))
    assert str(put_step) == "Put(Jar: Jar1, Height: 2 m)"
    assert str(make_step("a")) == "Do()"
    assert str(make_step("a", "R1")) == "Do() by R1"
    assert str(make_step("a", "R1", ("R2", "R3"))) == "Do() by R1 or R2 or R3"
    assert str(Plan()) == "nothing to do"
    assert str(make_plan("abc", "ac", "bc")) == "a: Do()\nb: Do()\nc: Do() after a (fact a), b (fact b)"


def test_what_a_step_binds() -> None:
    assert make_step("a").bindings == {}
    put_step = Step(id="step1", service_type="Put", inputs={"Jar": Name("Jar1")}, effect=parse("marked(A)"), provider="R1")
    assert put_step.bindings == {"Jar": Name("Jar1"), "Provider": Name("R1")}


def test_the_reasons_are_the_explanation_if_there_are_no_others() -> None:
    assert NoPlan(explanation="a; b").reasons == ("a; b",)
    assert NoPlan(explanation="a; b", separate_reasons=("a", "b")).reasons == ("a", "b")


def test_what_is_not_said_is_nothing() -> None:
    assert structs.astuple(NoPlan(explanation="a")) == ("a", (), (), (), False, (), (), ())
    assert structs.astuple(Link("a", "b", "fact")) == ("a", "b", "fact", False)
    assert structs.astuple(make_step("a"))[4:] == (None, None, None, (), ServiceKind.PHYSICAL, None, (), None, ())
