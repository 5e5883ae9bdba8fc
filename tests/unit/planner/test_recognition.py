"""Which observations answer a question, and why there are none."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.planner.model.plan import NoPlan, Obstacle, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan, plan_quickly
from tests.support.laboratory import TRANSFER, names
from tests.unit.planner.test_kinds import FIND_JARS, LOOK, PICK_PLACE, SEE, WEIGH, problem


def asked(stated: Problem) -> list[str]:
    question = structs.replace(stated, recognises=True)
    result = plan(question)
    assert isinstance(result, Plan), result
    assert result == plan_quickly(question), "it needs no search"
    assert result.links == (), "observations need no order"
    assert result.certain_part == result
    return names(result)


def unanswered(stated: Problem) -> NoPlan:
    result = plan(structs.replace(stated, recognises=True))
    assert isinstance(result, NoPlan), result
    return result


def test_what_a_place_holds_is_asked_of_a_service_that_finds_things_there() -> None:
    assert asked(problem("?It: Jar isOn Shelf1", LOOK, SEE, FIND_JARS, TRANSFER)) == ["FindJars(Place: Shelf1)"]


def test_otherwise_the_objects_are_looked_at_that_may_be_an_answer() -> None:
    stated = problem("?It: Jar isOn Shelf1", LOOK, TRANSFER)
    assert asked(stated) == ["RecognizeSituation(Object: Jar001)", "RecognizeSituation(Object: Jar002)"]
    elsewhere = problem("?It: Jar isOn Shelf2", LOOK, unknown="Jar002")
    assert asked(elsewhere) == ["RecognizeSituation(Object: Jar002)"], "it may be there"


def test_a_named_object_is_looked_at() -> None:
    assert asked(problem("Jar001 isOn ?Where", LOOK, FIND_JARS)) == ["RecognizeSituation(Object: Jar001)"]
    assert asked(problem("NOT Jar001 isOn Shelf1", LOOK)) == ["RecognizeSituation(Object: Jar001)"]
    assert asked(problem("Jar001 isOn Shelf1", LOOK, SEE)) == ["SeeWhetherOn(Thing: Jar001, Place: Shelf1)"]


def test_all_parts_of_a_question_are_observed_each_once() -> None:
    goal = "Jar001 isOn Shelf1 AND Jar001.Color = Red OR FORALL ?It: Jar (NOT ?It isOn Platform001 AND Jar002 isOn Shelf1)"
    assert set(asked(problem(goal, LOOK))) == {"RecognizeSituation(Object: Jar001)", "RecognizeSituation(Object: Jar002)"}


def test_a_value_is_measured_by_a_device_that_can_do_so_now() -> None:
    weigh = structs.replace(WEIGH, precondition="?Object isOn Shelf1")
    assert asked(problem("Jar001.Weight = ?W", LOOK, weigh)) == ["Weigh(Object: Jar001)"]
    assert asked(problem("Jar001.Weight = ?W", LOOK, WEIGH)) == ["RecognizeSituation(Object: Jar001)"], "it does not stand on a scale"
    bound = structs.replace(WEIGH, precondition="?Object isOn ?Source AND ?Provider.Working = TRUE", name="WeighByHand")
    assert asked(problem("Jar001.Weight = ?W", bound)) == ["WeighByHand(Object: Jar001) by Robot1"]


def test_nothing_is_observed_twice_and_who_found_nothing_is_not_asked_again() -> None:
    stated = problem("?It: Jar isOn Shelf1", LOOK)
    first, second = asked(stated)
    assert asked(structs.replace(stated, observed=frozenset({first}))) == [second]
    assert asked(structs.replace(stated, observed=frozenset({first, second}))) == []
    fruitless = frozenset({("Robot1", first), ("Robot1", second)})
    assert unanswered(structs.replace(stated, fruitless=fruitless)).explanation == "?It: Jar isOn Shelf1: Robot1 looked, and found nothing"
    assert asked(structs.replace(stated, observed=frozenset({first}), fruitless=fruitless)) == []


@pytest.mark.parametrize(
    ("goal", "services", "text", "unoffered", "obstacle"),
    [
        (
            "Jar001 isOn Shelf1",
            (TRANSFER, PICK_PLACE),
            "nobody can look: no device offers RecognizeSituation or LookAt now",
            ("RecognizeSituation", "LookAt"),
            Obstacle.NOT_OFFERED,
        ),
        (
            "DoorAB isAdjacentTo RoomA",
            (SEE,),
            "nobody can look: no device offers RecognizeSituation now",
            ("RecognizeSituation",),
            Obstacle.NOT_OFFERED,
        ),
        ("?It: Jar isOn Shelf2", (LOOK,), "nobody can look now", ("LookAt",), Obstacle.NOT_OFFERED),
    ],
)
def test_it_is_said_why_nobody_looks(
    goal: str, services: tuple[object, ...], text: str, unoffered: tuple[str, ...], obstacle: Obstacle
) -> None:
    result = unanswered(problem(goal, *services))  # type: ignore[arg-type]  # service types
    assert result.explanation.startswith(f"{goal}: {text}")
    assert (result.unoffered, result.obstacles) == (unoffered, (obstacle,))
