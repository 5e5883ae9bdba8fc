"""Diverse plans: further plans that use other service types."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.planner.alternatives import with_alternatives
from somrs.planner.grounding.task import Move, Task
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.planner.search.search import cheapest
from tests.support.laboratory import make_problem, names

GOAL = "Jar001 isOn Platform001"
CARRY = ServiceType(
    name="Carry",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="To", type="PhysicalObject")),
    precondition="?Object isOn ?From",
    effect="?Object isOn ?To",
)
THROW = structs.replace(CARRY, name="Throw")
LIFT = ServiceType(
    name="Lift",
    inputs=(Parameter(name="Object", type="Graspable"),),
    precondition="?Object isOn ?From",
    effect="?Object isHeldBy ?Provider",
)
LAY = ServiceType(
    name="Lay",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="To", type="PhysicalObject")),
    precondition="?Object isHeldBy ?Provider",
    effect="?Object isOn ?To",
)


def plans(*services: ServiceType, most_plans: int = 3) -> list[list[str]]:
    result = plan(structs.replace(make_problem(GOAL, *services), most_plans=most_plans))
    assert isinstance(result, Plan)
    return [sorted({step.service_type for step in each.steps}) for each in (result, *result.alternatives)]


def test_each_further_plan_uses_other_service_types() -> None:
    found = plans(CARRY, THROW, LIFT, LAY)
    assert sorted(found) == [["Carry"], ["Lay", "Lift"], ["Throw"]]


def test_there_are_no_more_than_wanted_and_none_unless_wanted() -> None:
    assert len(plans(CARRY, THROW, LIFT, LAY, most_plans=2)) == 2
    assert len(plans(CARRY, THROW, LIFT, LAY, most_plans=1)) == 1


def test_one_way_is_one_plan() -> None:
    assert plans(CARRY) == [["Carry"]]
    cognitive = ServiceType(name="See", kind=ServiceKind.COGNITIVE, inputs=CARRY.inputs, effect="?Object isOn ?To")
    assert plans(CARRY, cognitive) == [["Carry"]]


def test_further_plans_are_looked_for_only_briefly(monkeypatch: pytest.MonkeyPatch) -> None:
    efforts: list[int] = []

    def noted(task: Task, effort: int, longest: int | None = None) -> list[Move] | None:
        efforts.append(effort)
        return cheapest(task, effort, longest)

    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    monkeypatch.setattr("somrs.planner.planning.cheapest", noted)
    assert len(plans(CARRY, LIFT, LAY)) == 2
    assert all(effort <= efforts[0] / 10 for effort in efforts[1:])
    assert len(efforts) > 1


def test_further_plans_are_plans_for_the_same_problem() -> None:
    problem = structs.replace(make_problem(GOAL, CARRY, LIFT, LAY), most_plans=3)
    result = plan(problem)
    assert isinstance(result, Plan)
    [other] = result.alternatives
    assert len(names(other)) in (1, 2)
    assert other.topological()[-1].effect == result.topological()[-1].effect


def test_nobody_explains_why_there_is_no_further_plan() -> None:
    """An explanation takes seconds where many facts cannot be reached, and nobody would read it."""
    tried: list[Problem] = []

    def plan_again(problem: Problem) -> Plan | NoPlan:
        tried.append(problem)
        return plan(problem)

    problem = structs.replace(make_problem(GOAL, CARRY, LAY), most_plans=3)
    first = plan(structs.replace(problem, most_plans=1))
    assert isinstance(first, Plan)
    assert with_alternatives(problem, first, plan_again) == first
    assert [plan(without) for without in tried] == [NoPlan(explanation="")]
    assert plan(structs.replace(tried[0], explained=True)) != NoPlan(explanation="")
