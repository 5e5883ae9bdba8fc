"""Abstract plans: which steps can be done when, and what they say of themselves."""

from __future__ import annotations

import re

import pytest
from msgspec import structs

from somrs.entish import Name, Number, Term
from somrs.entish.parse import parse
from somrs.planner.model.plan import Link, NoPlan, Plan, Step, linearisations


def step(id: str, provider: str | None = None, alike: tuple[str, ...] = ()) -> Step:
    return Step(id=id, service_type="Do", inputs={}, effect=parse("marked(A)"), provider=provider, alternative_providers=alike)


def plan(ids: str, *pairs: str) -> Plan:
    """Steps with a letter each, and links as in `ab`."""
    return Plan(tuple(map(step, ids)), tuple(Link(pair[0], pair[1], f"fact {pair[0]}") for pair in pairs))


DIAMOND = plan("abcd", "ab", "ac", "bd", "cd")


def ids(steps: tuple[Step, ...]) -> str:
    return "".join(one.id for one in steps)


@pytest.mark.parametrize(
    ("asked", "order"),
    [
        (plan(""), ""),
        (plan("cab"), "cab"),
        (plan("cab", "bc"), "abc"),
        (plan("dcba", "ab", "bc", "cd"), "abcd"),
        (plan("dbca", "ab", "ac", "bd", "cd"), "abcd"),
        (plan("badc", "ab", "ab"), "abdc"),
        (DIAMOND, "abcd"),
    ],
)
def test_steps_come_after_all_that_they_wait_for_and_otherwise_as_planned(asked: Plan, order: str) -> None:
    assert ids(asked.topological()) == order


def test_links_must_not_run_in_a_circle() -> None:
    with pytest.raises(ValueError, match=re.escape("the plan's links run in a circle among ['b', 'c', 'd']")):
        plan("abcd", "ab", "bc", "cb", "cd").topological()


@pytest.mark.parametrize(("done", "ready"), [("", "a"), ("a", "bc"), ("ab", "c"), ("abc", "d"), ("abcd", ""), ("b", "a")])
def test_the_steps_that_can_start(done: str, ready: str) -> None:
    assert ids(DIAMOND.ready(set(done))) == ready


def test_what_is_linked_to_a_step() -> None:
    assert DIAMOND.step("c") is DIAMOND.steps[2]
    assert [DIAMOND.predecessors(id) for id in "abcd"] == [(), ("a",), ("a",), ("b", "c")]
    assert [DIAMOND.successors(id) for id in "abcd"] == [("b", "c"), ("d",), ("d",), ()]
    assert [*DIAMOND.links_to("d")] == [Link("b", "d", "fact b"), Link("c", "d", "fact c")]
    assert [*DIAMOND.links_to("a")] == []
    twice = Plan((step("a"), step("b")), (Link("a", "b", "one"), Link("a", "b", "other")))
    assert (twice.predecessors("b"), twice.successors("a"), len(twice.links_to("b"))) == (("a",), ("b",), 2)


@pytest.mark.parametrize(
    ("asked", "orders"),
    [
        (plan(""), {""}),
        (plan("ab"), {"ab", "ba"}),
        (plan("ab", "ba"), {"ba"}),
        (plan("ab", "ab", "ba"), set()),
        (DIAMOND, {"abcd", "acbd"}),
    ],
)
def test_every_order_in_which_steps_can_be_done(asked: Plan, orders: set[str]) -> None:
    found = [ids(order) for order in linearisations(asked)]
    assert set(found) == orders
    assert len(found) == len(orders)


def test_how_steps_and_plans_are_written() -> None:
    inputs: dict[str, Term] = {"Jar": Name("Jar1"), "Height": Number(2.0, "m")}
    put = Step(id="step1", service_type="Put", inputs=inputs, effect=parse("marked(A)"))
    assert str(put) == "Put(Jar: Jar1, Height: 2 m)"
    assert str(step("a")) == "Do()"
    assert str(step("a", "R1")) == "Do() by R1"
    assert str(step("a", "R1", ("R2", "R3"))) == "Do() by R1 or R2 or R3"
    assert str(Plan()) == "nothing to do"
    assert str(plan("abc", "ac", "bc")) == "a: Do()\nb: Do()\nc: Do() after a (fact a), b (fact b)"


def test_what_a_step_binds() -> None:
    assert step("a").bindings == {}
    put = Step(id="step1", service_type="Put", inputs={"Jar": Name("Jar1")}, effect=parse("marked(A)"), provider="R1")
    assert put.bindings == {"Jar": Name("Jar1"), "Provider": Name("R1")}


def test_the_reasons_are_the_explanation_if_there_are_no_others() -> None:
    assert NoPlan(explanation="a; b").reasons == ("a; b",)
    assert NoPlan(explanation="a; b", separate_reasons=("a", "b")).reasons == ("a", "b")


def test_what_is_not_said_is_nothing() -> None:
    assert structs.astuple(NoPlan(explanation="a")) == ("a", (), (), (), False, (), (), ())
    assert structs.astuple(Link("a", "b", "fact")) == ("a", "b", "fact", False)
    assert structs.astuple(step("a"))[4:] == (None, None, None, ())
