"""Why there is no plan: the smallest part of the goal that cannot be, what is missing for it, or how far the search got."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.files.loading import upper
from somrs.ontology.objects import Fact, Map, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.plan import NoPlan, Obstacle
from somrs.planner.model.problem import Available, Problem
from somrs.planner.planning import plan, quick
from tests.integration.test_planner_engine import tower
from tests.unit.planner.test_planning import LABEL, TRANSFER, WASH, laboratory, problem

CELLAR: Ontology = upper().extended(
    [
        AttributeType(name="Lit", kind=Kind.TRUTH),
        ObjectType(name="Lamp", parent="PhysicalObject", attributes=("Lit",)),
        RelationType(name="hasMatch", joins=("Device",)),
    ]
)
STRIKE = ServiceType(
    name="LightLamp",
    inputs=(Parameter(name="Lamp", type="Lamp"),),
    precondition="hasMatch(?Provider)",
    effect="?Lamp.Lit = TRUE AND NOT hasMatch(?Provider)",
)
UNLOCK = ServiceType(
    name="OpenDoor",
    inputs=(Parameter(name="Door", type="Door"),),
    precondition="Lamp1.Lit = TRUE AND Lamp2.Lit = TRUE",
    effect="?Door.Open = TRUE",
)


def cellar(goal: str, matches: tuple[str, ...] = ("Robot1",), excluded: frozenset[str] = frozenset()) -> Problem:
    """Three lamps, two robots, and as many matches as robots are named."""
    objects = [Object(name=f"Lamp{n}", type="Lamp", values={"Lit": False}) for n in (1, 2, 3)]
    robots = [Object(name=f"Robot{n}", type="MobileRobot") for n in (1, 2)]
    map = Map(
        [*objects, *robots, Object(name="Door1", type="Door", values={"Open": False})], [Fact("hasMatch", (name,)) for name in matches]
    )
    offered = (Available(STRIKE, ("Robot1", "Robot2")), Available(UNLOCK, ("Robot1",)))
    return Problem(ontology=CELLAR, map=map, goal=parse(goal), services=offered, excluded=excluded)


def refused(asked: Problem) -> NoPlan:
    found = plan(asked)
    assert isinstance(found, NoPlan), found
    return found


def test_of_a_long_wish_the_two_parts_that_exclude_each_other_are_named() -> None:
    wish = "Jar002 isOn Platform001 AND Jar001 isOn Shelf2 AND Jar002.Clean = TRUE AND Jar001 isOn Platform001"
    found = refused(problem(wish, TRANSFER, WASH))
    assert set(found.unreachable) == {"Jar001 isOn Shelf2", "Jar001 isOn Platform001"}
    assert "Jar001 would be in two places at a time" in found.explanation
    assert found.obstacles == (Obstacle.TWO_PLACES,)
    assert not found.undecided


def test_parts_that_use_up_the_same_thing_are_named() -> None:
    found = refused(cellar("Lamp1.Lit = TRUE AND Door1.Open = FALSE AND Lamp3.Lit = TRUE"))
    assert set(found.unreachable) == {"Lamp1.Lit = TRUE", "Lamp3.Lit = TRUE"}
    assert "can each be brought about, but not all together" in found.explanation
    assert plan(cellar("Lamp1.Lit = TRUE AND Door1.Open = FALSE AND Lamp3.Lit = TRUE", ("Robot1", "Robot2"))) != found


def test_one_part_that_no_order_of_services_makes_true_is_explained_by_what_it_needs() -> None:
    found = refused(cellar("Door1.Open = TRUE"))
    assert found.unreachable == ("Door1.Open = TRUE",)
    needs = "Lamp1.Lit = TRUE and Lamp2.Lit = TRUE"
    assert f"OpenDoor could bring about Door1.Open = TRUE, but needs {needs}, and no order of services leads to that" in found.explanation
    assert found.missing == (needs,)


def test_a_provider_that_is_taken_is_named() -> None:
    found = refused(cellar("Lamp1.Lit = TRUE", ("Robot1", "Robot2"), frozenset({"Robot1", "Robot2"})))
    assert "could be brought about by LightLamp, but Robot1 and Robot2 are promised to other tasks" in found.explanation
    assert found.unoffered == ()
    assert found.obstacles == (Obstacle.PROMISED,)


def test_what_is_too_large_is_not_said_to_be_impossible(monkeypatch: pytest.MonkeyPatch) -> None:
    jars = [Object(name=f"Jar{n:03}", type="Jar") for n in range(3, 40)]
    asked = problem("Jar001 isOn Shelf1 AND Shelf2 isOn Shelf1", TRANSFER)
    many = Problem(
        ontology=asked.ontology,
        map=Map([*asked.map.objects.values(), *jars], [*asked.map.facts(), *(Fact("isOn", (jar.name, "Shelf2")) for jar in jars)]),
        goal=parse("NOT ?x: Jar isOn Shelf2 AND NOT ?x: Jar isOn Shelf1"),
        services=asked.services,
    )
    monkeypatch.setattr("somrs.planner.grounding.grounding.ACTIONS", 20)
    found = refused(many)
    assert found.undecided
    assert "too large to be searched: there are more than 20 ways to use services" in found.explanation
    assert found.unreachable == ()


def test_values_that_nobody_named_leave_it_open_whether_there_is_a_plan() -> None:
    ship = ServiceType(
        name="Ship", inputs=(Parameter(name="Jar", type="Jar"),), precondition='?Jar.Label != "none"', effect="?Jar.Shipped = TRUE"
    )
    ontology = laboratory().extended(
        [AttributeType(name="Shipped", kind=Kind.TRUTH), ObjectType(name="Jar", parent="Graspable", attributes=("Clean", "Shipped"))]
    )
    asked = problem("Jar001.Shipped = TRUE", LABEL, WASH, TRANSFER)
    found = refused(Problem(ontology=ontology, map=asked.map, goal=asked.goal, services=(*asked.services, Available(ship, ("Robot1",)))))
    assert found.undecided
    assert "any number or text" in found.explanation


def test_a_search_that_was_not_finished_says_how_far_it_got() -> None:
    found = refused(tower(40))
    assert found.undecided
    assert "states were looked at; at best" in found.explanation
    assert "of the goal's 39 parts held at once" in found.explanation


def test_at_once_nothing_is_said_to_be_impossible() -> None:
    """A short match finds plans only; that there is none, a search has to show."""
    assert quick(cellar("Lamp1.Lit = TRUE")) is not None
    assert quick(cellar("Lamp1.Lit = TRUE AND Lamp3.Lit = TRUE")) is None
