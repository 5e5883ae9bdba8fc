"""Who may have what, who waits for whom, and what a plan needs to itself."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.types import RelationType
from somrs.planner.model.plan import Step
from somrs.protocol.messages.waits import Holder, WaitsForTasks
from somrs.task_manager.reservations import Reservation, Reservations, plan_reservation
from tests.support.laboratory import laboratory

ONTOLOGY = laboratory().extended([RelationType(name="isNextTo", joins=("Object", "Object"), symmetric=True)])


def make_reservation(changes: str = "", relies: str = "") -> Reservation:
    return Reservation(changes=frozenset(changes), relies_on=frozenset(relies))


@pytest.mark.parametrize(
    ("first", "second", "contested"),
    [
        (make_reservation("ab"), make_reservation("bc"), "b"),
        (make_reservation("ab"), make_reservation("", "bc"), "b"),
        (make_reservation("", "ab"), make_reservation("bc"), "b"),
        (make_reservation("", "ab"), make_reservation("", "bc"), ""),
        (make_reservation("a", "b"), make_reservation("b", "a"), "ab"),
        (make_reservation("a"), make_reservation("b"), ""),
    ],
)
def test_what_one_changes_the_other_neither_changes_nor_relies_on(first: Reservation, second: Reservation, contested: str) -> None:
    assert first.overlap(second) == frozenset(contested)
    assert second.overlap(first) == frozenset(contested)


def test_reservations_are_put_together() -> None:
    assert make_reservation("a", "b") | make_reservation("c", "d") == make_reservation("ac", "bd")


def test_the_objects_that_others_have_are_named_once_in_order() -> None:
    tasks = Reservations()
    tasks.add_task("one", "goal of one")
    tasks.hold("one", make_reservation("bc"))
    tasks.wait("two", make_reservation("ab"))
    holders = tasks.describe({"one": frozenset("cb"), "two": frozenset("ab")})
    assert holders == (
        Holder(task="one", goal="goal of one", objects=("b", "c")),
        Holder(task="two", goal="", objects=("a", "b"), waiting=True),
    )
    assert WaitsForTasks.on(holders) == WaitsForTasks(tasks={"one": "goal of one", "two": ""}, objects=("a", "b", "c"), holders=holders)


def test_a_more_urgent_task_comes_before_others_and_behind_its_equals() -> None:
    tasks = Reservations()
    for name, priority in (("a", 0), ("b", 1), ("c", 0), ("d", 1), ("e", -1), ("f", 0)):
        tasks.add_task(name, f"goal of {name}", priority)
    assert [*tasks.goals] == ["b", "d", "a", "c", "f", "e"]
    tasks.add_task("g", "")
    assert [*tasks.goals] == ["b", "d", "a", "c", "f", "g", "e"]


def test_a_task_is_met_by_those_that_have_something_and_those_that_wait_before_it() -> None:
    tasks = Reservations()
    for name in "abcd":
        tasks.add_task(name, "")
    tasks.hold("a", make_reservation("x", "y"))
    tasks.wait("b", make_reservation("z"))
    tasks.wait("d", make_reservation("w"))
    assert tasks.conflicts("c", make_reservation("wxyz")) == {"a": frozenset("xy"), "b": frozenset("z")}
    assert tasks.conflicts("a", make_reservation("xyz")) == {}, "whoever waits behind it, and itself, do not matter"
    assert tasks.conflicts("b", make_reservation("z")) == {}
    assert (tasks.reserved_objects("c"), tasks.reserved_objects("a"), tasks.reserved_objects("d")) == (
        frozenset("xz"),
        frozenset(),
        frozenset("xz"),
    )
    assert (
        tasks.holders("b", make_reservation("x")),
        tasks.holders("a", make_reservation("x")),
        tasks.holders("c", make_reservation("z")),
    ) == ((Holder(task="a", goal="", objects=("x",)),), (), ())


def test_what_a_task_holds_grows_and_is_given_up_when_it_waits() -> None:
    tasks = Reservations()
    tasks.add_task("a", "")
    tasks.wait("a", make_reservation("w"))
    tasks.hold("a", make_reservation("x"))
    tasks.hold("a", make_reservation("y", "z"))
    assert (tasks.held, tasks.waiting) == ({"a": make_reservation("xy", "z")}, {})
    tasks.wait("a", make_reservation("v"))
    assert (tasks.held, tasks.waiting["a"].reservation) == ({}, make_reservation("v"))


def test_whoever_waits_is_called_once_when_nobody_has_what_it_wants() -> None:
    tasks = Reservations()
    for name in "abc":
        tasks.add_task(name, "")
    tasks.hold("a", make_reservation("x"))
    tasks.wait("b", make_reservation("x"))
    tasks.wait("c", make_reservation("x"))
    assert [*tasks.admit_waiting()] == []
    tasks.remove_task("a")
    assert [*tasks.admit_waiting()] == ["b"], "the one behind it waits for it, now that it makes its plan"
    assert [*tasks.admit_waiting()] == []
    tasks.wait("c", make_reservation("y"))
    assert [*tasks.admit_waiting()] == ["c"]
    tasks.remove_task("c")
    assert [*tasks.admit_waiting()] == [], "nobody is called twice for the same"


def test_who_gives_up_waiting_lets_those_behind_it_go_on() -> None:
    tasks = Reservations()
    for name in "abc":
        tasks.add_task(name, "")
    tasks.hold("a", make_reservation("x"))
    tasks.wait("b", make_reservation("xy"))
    tasks.wait("c", make_reservation("y"))
    assert [*tasks.admit_waiting()] == []
    tasks.stop_waiting("a")
    assert tasks.freed is False, "it did not wait"
    tasks.stop_waiting("b")
    assert [*tasks.admit_waiting()] == ["c"]


def test_who_waits_gives_up_what_it_had_so_that_others_are_called() -> None:
    tasks = Reservations()
    for name in "abc":
        tasks.add_task(name, "")
    tasks.hold("b", make_reservation("x"))
    tasks.wait("c", make_reservation("x"))
    tasks.hold("a", make_reservation("z"))
    assert [*tasks.admit_waiting()] == []
    tasks.wait("b", make_reservation("z"))
    assert [*tasks.admit_waiting()] == ["c"]


def test_between_two_that_are_called_anything_may_change() -> None:
    tasks = Reservations()
    for name in "abcd":
        tasks.add_task(name, "")
        tasks.wait(name, make_reservation(name))
    admitted = tasks.admit_waiting()
    assert next(admitted) == "a"
    tasks.remove_task("b")
    tasks.hold("a", make_reservation("c"))
    assert [*admitted] == ["d"]
    tasks.remove_task("a")
    assert [*tasks.admit_waiting()] == ["c"]


def test_of_a_task_that_is_over_nothing_is_left() -> None:
    tasks = Reservations()
    tasks.add_task("a", "goal", 2)
    tasks.hold("a", make_reservation("x"))
    assert tasks.freed is False
    tasks.remove_task("a")
    assert (tasks.goals, tasks.priorities, tasks.held, tasks.freed) == ({}, {}, {}, True)
    tasks.add_task("b", "goal")
    tasks.wait("b", make_reservation("x"))
    tasks.remove_task("b")
    tasks.remove_task("nobody")
    assert tasks.waiting == {}


@pytest.mark.parametrize(
    ("effect", "precondition", "goal", "expected"),
    [
        ("Jar001 isOn Shelf2", "Jar001 isOn Shelf1", "Jar001 isOn Shelf2", (["Jar001"], [])),
        ("NOT Jar001 isOn Shelf1", None, "Jar001.Clean = TRUE", (["Jar001"], [])),
        ("Jar001 isOn Shelf2", "Jar002.Clean = TRUE", "Jar001 isOn Shelf2", (["Jar001"], ["Jar002"])),
        ("Jar001 isOn Shelf2", "NOT Jar002 isOn Shelf1", "Jar001 isOn Shelf2", (["Jar001"], ["Jar002"])),
        ("Jar001.PositionX = Jar002.PositionX", None, "Jar001 isOn Shelf2", (["Jar001"], ["Jar002"])),
        ("5 = Jar001.PositionX", None, "Jar001 isOn Shelf2", (["Jar001"], [])),
        ("Jar001.PositionX = 5", "Jar002.PositionX > Shelf1.PositionX", "Jar001 isOn Shelf2", (["Jar001"], ["Jar002", "Shelf1"])),
        ("Jar001 isNextTo Jar002", None, "Jar001 isNextTo Jar002", (["Jar001", "Jar002"], [])),
        ("Jar001 isOn Shelf2", None, "Jar001 isOn Shelf2 AND Jar002 isOn Shelf1", (["Jar001"], ["Jar002"])),
        ("Jar001 isOn Shelf2", None, "Jar001 isOn Shelf2 OR Jar002 isOn Shelf1", (["Jar001"], [])),
        ("Jar001 isOn Shelf2", "distance(Jar002, Shelf1) < 5", "Jar001 isOn Shelf2", (["Jar001"], ["Jar002", "Shelf1"])),
    ],
)
def test_what_a_plan_needs_to_itself(effect: str, precondition: str | None, goal: str, expected: tuple[list[str], list[str]]) -> None:
    step = Step("step1", "Any", {}, parse(effect), parse(precondition) if precondition is not None else None)
    result = plan_reservation([step], parse(goal), ONTOLOGY)
    assert (sorted(result.changes), sorted(result.relies_on)) == expected
