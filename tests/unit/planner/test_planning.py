"""Planning in small worlds: a laboratory with jars, a washer, doors and robots."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.codec import Codec, encode
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactAdded, Object, ObjectAdded, ValueSet
from somrs.ontology.services import Parameter, ServiceType
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.supporting_literals import supporting_literals
from somrs.planner.model.validation import validate
from somrs.planner.planning import plan
from tests.support.laboratory import DRIVE, FACTS, LABEL, MAP, OPEN, TRANSFER, WASH, laboratory, make_problem, names
from tests.support.sound_plans import make_sound_plan


def test_what_holds_already_needs_no_step() -> None:
    assert make_sound_plan(make_problem("Jar001 isOn Shelf1", TRANSFER)) == Plan()


def test_what_holds_already_of_a_device_with_a_problem_is_doubted() -> None:
    problem = make_problem("Washer1.Working = TRUE", WASH)
    assert make_sound_plan(problem) == Plan()
    broken = structs.replace(problem, map=problem.map.changed([ValueSet("Washer1", "Problem", "cannot be reached: no answer")]))
    assert plan(broken) == Plan(doubts=("Washer1 cannot be reached: no answer",))


def test_one_service_brings_the_jar() -> None:
    result = make_sound_plan(make_problem("Jar001 isOn Platform001", TRANSFER))
    (step,) = result.steps
    assert step.service_type == "TransferObject"
    assert step.inputs == {"Object": Name("Jar001"), "Destination": Name("Platform001")}
    assert str(step.precondition) == "Jar001 isOn Shelf1"
    assert str(step.effect) == "Jar001 isOn Platform001"
    assert step.provider is None, "any robot that transfers will do"


def test_a_jar_is_washed_before_it_is_put_on_the_platform() -> None:
    result = make_sound_plan(make_problem("Jar001.Clean = TRUE AND Jar001 isOn Platform001", TRANSFER, WASH))
    assert names(result) == [
        "TransferObject(Object: Jar001, Destination: Washer1)",
        "WashJar(Jar: Jar001) by Washer1",
        "TransferObject(Object: Jar001, Destination: Platform001)",
    ]
    assert ("step1", "step2", "Jar001 isOn Washer1") in {(link.before, link.after, link.fact) for link in result.links}
    assert [step.id for step in result.topological()] == ["step1", "step2", "step3"]
    assert [step.id for step in result.ready({"step1"})] == ["step2"]


def test_two_jars_are_transferred_side_by_side() -> None:
    result = make_sound_plan(make_problem("Jar001 isOn Platform001 AND Jar002 isOn Shelf2", TRANSFER))
    assert len(result.steps) == 2
    assert result.links == ()


def test_the_door_is_opened_before_the_robot_drives_through() -> None:
    shut = MAP.changed([ValueSet("DoorAB", "Open", False)])
    result = make_sound_plan(make_problem("Robot1 isInside RoomB", DRIVE, OPEN, map=shut))
    assert names(result) == ["OpenDoor(Door: DoorAB)", "DriveTo(To: RoomB) by Robot1"]
    assert [link.fact for link in result.links] == ["DoorAB.Open = TRUE"]
    assert names(make_sound_plan(make_problem("Robot1 isInside RoomB", DRIVE, OPEN))) == ["DriveTo(To: RoomB) by Robot1"]


MIX = ServiceType(
    name="Mix",
    inputs=tuple(Parameter(name=name, type="Graspable") for name in "ABCD"),
    precondition="?A.Clean = TRUE",
    effect="?A isOn ?B AND ?C isOn ?D",
)


def test_planning_ends_when_its_time_is_over_and_says_so() -> None:
    """Ten thousand uses of one service are not listed any more then; a small task is still planned."""
    many = Map((*MAP.objects.values(), *(Object(name=f"Vessel{n}", type="Jar") for n in range(12))), FACTS)
    goal = "Vessel0 isOn Vessel1 AND Vessel1 isOn Vessel2 AND Vessel2 isOn Vessel3 AND Shelf1 isOn Vessel0"
    result = plan(make_problem(goal, MIX, WASH, TRANSFER, map=many), is_overdue=lambda: True)
    assert isinstance(result, NoPlan)
    assert result.undecided
    assert result.explanation == (
        "this is too large to be searched: there are more ways to use services than could be listed in time, Mix among them"
    )
    assert isinstance(plan(make_problem("Jar001.Clean = TRUE", WASH, TRANSFER), is_overdue=lambda: True), Plan)


def test_of_many_small_choices_each_is_made_for_itself() -> None:
    """There are two to the power of forty ways in which the condition may hold, and only the last of them holds."""
    choices = " AND ".join(f"(Jar001.Clean = TRUE OR Jar00{n % 2 + 1} isOn Shelf1)" for n in range(40))
    condition = parse(f"Jar002 isOn Shelf2 OR ({choices})")
    support = supporting_literals(condition, MAP, laboratory())
    assert support is not None
    assert [str(literal) for literal in support[0]] == ["Jar001 isOn Shelf1", "Jar002 isOn Shelf1"]


def test_an_input_can_be_a_value() -> None:
    result = make_sound_plan(make_problem('Jar001.Label = "fragile"', TRANSFER, WASH, LABEL))
    assert names(result)[-1] == 'PrintLabel(Jar: Jar001, Text: "fragile")'
    assert len(result.steps) == 3


def test_a_goal_may_leave_the_place_open() -> None:
    (step,) = make_sound_plan(make_problem("Jar001 isOn ?Shelf: Platform", TRANSFER)).steps
    assert str(step.effect) == "Jar001 isOn Platform001"


def test_of_alternatives_the_nearer_one_is_taken() -> None:
    result = make_sound_plan(make_problem("Jar001.Clean = TRUE OR Jar001 isOn Shelf2", TRANSFER, WASH))
    assert names(result) == ["TransferObject(Object: Jar001, Destination: Shelf2)"]


def test_nothing_is_put_on_itself_and_types_are_respected() -> None:
    assert isinstance(plan(make_problem("Jar001 isOn Jar001", TRANSFER)), NoPlan)
    assert isinstance(plan(make_problem("Shelf1 isOn Platform001", TRANSFER)), NoPlan)


@pytest.mark.parametrize(
    ("goal", "services", "message"),
    [
        ("Jar001.Clean = TRUE", (TRANSFER,), "no service type"),
        ("Jar001 isOn Platform001", (), "TransferObject, which no device offers"),
        ("Shelf1 isOn Platform001", (TRANSFER,), "TransferObject takes only a Graspable as its Object, and Shelf1 is a Shelf"),
        ("Jar009 isOn Platform001", (TRANSFER,), "there is no object Jar009"),
    ],
)
def test_no_plan_is_explained(goal: str, services: tuple[ServiceType, ...], message: str) -> None:
    result = plan(make_problem(goal, *services))
    assert isinstance(result, NoPlan)
    assert message in result.explanation
    assert result.unreachable == (goal,)


def test_a_thing_that_is_nowhere_is_said_to_be_missing() -> None:
    lost = Map(MAP.objects.values(), [fact for fact in FACTS if fact.arguments[0] != "Jar001"])
    result = plan(make_problem("Jar001 isOn Platform001", TRANSFER, map=lost))
    assert isinstance(result, NoPlan)
    assert result.missing == ("Jar001 isOn ?",)
    assert "needs Jar001 isOn ?" in result.explanation


def test_objects_promised_elsewhere_are_left_alone() -> None:
    result = plan(make_problem("Jar001 isOn Platform001", TRANSFER, excluded=frozenset({"Platform001"})))
    assert isinstance(result, NoPlan)
    assert "Platform001 is reserved" in result.explanation


def test_a_precondition_that_does_not_hold_is_named() -> None:
    problem = make_problem("Jar001 isOn Platform001", TRANSFER)
    denied = Problem(
        ontology=problem.ontology, map=problem.map, goal=problem.goal, services=problem.services, precondition=parse("Jar001 isOn Shelf2")
    )
    result = plan(denied)
    assert isinstance(result, NoPlan)
    assert result.missing == ("Jar001 isOn Shelf2",)


def test_problems_can_be_sent_to_another_process() -> None:
    problem = Codec[Problem](Problem).decode(encode(make_problem("Jar001 isOn Platform001", TRANSFER)))
    assert len(make_sound_plan(problem).steps) == 1
    assert Codec[Plan](Plan).decode(encode(make_sound_plan(problem))) == make_sound_plan(problem)


@pytest.mark.parametrize(
    ("goal", "count"),
    [
        ("Jar7 isOn Shelf9", 1),
        ("Jar7 isOn ?Place: Shelf AND NOT Jar7 isOn Shelf7", 1),
        ("Jar7.Clean = TRUE AND Jar7 isOn Shelf9", 3),
        ("NOT ?Thing isOn Shelf9", 25),
    ],
)
def test_plans_on_a_map_of_five_thousand_objects(goal: str, count: int) -> None:
    shelves = [Object(name=f"Shelf{n}", type="Shelf") for n in range(2499)]
    jars = [Object(name=f"Jar{n}", type="Jar") for n in range(2500)]
    map = Map([*shelves, *jars, Object(name="Washer1", type="Washer")], [Fact("isOn", (f"Jar{n}", f"Shelf{n % 100}")) for n in range(2500)])
    problem = make_problem(goal, TRANSFER, WASH, map=map)
    result = plan(problem)
    assert isinstance(result, Plan), result
    assert len(result.steps) == count
    assert validate(result, problem) == []


def test_things_are_put_where_such_things_stand() -> None:
    (step,) = make_sound_plan(
        make_problem("NOT Jar001 isOn Shelf1", TRANSFER, map=MAP.changed([FactAdded(Fact("isOn", ("Jar002", "Shelf2")))]))
    ).steps
    assert step.inputs["Destination"] in (Name("Shelf2"), Name("Platform001"))


def test_a_heavy_thing_goes_to_the_device_that_can_carry_it() -> None:
    carry = ServiceType(
        name="Carry",
        inputs=TRANSFER.inputs,
        precondition="?Object isOn ?Source AND ?Object.Weight <= ?Provider.Payload",
        effect="?Object isOn ?Destination",
    )
    robots = [Object(name=f"Robot{n}", type="MobileRobot", values={"Payload": float(n)}) for n in (1, 2, 3)]
    heavy = Object(name="Jar001", type="Jar", values={"Weight": 2.5})
    map = MAP.changed([ObjectAdded(object) for object in (*robots, heavy)])
    problem = Problem(
        ontology=laboratory(),
        map=map,
        goal=parse("Jar001 isOn Platform001"),
        services=(AvailableService(carry, ("Robot1", "Robot2", "Robot3")),),
    )
    assert [step.provider for step in make_sound_plan(problem).steps] == ["Robot3"]
    too_heavy = map.changed([ObjectAdded(Object(name="Jar001", type="Jar", values={"Weight": 4.0}))])
    result = plan(Problem(ontology=problem.ontology, map=too_heavy, goal=problem.goal, services=problem.services))
    assert isinstance(result, NoPlan)
    assert "Jar001.Weight <= Robot1.Payload" in result.explanation


def test_what_cannot_be_expressed_is_named() -> None:
    find_service = ServiceType(
        name="Find",
        inputs=(Parameter(name="Jar", type="Jar"),),
        outputs=(Parameter(name="Place", type="Object"),),
        effect="?Jar isOn ?Place",
    )
    result = plan(make_problem("Jar001 isOn Platform001", find_service))
    assert isinstance(result, NoPlan)
    assert "its ?Place is known only when it is done" in result.explanation


def test_where_the_likely_places_will_not_do_all_places_are_tried() -> None:
    put_service = ServiceType(
        name="PutAway", inputs=TRANSFER.inputs, precondition='?Object isOn ?Source AND ?Destination.Label != "full"', effect=TRANSFER.effect
    )
    shelves = [Object(name=f"Shelf{n:02}", type="Shelf", values={"Label": "full" if n < 35 else "free"}) for n in range(40)]
    jars = [Object(name=f"Jar{n:02}", type="Jar") for n in range(35)]
    map = Map([*shelves, *jars], [Fact("isOn", (f"Jar{n:02}", f"Shelf{n:02}")) for n in range(35)])
    (step,) = make_sound_plan(make_problem("NOT Jar00 isOn Shelf00", put_service, map=map)).steps
    assert str(step.inputs["Destination"]) in {f"Shelf{n}" for n in range(35, 40)}
    full = map.changed(ValueSet(shelf.name, "Label", "full") for shelf in shelves)
    result = plan(make_problem("NOT Jar00 isOn Shelf00", put_service, map=full))
    assert isinstance(result, NoPlan)
    assert not result.undecided
