"""Short chains of services that are found at once, and the steps that moves become."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.ontology.services import ServiceType
from somrs.planner.grounding.joins import TooLarge
from somrs.planner.grounding.relevance import Demand, demands
from somrs.planner.grounding.task import Task
from somrs.planner.model.operators import Operator, goal_operators
from somrs.planner.model.plan import Link, Step
from somrs.planner.model.world import World
from somrs.planner.search.matching import match
from somrs.planner.search.search import search
from somrs.planner.search.steps import build_plan
from tests.unit.planner.grounding.test_grounding import (
    GO_SERVICE,
    PUT_SERVICE,
    TAKE_SERVICE,
    format_action,
    ground_problem,
    make_world,
    service,
)

MARK = service("Mark", None, "marked(?T)", T="Thing")
WASH = service("Wash", None, "?T.Clean = TRUE", T="Thing")
LABEL = service("Label", "?T.Clean = TRUE", "marked(?T)", T="Thing")
WAY = "T1 on P1, R1 at P1, P2 near P1"


def costing(service: ServiceType, cost: int) -> ServiceType:
    return structs.replace(service, cost=str(cost))


def matched(goal: str, *services: ServiceType, facts: str = "", hurry: bool = False) -> list[str] | None:
    problem, world = make_world(goal, *services, facts=facts)
    world.hurry = hurry
    plan = match(structs.replace(problem, hurry=hurry), world, list(goal_operators(problem.goal, world.vocabulary)))
    return [str(step) for step in plan.steps] if plan is not None else None


@pytest.mark.parametrize(
    ("goal", "services", "facts", "expected"),
    [
        ("marked(T1)", (MARK,), "", ["Mark(T: T1)"]),
        ("marked(T1) AND marked(T2)", (MARK,), "", ["Mark(T: T1)", "Mark(T: T2)"]),
        ("marked(T1)", (WASH, LABEL), "", ["Wash(T: T1)", "Label(T: T1)"]),
        ("marked(T1)", (WASH, LABEL, MARK), "", ["Mark(T: T1)"]),
        ("T1 heldBy R1", (TAKE_SERVICE, GO_SERVICE), "T1 on P2, R1 at P1, P2 near P1", ["Go(To: P2) by R1", "Take(T: T1) by R1"]),
        ("T1 on P2", (PUT_SERVICE, TAKE_SERVICE, GO_SERVICE), WAY, ["Take(T: T1) by R1", "Go(To: P2) by R1", "Put(T: T1, P: P2) by R1"]),
        ("T1 on P2", (PUT_SERVICE, TAKE_SERVICE, GO_SERVICE), "T1 on P1, R1 at P2, P2 near P1", None),
        ("marked(P1)", (MARK,), "", None),
    ],
)
def test_chains_of_two_services_are_found(goal: str, services: tuple[ServiceType, ...], facts: str, expected: list[str] | None) -> None:
    assert matched(goal, *services, facts=facts) == expected


def test_of_chains_the_cheapest_is_taken_unless_there_is_a_hurry() -> None:
    services = costing(MARK, 5), costing(WASH, 1), costing(LABEL, 1)
    assert matched("marked(T1)", *services) == ["Wash(T: T1)", "Label(T: T1)"]
    assert matched("marked(T1)", *services, hurry=True) == ["Mark(T: T1)"]
    assert matched("marked(T1)", costing(MARK, 2), costing(WASH, 1), costing(LABEL, 1)) == ["Mark(T: T1)"]


def test_a_match_among_many_possibilities_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    assert matched("marked(T1)", WASH, LABEL) is None
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 2_000)
    monkeypatch.setattr("somrs.planner.search.matching.EFFORT", 0)
    assert matched("marked(T1)", WASH, LABEL) is None


def test_a_match_that_became_too_hard_is_the_last_one(monkeypatch: pytest.MonkeyPatch) -> None:
    depths = list[int]()

    def too_large(*_: object, depth: int, **__: object) -> None:
        depths.append(depth)
        raise TooLarge

    monkeypatch.setattr("somrs.planner.search.matching.demands", too_large)
    assert matched("marked(T1)", MARK) is None
    assert depths == [1]


def test_where_all_services_cost_the_same_longer_chains_are_not_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    depths = list[int]()

    def noted(goals: list[Operator], world: World, *, narrow: bool, depth: int) -> list[Demand]:
        assert narrow, "only what is likely is looked at"
        depths.append(depth)
        return demands(goals, world, narrow=narrow, depth=depth)

    monkeypatch.setattr("somrs.planner.search.matching.demands", noted)
    assert matched("marked(T1)", MARK, WASH, LABEL) == ["Mark(T: T1)"]
    assert depths == [1]
    assert matched("marked(T1)", costing(MARK, 2), WASH, LABEL, hurry=True) == ["Mark(T: T1)"]
    assert depths == [1, 1]
    assert matched("marked(T1)", costing(MARK, 2), WASH, LABEL) == ["Mark(T: T1)"]
    assert depths == [1, 1, 1, 2]


def steps_of(goal: str, *names: str) -> tuple[tuple[Step, ...], tuple[Link, ...]]:
    problem, world = make_world(goal, PUT_SERVICE, TAKE_SERVICE, GO_SERVICE, facts=WAY)
    task = Task(ground_problem((problem, world)))
    by_name = {format_action(move.action): move for move in task.moves}
    plan = build_plan(problem, [by_name[name] for name in names])
    return plan.steps, plan.links


TAKE_ACTION, GO_ACTION, PUT_ACTION = "Take T=T1 Provider=R1 P=P1", "Go To=P2 Provider=R1 From=P1", "Put T=T1 P=P2 Provider=R1"


def test_moves_become_steps_of_which_all_is_said() -> None:
    steps, links = steps_of("T1 on P2", TAKE_ACTION, GO_ACTION, PUT_ACTION)
    assert steps == (
        Step(
            id="step1",
            service_type="Take",
            inputs={"T": Name("T1")},
            effect=parse("T1 heldBy R1"),
            precondition=parse("T1 on P1 AND R1 at P1"),
            provider="R1",
        ),
        Step(
            id="step2",
            service_type="Go",
            inputs={"To": Name("P2")},
            effect=parse("R1 at P2"),
            precondition=parse("R1 at P1 AND P1 near P2"),
            provider="R1",
        ),
        Step(
            id="step3",
            service_type="Put",
            inputs={"T": Name("T1"), "P": Name("P2")},
            effect=parse("T1 on P2"),
            precondition=parse("T1 heldBy R1 AND R1 at P2"),
            provider="R1",
        ),
    )
    assert links == (
        Link("step1", "step2", "R1 at P1", is_protection=True),
        Link("step1", "step3", "T1 heldBy R1"),
        Link("step2", "step3", "R1 at P2"),
    )


def test_moves_that_cannot_be_done_are_no_plan() -> None:
    with pytest.raises(AssertionError, match=r"^Put was planned where T1 heldBy R1 AND R1 at P2 does not hold$"):
        steps_of("T1 on P2", TAKE_ACTION, PUT_ACTION)
    with pytest.raises(AssertionError, match=r"^after all steps T1 on P2 does not hold$"):
        steps_of("T1 on P2", TAKE_ACTION, GO_ACTION)


def test_what_an_effect_calculates_is_said_as_it_is_then() -> None:
    fill = service("Fill", None, "?T.Weight = ?T.Count + 1", T="Thing")
    problem, world = make_world("T1.Weight = 3 kg", fill, values={"T1": {"Count": 2.0}})
    task = Task(ground_problem((problem, world)))
    (step,) = build_plan(problem, [move for move in task.moves if move.length]).steps
    assert step == Step(id="step1", service_type="Fill", inputs={"T": Name("T1")}, effect=parse("T1.Weight = 3"))


def test_a_precondition_says_what_the_map_had_in_the_place_of_anything() -> None:
    problem, world = make_world("T1 on P2", service("Move", "?T on ?From", "?T on ?To", T="Thing", To="Place"), facts="T1 on P1")
    task = Task(ground_problem((problem, world)))
    (step,) = build_plan(problem, search(task) or ()).steps
    assert (str(step.precondition), str(step.effect)) == ("T1 on P1", "T1 on P2")


def test_a_step_comes_after_the_one_that_sets_what_it_calculates_with() -> None:
    count = service("Count", None, "?T.Count = 2", T="Thing")
    weigh = service("Weigh", None, "?T.Weight = ?T.Count + 1", T="Thing")
    problem, world = make_world("T1.Weight = 3 kg", count, weigh, values={"T1": {"Count": 7.0}})
    task = Task(ground_problem((problem, world)))
    moves = search(task)
    assert moves is not None
    plan = build_plan(problem, moves)
    assert [str(step) for step in plan.steps] == ["Count(T: T1)", "Weigh(T: T1)"]
    assert plan.links == (Link("step1", "step2", "T1.Count = 2"),)
