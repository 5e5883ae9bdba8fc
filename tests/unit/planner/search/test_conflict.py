"""The smallest part of a goal that cannot come about, though each thing in it can."""

from __future__ import annotations

import pytest

from somrs.entish.formula import Literal, conjuncts
from somrs.entish.parse import parse
from somrs.ontology.services import ServiceType
from somrs.planner.search.conflict import Tries, find_minimal_conflict, find_torn_object, is_impossible
from tests.unit.planner.grounding.test_grounding import GO_SERVICE, PUT_SERVICE, TAKE_SERVICE, make_world, service

MARK = service("Mark", None, "marked(?T)", T="Thing")
BURN = service("Burn", "marked(R1)", "?T.Clean = TRUE AND NOT marked(R1)", T="Thing")
WEIGH = service("Weigh", None, "?T.Count = ?N AND marked(?T)", T="Thing", N="number")
LAY = service("Lay", None, "?T on ?P", T="Thing", P="Place")
CARRY = PUT_SERVICE, TAKE_SERVICE, GO_SERVICE
WAY = "T1 on P1, R1 at P1, P2 near P1"


def parts(goal: str) -> tuple[Literal, ...]:
    return conjuncts(parse(goal))  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("goal", "services", "facts", "certain"),
    [
        ("T1 on P2", CARRY, WAY, False),
        ("T1 on P2 AND R1 at P1", CARRY, WAY, False),
        ("T1 on P2", CARRY, "T1 on P1, R1 at P1", True),
        ("T1 on P2 AND T1 on P1", CARRY, WAY, True),
        ("T1.Clean = TRUE", (BURN,), "marked R1", False),
        ("T1.Clean = TRUE AND T2.Clean = TRUE", (BURN,), "marked R1", True),
        ("marked(T1)", (WEIGH,), "", False),
        ("marked(T1)", (), "", True),
        ("marked(T1)", (), "marked T1", False),
        ("NOT T1.Level = T2.Level", (service("Fill", None, "?T.Level = 1 m", T="Thing"),), "", False),
    ],
)
def test_what_is_certain_not_to_come_about(goal: str, services: tuple[ServiceType, ...], facts: str, certain: bool) -> None:
    _, world = make_world(goal, *services, facts=facts)
    assert is_impossible(parts(goal), world, Tries()) is certain


@pytest.mark.parametrize("limit", ["EFFORT", "FACTS"])
def test_what_takes_too_long_is_not_certain(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    goal = "T1.Clean = TRUE AND T2.Clean = TRUE"
    _, world = make_world(goal, BURN, facts="marked R1")
    assert is_impossible(parts(goal), world, Tries())
    monkeypatch.setattr(f"somrs.planner.search.conflict.{limit}", 0)
    assert not is_impossible(parts(goal), world, Tries())


@pytest.mark.parametrize(
    ("goal", "conflict"),
    [
        ("T1 on P1 AND T1 on P2", "T1 on P1 AND T1 on P2"),
        ("T1 on P1 AND T1 on P2 AND marked(T1)", "T1 on P1 AND T1 on P2"),
        ("marked(T1) AND T1 on P1 AND T2 on P1 AND T1 on P2", "T1 on P1 AND T1 on P2"),
        ("T1 on P1 AND marked(T1) AND marked(T2) AND marked(C1) AND C1 on P1 AND T2 on P2 AND T1 on P2", "T1 on P1 AND T1 on P2"),
        ("marked(T1) AND marked(P1) AND T1 on P1", "marked(P1)"),
        ("T1 on P1 AND T1 on P2 AND T2 on P1 AND T2 on P2", "T2 on P1 AND T2 on P2"),
        ("marked(P1)", "marked(P1)"),
    ],
)
def test_of_parts_as_few_are_left_as_are_impossible_together(goal: str, conflict: str) -> None:
    _, world = make_world(goal, LAY, MARK)
    assert find_minimal_conflict(parts(goal), world, Tries()) == parts(conflict)


def test_after_so_many_attempts_what_is_left_is_made_no_smaller() -> None:
    goal = "marked(T1) AND T1 on P1 AND T2 on P1 AND T1 on P2"
    _, world = make_world(goal, LAY, MARK)
    conflict_sizes = []
    for attempts in range(7):
        conflict_sizes.append(len(find_minimal_conflict(parts(goal), world, Tries(attempts))))
    assert conflict_sizes == [4, 4, 4, 3, 3, 2, 2]


@pytest.mark.parametrize(
    ("goal", "thing"),
    [
        ("T1 on P1 AND T1 on P2", "T1"),
        ("T1 on P1 AND T1 heldBy R1", "T1"),
        ("T1 on P1 AND T2 on P2 AND T2 heldBy R1", "T2"),
        ("T1 on P1 AND T2 on P1", None),
        ("T1 on P1 AND R1 at P1", None),
        ("?X on P1 AND ?X on P2", None),
        ("?X on P1 AND T1 on P1 AND T1 on P2", "T1"),
        ("T1 likes P1 AND T1 likes P2", None),
        ("T1 follows P1 AND T1 follows P2", None),
        ("NOT T1 on P1 AND NOT T1 on P2", None),
        ("NOT T1 on P1 AND T1 on P2 AND T1 on P1", "T1"),
        ("R1 at P1 AND R1 at P2", "R1"),
    ],
)
def test_what_would_be_in_two_places(goal: str, thing: str | None) -> None:
    _, world = make_world(goal, *CARRY, service("Like", None, "?T likes ?P", T="Thing", P="Place"))
    assert find_torn_object(parts(goal), world) == thing
