"""Which uses of services may help, for a goal: none that has nothing to do with it, and none twice."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.objects import Map, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.planner.grounding.relevance import demands
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.world import World
from tests.support.laboratory import DRIVE, FACTS, LABEL, OBJECTS, OPEN, TRANSFER, WASH, laboratory

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
        ("Robot1 isInside RoomB", (DRIVE, OPEN), ["DriveTo Provider=Robot1", "OpenDoor Door:Passage"]),
        ("?r:Device isInside RoomB AND Robot1 isInside RoomB", (DRIVE, OPEN), ["DriveTo", "OpenDoor Door:Passage"]),
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
        ("?r:Device isInside RoomB AND Robot1 isInside RoomB", (DRIVE, OPEN), ["DriveTo", "OpenDoor Door:Passage"]),
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
