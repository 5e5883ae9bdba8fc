"""Of several plans the cheaper one is taken, or the one that is done sooner: by what services cost, and what they asked last."""

from __future__ import annotations

import pytest
from msgspec import structs
from msgspec.structs import replace

from somrs.entish.parse import parse
from somrs.ontology.files.loading import load_text
from somrs.ontology.services import ServiceType
from somrs.planner.model.plan import Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.quality import best, cost, makespan
from somrs.planner.planning import plan
from somrs.protocol.messages.submission import Policy
from tests.support.virtual_system import SITE, Robot, VirtualSystem

FERRY = ServiceType(name="Ferry", effect="Jar002 isOn Platform001", precondition="Jar002 isOn Cupboard001")
FIRST = ServiceType(name="FirstLeg", effect="Jar002 isOn Cupboard002", precondition="Jar002 isOn Cupboard001")
SECOND = ServiceType(name="SecondLeg", effect="Jar002 isOn Platform001", precondition="Jar002 isOn Cupboard002")
WAYS = (FERRY, FIRST, SECOND)
"""The jar comes to the platform at once, or by way of the other cupboard."""


def make_problem(services: tuple[AvailableService, ...]) -> Problem:
    loaded = load_text(SITE, "site.yaml")
    assert loaded.map is not None
    return Problem(ontology=loaded.ontology, map=loaded.map, goal=parse("Jar002 isOn Platform001"), services=services)


def quoted(**prices: float) -> Problem:
    """What the services asked last, those that were asked."""
    return make_problem(
        tuple(
            AvailableService(service_type, ("Robot1",), (("Robot1", prices[service_type.name]),) if service_type.name in prices else ())
            for service_type in WAYS
        )
    )


def find_plan(problem: Problem) -> Plan:
    answer = plan(problem)
    assert isinstance(answer, Plan), answer
    return answer


def ways(plan: Plan) -> list[str]:
    return [step.service_type for step in plan.steps]


@pytest.mark.parametrize(
    ("prices", "way"),
    [
        ({}, ["Ferry"]),
        ({"Ferry": 4.0, "FirstLeg": 2.0, "SecondLeg": 3.0}, ["Ferry"]),
        ({"Ferry": 10.0, "FirstLeg": 2.0, "SecondLeg": 3.0}, ["FirstLeg", "SecondLeg"]),
    ],
)
def test_what_services_asked_last_decides(prices: dict[str, float], way: list[str]) -> None:
    assert ways(find_plan(quoted(**prices))) == way


def test_what_a_service_type_says_that_it_costs_decides() -> None:
    costs = {"Ferry": "10", "FirstLeg": "2", "SecondLeg": "3"}
    problem = make_problem(
        tuple(AvailableService(structs.replace(service_type, cost=costs[service_type.name]), ("Robot1",)) for service_type in WAYS)
    )
    assert ways(find_plan(problem)) == ["FirstLeg", "SecondLeg"]
    assert cost(find_plan(problem), problem) == 5.0


def test_who_is_in_a_hurry_takes_the_short_way() -> None:
    problem = replace(quoted(Ferry=10.0, FirstLeg=2.0, SecondLeg=3.0), hurry=True)
    assert ways(find_plan(problem)) == ["Ferry"]


def test_the_best_is_by_cost_or_by_time() -> None:
    problem = quoted(Ferry=10.0, FirstLeg=2.0, SecondLeg=3.0)
    dear, cheap = find_plan(replace(problem, hurry=True)), find_plan(problem)
    assert (cost(dear, problem), makespan(dear), cost(cheap, problem), makespan(cheap)) == (10.0, 1, 5.0, 2)
    assert best(problem, [dear, cheap]) is cheap
    assert best(replace(problem, hurry=True), [cheap, dear]) is dear


def test_a_task_manager_plans_by_the_terms_that_it_had() -> None:
    system = VirtualSystem(Robot("Robot1", 10.0, 5.0))
    system.finish(system.submit("Jar002 isOn Platform001"))
    system.finish(system.submit("Tin001 isOn Platform001", policy=Policy.TIME))
    assert [dict(problem.services[0].prices) for problem in system.problems] == [{}, {"Robot1": 10.0}]
    assert [problem.hurry for problem in system.problems] == [False, True]
