"""Plans for more robots and places than can be listed: a lookahead follows relaxed plans with the robots that are near."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given
from msgspec import structs

from somrs.entish.parse import parse
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.grounding.bags import Bag, find_bags
from somrs.planner.grounding.relevance import demands
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.plan import Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.validation import validate
from somrs.planner.model.world import World
from somrs.planner.planning import plan
from somrs.planner.search.lookahead import Lookahead
from somrs.planner.search.steps import build_plan
from somrs.sites.pddl import read
from tests.support.examples import examples
from tests.support.small_pddl import small
from tests.unit.planner.test_properties import problems

ONTOLOGY: Ontology = upper().extended(
    [
        AttributeType(name="Level", kind=Kind.NUMBER, unit="percent", minimum=0, maximum=100),
        AttributeType(name="Strength", kind=Kind.NUMBER, unit="kg"),
        AttributeType(name="Load", kind=Kind.NUMBER, unit="kg"),
        ObjectType(name="Spot", parent="Place"),
        ObjectType(name="Socket", parent="Spot"),
        ObjectType(name="Floor1", parent="Place"),
        ObjectType(name="Parcel", parent="Graspable", attributes=("Load",)),
        ObjectType(name="Carrier", parent="MobileRobot", attributes=("Level", "Strength")),
        RelationType(name="standsAt", joins=("Device", "Spot"), functional=True),
        RelationType(name="liesAt", joins=("Parcel", "Spot"), functional=True, excludes="lying"),
        RelationType(name="heldBy", joins=("Parcel", "Carrier"), functional=True, excludes="lying"),
        RelationType(name="onFloor", joins=("Spot", "Floor1")),
        RelationType(name="lift", joins=("Spot", "Spot")),
    ]
)
SPOT = Parameter(name="To", type="Spot")
PARCEL = Parameter(name="Parcel", type="Parcel")
MOVE = ServiceType(
    name="Move",
    inputs=(SPOT,),
    precondition="?Provider standsAt ?From AND ?From onFloor ?Floor AND ?To onFloor ?Floor AND ?Provider.Level >= 5 %",
    effect="?Provider standsAt ?To",
)
RIDE = ServiceType(
    name="Ride", inputs=(SPOT,), precondition="?Provider standsAt ?From AND lift(?From, ?To)", effect="?Provider standsAt ?To"
)
CHARGE = ServiceType(name="Charge", inputs=(), precondition="?Provider standsAt ?Spot: Socket", effect="?Provider.Level = 100 %")
TAKE = ServiceType(
    name="Take",
    inputs=(PARCEL,),
    precondition="?Parcel liesAt ?Spot AND ?Provider standsAt ?Spot AND ?Provider.Level >= 20 % AND ?Parcel.Load <= ?Provider.Strength",
    effect="?Parcel heldBy ?Provider",
)
PUT = ServiceType(
    name="Put",
    inputs=(PARCEL, SPOT),
    precondition="?Parcel heldBy ?Provider AND ?Provider standsAt ?To",
    effect="?Parcel liesAt ?To",
)
SERVICES = (MOVE, RIDE, CHARGE, TAKE, PUT)
SPOTS = 12
"""On each of two floors. Spot0 has a socket and Spot1 a lift, on both."""


def make_problem(goal: str, carriers: Mapping[str, str], parcels: Mapping[str, str], **values: Mapping[str, float]) -> Problem:
    """Carriers and parcels by the spots where they are: `low3` is Spot 3 of the lower floor."""
    objects = [Object(name=floor, type="Floor1") for floor in ("Low", "High")]
    facts = [Fact("lift", ("low1", "high1")), Fact("lift", ("high1", "low1"))]
    for floor in ("Low", "High"):
        for number in range(SPOTS):
            spot = f"{floor.lower()}{number}"
            objects.append(Object(name=spot, type="Socket" if number == 0 else "Spot"))
            facts.append(Fact("onFloor", (spot, floor)))
    objects += [Object(name=name, type="Carrier", values={"Level": 50.0, "Strength": 5.0, **values.get(name, {})}) for name in carriers]
    objects += [Object(name=name, type="Parcel", values={"Load": 1.0, **values.get(name, {})}) for name in parcels]
    facts += [Fact("standsAt", item) for item in carriers.items()] + [Fact("liesAt", item) for item in parcels.items()]
    services = tuple(AvailableService(service, tuple(carriers)) for service in SERVICES)
    return Problem(ontology=ONTOLOGY, map=Map(objects, facts), goal=parse(goal), services=services)


def fleet(spots: str, count: int) -> dict[str, str]:
    return {f"{spots}-carrier{n}": f"{spots}{n % SPOTS}" for n in range(count)}


def planned(problem: Problem) -> Plan:
    result = plan(problem)
    assert isinstance(result, Plan), result
    assert validate(result, problem) == []
    return result


def bags_of(problem: Problem) -> list[Bag]:
    world = World(problem)
    return find_bags(problem, world, demands(list(goal_operators(problem.goal, world.vocabulary)), world))


def test_a_parcel_goes_to_another_floor_with_the_robot_that_stands_beside_it() -> None:
    result = planned(make_problem("p liesAt high7", fleet("low", 30), {"p": "low5"}))
    assert [step.service_type for step in result.steps] == ["Take", "Move", "Ride", "Move", "Put"]
    assert {step.provider for step in result.steps} <= {"low-carrier5", "low-carrier17", "low-carrier29"}


def test_a_robot_of_the_other_floor_comes_if_there_is_no_other() -> None:
    result = planned(make_problem("p liesAt low7", fleet("high", 20), {"p": "low5"}))
    assert [step.service_type for step in result.steps] == ["Ride", "Move", "Take", "Move", "Put"]
    assert len({step.provider for step in result.steps}) == 1


def test_a_charged_robot_is_preferred_and_otherwise_one_charges_first() -> None:
    carriers = fleet("low", 24)
    low = {name: {"Level": 10.0} for name in carriers}
    charged = {**low, "low-carrier3": {"Level": 60.0}}
    result = planned(make_problem("p liesAt low7", carriers, {"p": "low5"}, **charged))
    assert {step.provider for step in result.steps} == {"low-carrier3"}
    result = planned(make_problem("p liesAt low7", carriers, {"p": "low5"}, **low))
    assert [step.service_type for step in result.steps].count("Charge") == 1
    assert len({step.provider for step in result.steps}) == 1


def test_what_is_too_heavy_is_left_to_those_who_can() -> None:
    carriers = fleet("low", 30)
    values = {"low-carrier9": {"Strength": 20.0}, "p": {"Load": 10.0}}
    problem = make_problem("p liesAt high7", carriers, {"p": "low5"}, **values)
    assert {step.provider for step in planned(problem).steps} == {"low-carrier9"}
    assert sorted(len(bag.members) for bag in bags_of(problem)) == [29]


def test_robots_for_which_the_map_settles_a_choice_differently_are_not_alike() -> None:
    carriers = fleet("low", 30)
    choices = " AND ".join(f"(?Provider.Strength >= 10 kg OR ?Provider.Strength >= {weight} kg)" for weight in range(11, 20))
    lift = structs.replace(TAKE, precondition=f"?Parcel liesAt ?Spot AND ?Provider standsAt ?Spot AND {choices}")
    problem = make_problem("p liesAt high7", carriers, {"p": "low5"}, **{"low-carrier9": {"Strength": 10.0}})
    services = tuple(AvailableService(service, tuple(carriers)) for service in (MOVE, RIDE, lift, PUT))
    problem = structs.replace(problem, services=services)
    assert [set(bag.members) for bag in bags_of(problem)] == [{*carriers} - {"low-carrier9"}]
    assert {step.provider for step in planned(problem).steps} == {"low-carrier9"}


def test_a_device_that_a_condition_names_is_in_no_bag() -> None:
    carriers = fleet("low", 20)
    lift = structs.replace(TAKE, precondition=f"{TAKE.precondition} AND ?Provider != low-carrier5 AND ?Provider != low-carrier17")
    problem = make_problem("p liesAt high7", carriers, {"p": "low5"})
    services = tuple(AvailableService(service, tuple(carriers)) for service in (MOVE, RIDE, lift, PUT))
    problem = structs.replace(problem, services=services)
    assert [set(bag.members) for bag in bags_of(problem)] == [{*carriers} - {"low-carrier5", "low-carrier17"}]
    assert {"low-carrier5", "low-carrier17"}.isdisjoint(step.provider for step in planned(problem).steps if step.service_type == "Take")


def test_each_of_many_parcels_gets_a_robot_of_its_own() -> None:
    parcels = {f"p{n}": f"low{n}" for n in range(2, 10)}
    goal = " AND ".join(f"{name} liesAt high{n + 1}" for n, name in enumerate(parcels))
    result = planned(make_problem(goal, {**fleet("low", 24), **fleet("high", 6)}, parcels))
    assert len({step.provider for step in result.steps}) == len(parcels)


def test_few_robots_bring_many_parcels() -> None:
    parcels = {f"p{n}": f"low{n}" for n in range(2, 10)}
    problem = make_problem(" AND ".join(f"{name} liesAt high9" for name in parcels), fleet("low", 2), parcels)
    world = World(problem)
    moves = Lookahead(problem, world, list(goal_operators(problem.goal, world.vocabulary))).find_moves()
    assert moves is not None
    assert validate(build_plan(problem, moves), problem) == []


def test_a_device_that_the_goal_names_is_in_no_bag() -> None:
    problem = make_problem("low-carrier4 standsAt high3 AND p liesAt low7", fleet("low", 20), {"p": "low5"})
    assert [set(bag.members) for bag in bags_of(problem)] == [set(fleet("low", 20)) - {"low-carrier4"}]
    assert any(step.provider == "low-carrier4" and step.service_type == "Ride" for step in planned(problem).steps)


def test_excluded_devices_are_in_no_bag_and_no_plan() -> None:
    problem = make_problem("p liesAt high7", fleet("low", 30), {"p": "low5"})
    excluded = frozenset({"low-carrier5", "low-carrier17", "low-carrier29"})
    limited = Problem(ontology=ONTOLOGY, map=problem.map, goal=problem.goal, services=problem.services, excluded=excluded)
    assert not excluded & {member for bag in bags_of(limited) for member in bag.members}
    assert not excluded & {step.provider for step in planned(limited).steps}


@examples(60)
@given(problems())
def test_what_a_lookahead_finds_is_a_plan(problem: Problem) -> None:
    world = World(problem)
    moves = Lookahead(problem, world, list(goal_operators(problem.goal, world.vocabulary))).find_moves()
    if moves is not None:
        assert validate(build_plan(problem, moves), problem) == []


@pytest.mark.parametrize("name", ["courier", "yard"])
def test_problems_in_which_agents_hand_things_over_are_found_by_it_too(name: str) -> None:
    problem = small(name)
    world = World(problem)
    moves = Lookahead(problem, world, list(goal_operators(problem.goal, world.vocabulary))).find_moves()
    assert moves is None or validate(build_plan(problem, moves), problem) == []
    assert (moves is not None) is (name == "courier")


HAULAGE = """(define (domain haulage) (:requirements :typing)
  (:types place thing space - object van parcel - thing)
  (:predicates (road ?a ?b - place) (at ?t - thing ?p - place) (in ?x - parcel ?v - van) (free ?v - van ?s - space) (next ?a ?b - space))
  (:action drive :parameters (?v - van ?a ?b - place) :precondition (and (at ?v ?a) (road ?a ?b)) :effect (and (not (at ?v ?a)) (at ?v ?b)))
  (:action load :parameters (?v - van ?p - place ?x - parcel ?s ?t - space)
    :precondition (and (at ?v ?p) (at ?x ?p) (next ?s ?t) (free ?v ?t))
    :effect (and (not (at ?x ?p)) (in ?x ?v) (free ?v ?s) (not (free ?v ?t))))
  (:action unload :parameters (?v - van ?p - place ?x - parcel ?s ?t - space)
    :precondition (and (at ?v ?p) (in ?x ?v) (next ?s ?t) (free ?v ?s))
    :effect (and (not (in ?x ?v)) (at ?x ?p) (free ?v ?t) (not (free ?v ?s)))))"""


def test_vans_that_are_no_devices_bring_more_parcels_than_they_can_hold(tmp_path: Path) -> None:
    places, parcels, vans = [f"p{n}" for n in range(60)], [f"x{n}" for n in range(20)], ["v0", "v1", "v2"]
    roads = [f"(road {a} {b}) (road {b} {a})" for a, b in zip(places, [*places[1:], places[0]], strict=True)]
    at = [f"(at {parcel} p{7 * n % 60})" for n, parcel in enumerate(parcels)] + [f"(at {van} p{20 * n})" for n, van in enumerate(vans)]
    task = f"""(define (problem all) (:domain haulage)
      (:objects {" ".join(places)} - place {" ".join(parcels)} - parcel {" ".join(vans)} - van s0 s1 s2 - space)
      (:init (next s0 s1) (next s1 s2) {" ".join(f"(free {van} s2)" for van in vans)} {" ".join((*roads, *at))})
      (:goal (and {" ".join(f"(at {parcel} p{(11 * n + 30) % 60})" for n, parcel in enumerate(parcels))})))"""
    for name, text in (("domain", HAULAGE), ("problem", task)):
        (tmp_path / f"{name}.pddl").write_text(text, encoding="utf-8")
    problem = read(tmp_path / "domain.pddl", tmp_path / "problem.pddl").problem()
    world = World(problem)
    moves = Lookahead(problem, world, list(goal_operators(problem.goal, world.vocabulary))).find_moves()
    assert moves is not None
    assert validate(build_plan(problem, moves), problem) == []
