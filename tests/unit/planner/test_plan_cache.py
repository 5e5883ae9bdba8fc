"""A task that is stated again on the same facts is answered without planning; on other facts it is not."""

from __future__ import annotations

import pytest

from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ValueSet
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.plan_cache import SIZE, PlanCache
from somrs.planner.planning import plan
from tests.support.laboratory import DRIVE, MAP, OPEN, TRANSFER, laboratory, make_problem

ONTOLOGY = laboratory()


def changed_problem(goal: str, *changes: Change) -> Problem:
    stated = make_problem(goal, TRANSFER, DRIVE, OPEN, map=MAP.changed(changes))
    return Problem(ontology=ONTOLOGY, map=stated.map, goal=stated.goal, services=stated.services)


@pytest.mark.parametrize(
    "changes",
    [
        [],
        [ValueSet("Robot1", "PositionX", 7.0)],
        [FactAdded(Fact("isPartOf", ("RoomA", "RoomB")))],
    ],
)
def test_what_no_service_speaks_of_changes_no_plan(changes: list[Change]) -> None:
    memory, goal = PlanCache(), "Jar001 isOn Platform001"
    result = plan(changed_problem(goal))
    memory.store(changed_problem(goal), result)
    assert memory.recall(changed_problem(goal, *changes)) == result == plan(changed_problem(goal, *changes))


@pytest.mark.parametrize(
    "changes",
    [
        [FactRemoved(Fact("isOn", ("Jar001", "Shelf1"))), FactAdded(Fact("isOn", ("Jar001", "Shelf2")))],
        [FactRemoved(Fact("isOn", ("Jar001", "Shelf1"))), FactAdded(Fact("isHeldBy", ("Jar001", "Robot1")))],
        [ValueSet("DoorAB", "Open", False)],
        [ObjectAdded(Object(name="Shelf9", type="Shelf"))],
    ],
)
def test_other_facts_are_planned_for_anew(changes: list[Change]) -> None:
    memory, goal = PlanCache(), "Jar001 isOn Platform001"
    memory.store(changed_problem(goal), plan(changed_problem(goal)))
    assert memory.recall(changed_problem(goal, *changes)) is None


@pytest.mark.parametrize("path", ["PositionX", "PositionY", "PositionZ"])
def test_a_distance_depends_on_all_coordinates(path: str) -> None:
    memory, goal = PlanCache(), "distance(Jar001, Robot1) < 3"
    memory.store(changed_problem(goal), Plan())
    assert memory.recall(changed_problem(goal)) == Plan()
    assert memory.recall(changed_problem(goal, ValueSet("Jar001", path, 7.0))) is None


def test_another_task_or_other_services_are_another_question() -> None:
    memory, goal = PlanCache(), "Jar001 isOn Platform001"
    memory.store(changed_problem(goal), plan(changed_problem(goal)))
    assert memory.recall(changed_problem("Jar002 isOn Platform001")) is None
    fewer = Problem(ontology=ONTOLOGY, map=MAP, goal=changed_problem(goal).goal, services=changed_problem(goal).services[:1])
    assert memory.recall(fewer) is None


def test_that_nothing_was_found_in_time_is_not_remembered() -> None:
    memory, stated = PlanCache(), changed_problem("Jar001 isOn Platform001")
    memory.store(stated, NoPlan(explanation="no plan was found in 1 s, and no proof that there is none", undecided=True))
    assert memory.recall(stated) is None
    memory.store(stated, NoPlan(explanation="there is none"))
    assert isinstance(memory.recall(stated), NoPlan)


def test_the_oldest_answers_are_forgotten() -> None:
    memory = PlanCache()
    for number in range(SIZE + 1):
        memory.store(changed_problem(f"Jar001.PositionX = {number}"), Plan())
    assert memory.recall(changed_problem("Jar001.PositionX = 0")) is None
    assert memory.recall(changed_problem(f"Jar001.PositionX = {SIZE}")) == Plan()
