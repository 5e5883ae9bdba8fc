"""Planning for goals and services with NOT before anything, FORALL and EXISTS."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object, ValueSet
from somrs.ontology.services import Parameter, ServiceType
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.relevance import demands
from somrs.planner.model.expansion import expand_quantifiers
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.world import World
from somrs.planner.planning import plan
from tests.support.laboratory import MAP, TRANSFER, WASH, make_problem, names
from tests.support.sound_plans import make_sound_plan

CLEAN = ServiceType(
    name="CleanShelf",
    inputs=(Parameter(name="Shelf", type="Shelf"),),
    precondition="FORALL ?Thing: Graspable (NOT ?Thing isOn ?Shelf)",
    effect='?Shelf.Label = "clean"',
)
LOCK = ServiceType(
    name="LockRoom",
    inputs=(Parameter(name="Room", type="Room"),),
    precondition="FORALL ?Door: Door (FORALL ?Other: Room (NOT connects(?Door, ?Room, ?Other) OR ?Door.Open = FALSE))",
    effect='?Room.Label = "locked"',
)
SHUT = ServiceType(name="ShutDoor", inputs=(Parameter(name="Door", type="Door"),), effect="?Door.Open = FALSE")
PACK = ServiceType(
    name="Pack",
    inputs=(Parameter(name="Platform", type="Platform"),),
    precondition="FORALL ?Jar: Jar (?Jar isOn ?Platform OR ?Jar.Clean = TRUE)",
    effect='?Platform.Label = "packed"',
)


def hall(jars: int, shelves: int = 20) -> Map:
    """Every tenth jar is on the floor, the others are on shelves."""
    objects = [
        *(Object(name=f"Shelf{n}", type="Shelf") for n in range(shelves)),
        *(Object(name=f"Jar{n}", type="Jar") for n in range(jars)),
        Object(name="Floor1", type="Floor"),
        Object(name="Platform1", type="Platform"),
    ]
    return Map(objects, [Fact("isOn", (f"Jar{n}", f"Shelf{n % shelves}" if n % 10 else "Floor1")) for n in range(jars)])


@pytest.mark.parametrize(
    ("goal", "count"),
    [
        ("FORALL ?Jar: Jar (?Jar isOn Shelf1)", 0),
        ("FORALL ?Jar: Jar (?Jar isOn Platform001)", 2),
        ("FORALL ?Jar: Jar (NOT ?Jar isOn Shelf1)", 2),
        ("NOT EXISTS ?Jar: Jar (?Jar isOn Shelf1)", 2),
        ("NOT (Jar001 isOn Shelf1 OR Jar002 isOn Shelf1)", 2),
        ("NOT (Jar001 isOn Shelf1 AND Jar002 isOn Shelf1)", 1),
        ("EXISTS ?Jar: Jar (?Jar isOn Platform001 AND ?Jar.Clean = TRUE)", 3),
        ("FORALL ?Jar: Jar (EXISTS ?Place: Platform (?Jar isOn ?Place))", 2),
        ("EXISTS ?Place: Platform (FORALL ?Jar: Jar (?Jar isOn ?Place))", 2),
        ("FORALL ?Jar: Jar (?Jar isOn ?Place: Platform)", 2),
        ("FORALL ?Shelf: Shelf (EXISTS ?Jar: Jar (?Jar isOn ?Shelf))", 1),
        ("FORALL ?Jar: Jar (?Jar = Jar002 OR ?Jar isOn Shelf2)", 1),
        ("FORALL ?Jar: Jar (?Jar isOn Shelf2 OR ?Jar.Clean = TRUE) AND EXISTS ?Jar: Jar (?Jar isOn Platform001)", 4),
        ("EXISTS ?Place: Shelf (?Place != Shelf1 AND FORALL ?Jar: Jar (?Jar isOn ?Place OR ?Jar isOn Platform001))", 2),
        ("FORALL ?Robot: CeilingCamera (?Robot.Open = TRUE) AND Jar001 isOn Shelf2", 1),
    ],
)
def test_goals_with_quantifiers_are_planned_for(goal: str, count: int) -> None:
    assert len(make_sound_plan(make_problem(goal, TRANSFER, WASH)).steps) == count


def test_all_things_are_carried_away_side_by_side() -> None:
    result = make_sound_plan(make_problem("FORALL ?Jar: Jar (NOT ?Jar isOn Shelf1)", TRANSFER))
    assert result.links == ()


def test_a_service_may_need_something_of_all_objects() -> None:
    result = make_sound_plan(make_problem('Shelf1.Label = "clean"', TRANSFER, CLEAN))
    assert [step.service_type for step in result.topological()] == ["TransferObject", "TransferObject", "CleanShelf"]
    assert {link.fact for link in result.links} == {"NOT Jar001 isOn Shelf1", "NOT Jar002 isOn Shelf1"}
    assert names(make_sound_plan(make_problem('Shelf2.Label = "clean"', TRANSFER, CLEAN))) == ["CleanShelf(Shelf: Shelf2)"]


def test_only_the_objects_that_the_map_relates_to_the_input_matter() -> None:
    doors = MAP.changed([ValueSet("DoorAB", "Open", True)])
    assert names(make_sound_plan(make_problem('RoomA.Label = "locked"', LOCK, SHUT, map=doors))) == [
        "ShutDoor(Door: DoorAB)",
        "LockRoom(Room: RoomA)",
    ]


def test_what_the_map_says_of_an_input_is_no_choice() -> None:
    """Each room has two of the doors. The conditions of the other doors hold whatever services do."""
    count = 20
    rooms, doors = [f"Room{n}" for n in range(count)], [f"Door{n}" for n in range(count)]
    objects = [*(Object(name=room, type="Room") for room in rooms), *(Object(name=door, type="Door") for door in doors)]
    ring = Map(objects, [Fact("connects", (doors[n], rooms[n], rooms[(n + 1) % count])) for n in range(count)])
    opened = ring.changed([ValueSet(door, "Open", True) for door in doors])
    problem = expand_quantifiers(make_problem('Room3.Label = "locked"', LOCK, SHUT, map=opened))
    result = make_sound_plan(problem)
    assert sorted(names(result)) == ["LockRoom(Room: Room3)", "ShutDoor(Door: Door3)"]
    world = World(problem)
    grounding = Grounding(world, demands(list(goal_operators(problem.goal, world.vocabulary)), world))
    choices = [action.binding["Room"] for action in grounding.actions if action.operator.is_choice]
    assert choices == ["Room3"]


def test_a_service_may_need_a_choice_for_each_object() -> None:
    result = make_sound_plan(make_problem('Platform001.Label = "packed" AND Jar001 isOn Shelf1', TRANSFER, WASH, PACK))
    assert names(result)[-1] == "TransferObject(Object: Jar001, Destination: Shelf1)" or len(result.steps) == 4
    assert str(result.steps[-1].effect) in ("Jar001 isOn Shelf1", 'Platform001.Label = "packed"')


def test_what_no_service_changes_is_evaluated_and_left_out() -> None:
    problem = make_problem(
        "FORALL ?Door: Door (NOT connects(?Door, RoomA, RoomB) OR ?Door.Open = FALSE) AND Jar001 isOn Shelf2", SHUT, TRANSFER
    )
    assert str(expand_quantifiers(problem).goal) == "DoorAB.Open = FALSE AND Jar001 isOn Shelf2"


@pytest.mark.parametrize(
    ("goal", "count"),
    [
        ("FORALL ?Jar: Jar (NOT ?Jar isOn Floor1)", 30),
        ("FORALL ?Jar: Jar (?Jar isOn Platform1)", 300),
    ],
)
def test_three_hundred_objects(goal: str, count: int) -> None:
    result = plan(make_problem(goal, TRANSFER, map=hall(300)))
    assert isinstance(result, Plan), result
    assert len(result.steps) == count
    assert result.links == ()


@pytest.mark.parametrize(
    ("goal", "count"),
    [
        ("FORALL ?Jar: Jar (EXISTS ?Shelf: Shelf (?Jar isOn ?Shelf))", 3),
        ("FORALL ?Jar: Jar (?Jar isOn Platform1 OR ?Jar isOn Shelf1)", 28),
    ],
)
def test_a_choice_for_each_of_thirty_objects(goal: str, count: int) -> None:
    result = plan(make_problem(goal, TRANSFER, map=hall(30)))
    assert isinstance(result, Plan), result
    assert len(result.steps) == count


@pytest.mark.parametrize(
    ("goal", "unreachable", "message"),
    [
        (
            "FORALL ?Jar: Jar (?Jar.Clean = TRUE)",
            ("Jar001.Clean = TRUE", "Jar002.Clean = TRUE"),
            "Jar001.Clean = TRUE does not hold on the map, and no service type brings it about",
        ),
        (
            "FORALL ?Shelf: Shelf (?Shelf isOn Platform001)",
            ("Shelf1 isOn Platform001", "Shelf2 isOn Platform001"),
            "TransferObject takes only a Graspable as its Object, and Shelf1 is a Shelf",
        ),
        (
            "EXISTS ?Shelf: Shelf (?Shelf isOn Platform001)",
            ("?Shelf: Shelf isOn Platform001",),
            "no service type brings it about",
        ),
        ("NOT (Jar001 isOn Shelf1 OR connects(DoorAB, RoomA, RoomB))", ("NOT connects(DoorAB, RoomA, RoomB)",), "no service type"),
        (
            "EXISTS ?Shelf: Shelf (FORALL ?Jar: Jar (?Jar isOn ?Shelf AND ?Jar isOn Platform001))",
            (),
            "can each be brought about, but not all together",
        ),
    ],
)
def test_why_there_is_no_plan(goal: str, unreachable: tuple[str, ...], message: str) -> None:
    result = plan(make_problem(goal, TRANSFER))
    assert isinstance(result, NoPlan)
    assert message in result.explanation
    if unreachable:
        assert result.unreachable == unreachable


def test_a_value_for_which_something_must_hold_is_refused_with_its_reason() -> None:
    result = plan(make_problem("NOT (Jar001.Label = ?label AND Jar002.Label = ?label)", WASH, TRANSFER, OPEN_LABEL))
    assert isinstance(result, NoPlan)
    assert "?label stands for any value" in result.explanation
    assert result.undecided


OPEN_LABEL = ServiceType(
    name="PrintLabel",
    inputs=(Parameter(name="Jar", type="Jar"), Parameter(name="Text", type="text")),
    effect="?Jar.Label = ?Text",
)


def test_the_goal_that_holds_needs_no_step_although_an_object_was_added() -> None:
    assert plan(make_problem("FORALL ?Jar: Jar (EXISTS ?Shelf: Shelf (?Jar isOn ?Shelf))", TRANSFER)) == Plan()
    assert parse("FORALL ?Jar: Jar (EXISTS ?Shelf: Shelf (?Jar isOn ?Shelf))") is not None
