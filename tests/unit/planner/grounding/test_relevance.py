"""Which uses of services may help, for a goal: none that has nothing to do with it, and none twice."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import ObjectType, Ontology, RelationType
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.relevance import demands
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.world import World
from tests.support.laboratory import DRIVE, FACTS, LABEL, OBJECTS, OPEN, TRANSFER, WASH, laboratory, make_problem

TRANSFER_JAR = ServiceType(
    name="TransferJar",
    inputs=(Parameter(name="Object", type="Jar"), Parameter(name="Destination", type="Object")),
    effect="?Object isOn ?Destination",
)


def helping(goal: str, *services: ServiceType, narrow: bool = False, depth: int | None = None) -> list[str]:
    """As in `TransferObject Object=Jar001 Destination:Shelf`: this one, to any shelf."""
    map = Map([Object(name=name, type=type_name) for name, type_name in {**OBJECTS, "Cube1": "Graspable"}.items()], FACTS)
    offered = tuple(AvailableService(service, ("Robot1",)) for service in services)
    problem = Problem(ontology=laboratory(), map=map, goal=parse(goal), services=offered)
    world = World(problem)
    return sorted(
        " ".join(
            [
                demand.operator.service.name,
                *(f"{name}={value}" for name, value in demand.values),
                *(f"{name}:{'+'.join(sorted(kinds))}" for name, kinds in demand.kinds),
            ]
        )
        for demand in demands(list(goal_operators(problem.goal, world.vocabulary)), world, narrow=narrow, depth=depth)
        if demand.operator.service is not None
    )


@pytest.mark.parametrize(
    ("goal", "services", "expected"),
    [
        ("Jar001 isOn Shelf2", (TRANSFER,), ["TransferObject Object=Jar001"]),
        ("?x:Jar isOn Shelf2", (TRANSFER,), ["TransferObject Object:Jar"]),
        ("?x:Jar isOn Shelf2 AND Jar001 isOn Shelf2", (TRANSFER,), ["TransferObject Object:Jar"]),
        ("?x:Jar isOn Shelf2 AND Cube1 isOn Shelf2", (TRANSFER,), ["TransferObject Object:Jar", "TransferObject Object=Cube1"]),
        ("?x:Graspable isOn Shelf2 AND ?y:Jar isOn Shelf2", (TRANSFER,), ["TransferObject"]),
        ("?x:Jar isOn Shelf2", (TRANSFER_JAR,), ["TransferJar Destination=Shelf2"]),
        ("Cube1 isOn Shelf2", (TRANSFER_JAR,), []),
        (
            "?x:Jar isOn ?s:Shelf AND ?y:Jar isOn ?r:Room",
            (TRANSFER_JAR,),
            ["TransferJar Destination:Room", "TransferJar Destination:Shelf"],
        ),
        ("?x:Jar isOn ?s:Shelf AND ?y:Jar isOn Shelf2", (TRANSFER_JAR,), ["TransferJar Destination:Shelf"]),
        ("?x:Jar isOn ?s:Shelf AND ?y:Jar isOn ?o:Object", (TRANSFER_JAR,), ["TransferJar"]),
        ("?x:Jar isOn ?g:Graspable AND ?y:Jar isOn ?j:Jar", (TRANSFER_JAR,), ["TransferJar Destination:Graspable"]),
        ("Robot1 isInside RoomB", (DRIVE, OPEN), ["DriveTo Provider=Robot1", "OpenDoor"]),
        ("?r:Device isInside RoomB AND Robot1 isInside RoomB", (DRIVE, OPEN), ["DriveTo", "OpenDoor"]),
        ("DoorAB.Open = TRUE", (DRIVE, OPEN), ["OpenDoor Door=DoorAB"]),
        ("NOT Jar001 isOn Shelf1", (TRANSFER,), ["TransferObject Object=Jar001"]),
        ("Robot1 isInside RoomB", (TRANSFER, WASH), []),
    ],
)
def test_what_may_help(goal: str, services: tuple[ServiceType, ...], expected: list[str]) -> None:
    assert helping(goal, *services) == expected


@pytest.mark.parametrize(
    ("goal", "services", "expected"),
    [
        ("Jar001 isOn Shelf2", (TRANSFER,), ["TransferObject Destination=Shelf2 Object=Jar001"]),
        ("?x:Jar isOn Shelf2", (TRANSFER,), ["TransferObject Destination=Shelf2 Object:Jar", "TransferObject Object:Jar"]),
        (
            "?x:Jar isOn ?s:Shelf AND ?y:Jar isOn Shelf2",
            (TRANSFER_JAR,),
            ["TransferJar Destination:Shelf", "TransferJar Destination=Shelf2"],
        ),
        ("?r:Device isInside RoomB AND Robot1 isInside RoomB", (DRIVE, OPEN), ["DriveTo", "OpenDoor"]),
    ],
)
def test_what_may_help_where_not_everything_is_tried_names_what_it_can(
    goal: str, services: tuple[ServiceType, ...], expected: list[str]
) -> None:
    assert helping(goal, *services, narrow=True) == expected


def test_what_helps_what_helps_is_looked_at_up_to_the_depth() -> None:
    services = (TRANSFER, WASH, LABEL)
    label, wash, transfer = 'PrintLabel Jar=Jar001 Text="x"', "WashJar Jar=Jar001", "TransferObject Object=Jar001"
    goal = 'Jar001.Label = "x"'
    assert helping(goal, *services, depth=0) == []
    assert helping(goal, *services, depth=1) == [label]
    assert helping(goal, *services, depth=2) == sorted([label, wash])
    assert helping(goal, *services) == sorted([label, transfer, wash])


@pytest.mark.parametrize(
    ("goal", "expected"),
    [("?x:Jar isOn Shelf2", ["Fixed"]), ("?x:Shelf isOn Shelf2", []), ("Jar001 isOn Shelf2", ["Fixed"]), ("Jar002 isOn Shelf2", [])],
)
def test_what_an_effect_names_has_to_be_what_is_wanted(goal: str, expected: list[str]) -> None:
    assert helping(goal, ServiceType(name="Fixed", effect="Jar001 isOn Shelf2")) == expected


ELEMENTS = ("Carbon", "Oxygen", "Nitrogen", "Hydrogen", "Sulfur", "Boron", "Iron", "Copper")


def chemistry(kind_of_bond: str = "Atom") -> tuple[World, Problem]:
    """Atoms of each element. A reaction for each pair of elements bonds one atom to another, and needs bonds of both to any other."""
    bond = RelationType(name="bonds", joins=("Atom", "Atom"))
    types = [ObjectType(name="Atom", parent="Object"), *(ObjectType(name=name, parent="Atom") for name in ELEMENTS)]
    services = [
        ServiceType(
            name=f"{first}To{second}",
            inputs=(
                Parameter(name="A", type=first),
                Parameter(name="B", type=second),
                Parameter(name="C", type=kind_of_bond),
                Parameter(name="D", type=kind_of_bond),
            ),
            precondition="?A bonds ?C AND ?B bonds ?D",
            effect="?A bonds ?B AND ?B bonds ?A AND ?C bonds ?B AND ?A bonds ?D",
        )
        for first in ELEMENTS
        for second in ELEMENTS
    ]
    objects = [Object(name=f"{name}{number}", type=name) for name in ELEMENTS for number in (1, 2)]
    facts = [Fact("bonds", (f"{name}1", f"{other_name}2")) for name in ELEMENTS for other_name in ELEMENTS]
    problem = Problem(
        ontology=Ontology([*types, bond]),
        map=Map(objects, facts),
        goal=parse("Carbon1 bonds Oxygen1"),
        services=tuple(AvailableService(service, ("Flask",)) for service in services),
    )
    return World(problem), problem


def test_what_no_object_can_be_is_not_looked_for() -> None:
    """Each variable of a chain of reactions is asked to be of one element, never of several at a time."""
    world, problem = chemistry()
    goals = list(goal_operators(problem.goal, world.vocabulary))
    demanded = demands(goals, world)
    assert all(len(kinds) == 1 for demand in demanded for _, kinds in demand.kinds)
    assert demanded == demands(goals, world, most=5_000), "there are few of them"


def test_from_a_number_of_demands_on_they_are_for_any_objects() -> None:
    """They are then few, and lead to all that the others lead to."""
    world, problem = chemistry("Carbon")
    goals = list(goal_operators(problem.goal, world.vocabulary))
    widened = demands(goals, world, most=5)
    assert len(widened) < 5 + 2 * len(ELEMENTS) ** 2
    exact, wide = Grounding(world, demands(goals, world)), Grounding(world, widened)
    assert exact.facts.new.keys() <= wide.facts.new.keys()
    assert exact.is_goal_reachable
    assert wide.is_goal_reachable


def test_texts_are_demanded_from_any_number_of_demands_on() -> None:
    world = World(make_problem('Jar001.Label = "x"', TRANSFER, WASH, LABEL))
    goals = list(goal_operators(parse('Jar001.Label = "x"'), world.vocabulary))
    assert Grounding(world, demands(goals, world, most=1)).is_goal_reachable
