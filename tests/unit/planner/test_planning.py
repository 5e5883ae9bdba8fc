"""Planning in small worlds: a laboratory with jars, a washer, doors and robots."""

from __future__ import annotations

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.codec import Codec, encode
from somrs.ontology.files.loading import upper
from somrs.ontology.objects import Fact, FactAdded, Map, Object, ObjectAdded, ValueSet
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.validation import validate
from somrs.planner.planning import plan
from tests.support.planned import sound

TRANSFER = ServiceType(
    name="TransferObject",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="Destination", type="Object")),
    precondition="?Object isOn ?Source",
    effect="?Object isOn ?Destination",
)
WASH = ServiceType(
    name="WashJar", inputs=(Parameter(name="Jar", type="Jar"),), precondition="?Jar isOn ?Provider", effect="?Jar.Clean = TRUE"
)
OPEN = ServiceType(name="OpenDoor", inputs=(Parameter(name="Door", type="Door"),), effect="?Door.Open = TRUE")
DRIVE = ServiceType(
    name="DriveTo",
    inputs=(Parameter(name="To", type="Space"),),
    precondition="?Provider isInside ?From AND connects(?Door, ?From, ?To) AND ?Door.Open = TRUE",
    effect="?Provider isInside ?To",
)
LABEL = ServiceType(
    name="PrintLabel",
    inputs=(Parameter(name="Jar", type="Jar"), Parameter(name="Text", type="text")),
    precondition="?Jar.Clean = TRUE",
    effect="?Jar.Label = ?Text",
)


def laboratory() -> Ontology:
    return upper().extended(
        [
            AttributeType(name="Clean", kind=Kind.TRUTH),
            ObjectType(name="Jar", parent="Graspable", attributes=("Clean",)),
            ObjectType(name="Washer", parent="StationaryDevice"),
            RelationType(name="isInside", joins=("Device", "Space"), functional=True),
            RelationType(name="connects", joins=("Passage", "Space", "Space")),
        ]
    )


OBJECTS = {
    "Jar001": "Jar",
    "Jar002": "Jar",
    "Shelf1": "Shelf",
    "Shelf2": "Shelf",
    "Platform001": "Platform",
    "Washer1": "Washer",
    "Robot1": "DeliveryRobot",
    "RoomA": "Room",
    "RoomB": "Room",
    "DoorAB": "Door",
}
FACTS = [
    Fact("isOn", ("Jar001", "Shelf1")),
    Fact("isOn", ("Jar002", "Shelf1")),
    Fact("isInside", ("Robot1", "RoomA")),
    Fact("connects", ("DoorAB", "RoomA", "RoomB")),
    Fact("connects", ("DoorAB", "RoomB", "RoomA")),
]
MAP = Map((Object(name=name, type=type_name) for name, type_name in OBJECTS.items()), FACTS)


def problem(goal: str, *services: ServiceType, map: Map = MAP, excluded: frozenset[str] = frozenset()) -> Problem:
    offered = tuple(AvailableService(service, ("Washer1",) if service is WASH else ("Robot1",)) for service in services)
    return Problem(ontology=laboratory(), map=map, goal=parse(goal), services=offered, excluded=excluded)


def names(found: Plan) -> list[str]:
    return [str(step) for step in found.steps]


def test_what_holds_already_needs_no_step() -> None:
    assert sound(problem("Jar001 isOn Shelf1", TRANSFER)) == Plan()


def test_one_service_brings_the_jar() -> None:
    found = sound(problem("Jar001 isOn Platform001", TRANSFER))
    (step,) = found.steps
    assert step.service_type == "TransferObject"
    assert step.inputs == {"Object": Name("Jar001"), "Destination": Name("Platform001")}
    assert str(step.precondition) == "Jar001 isOn Shelf1"
    assert str(step.effect) == "Jar001 isOn Platform001"
    assert step.provider is None, "any robot that transfers will do"


def test_a_jar_is_washed_before_it_is_put_on_the_platform() -> None:
    found = sound(problem("Jar001.Clean = TRUE AND Jar001 isOn Platform001", TRANSFER, WASH))
    assert names(found) == [
        "TransferObject(Object: Jar001, Destination: Washer1)",
        "WashJar(Jar: Jar001) by Washer1",
        "TransferObject(Object: Jar001, Destination: Platform001)",
    ]
    assert ("step1", "step2", "Jar001 isOn Washer1") in {(link.before, link.after, link.fact) for link in found.links}
    assert [step.id for step in found.topological()] == ["step1", "step2", "step3"]
    assert [step.id for step in found.ready({"step1"})] == ["step2"]


def test_two_jars_are_transferred_side_by_side() -> None:
    found = sound(problem("Jar001 isOn Platform001 AND Jar002 isOn Shelf2", TRANSFER))
    assert len(found.steps) == 2
    assert found.links == ()


def test_the_door_is_opened_before_the_robot_drives_through() -> None:
    shut = MAP.changed([ValueSet("DoorAB", "Open", False)])
    found = sound(problem("Robot1 isInside RoomB", DRIVE, OPEN, map=shut))
    assert names(found) == ["OpenDoor(Door: DoorAB)", "DriveTo(To: RoomB) by Robot1"]
    assert [link.fact for link in found.links] == ["DoorAB.Open = TRUE"]
    assert names(sound(problem("Robot1 isInside RoomB", DRIVE, OPEN))) == ["DriveTo(To: RoomB) by Robot1"]


def test_an_input_can_be_a_value() -> None:
    found = sound(problem('Jar001.Label = "fragile"', TRANSFER, WASH, LABEL))
    assert names(found)[-1] == 'PrintLabel(Jar: Jar001, Text: "fragile")'
    assert len(found.steps) == 3


def test_a_goal_may_leave_the_place_open() -> None:
    (step,) = sound(problem("Jar001 isOn ?Shelf: Platform", TRANSFER)).steps
    assert str(step.effect) == "Jar001 isOn Platform001"


def test_of_alternatives_the_nearer_one_is_taken() -> None:
    found = sound(problem("Jar001.Clean = TRUE OR Jar001 isOn Shelf2", TRANSFER, WASH))
    assert names(found) == ["TransferObject(Object: Jar001, Destination: Shelf2)"]


def test_nothing_is_put_on_itself_and_types_are_respected() -> None:
    assert isinstance(plan(problem("Jar001 isOn Jar001", TRANSFER)), NoPlan)
    assert isinstance(plan(problem("Shelf1 isOn Platform001", TRANSFER)), NoPlan)


@pytest.mark.parametrize(
    ("goal", "services", "said"),
    [
        ("Jar001.Clean = TRUE", (TRANSFER,), "no service type"),
        ("Jar001 isOn Platform001", (), "TransferObject, which nobody offers"),
        ("Shelf1 isOn Platform001", (TRANSFER,), "TransferObject takes only a Graspable as its Object, and Shelf1 is a Shelf"),
        ("Jar009 isOn Platform001", (TRANSFER,), "there is no object Jar009"),
    ],
)
def test_no_plan_is_explained(goal: str, services: tuple[ServiceType, ...], said: str) -> None:
    found = plan(problem(goal, *services))
    assert isinstance(found, NoPlan)
    assert said in found.explanation
    assert found.unreachable == (goal,)


def test_a_thing_that_is_nowhere_is_said_to_be_missing() -> None:
    lost = Map(MAP.objects.values(), [fact for fact in FACTS if fact.arguments[0] != "Jar001"])
    found = plan(problem("Jar001 isOn Platform001", TRANSFER, map=lost))
    assert isinstance(found, NoPlan)
    assert found.missing == ("Jar001 isOn ?",)
    assert "needs Jar001 isOn ?" in found.explanation


def test_objects_promised_elsewhere_are_left_alone() -> None:
    found = plan(problem("Jar001 isOn Platform001", TRANSFER, excluded=frozenset({"Platform001"})))
    assert isinstance(found, NoPlan)
    assert "Platform001 is promised" in found.explanation


def test_a_precondition_that_does_not_hold_is_named() -> None:
    asked = problem("Jar001 isOn Platform001", TRANSFER)
    denied = Problem(
        ontology=asked.ontology, map=asked.map, goal=asked.goal, services=asked.services, precondition=parse("Jar001 isOn Shelf2")
    )
    found = plan(denied)
    assert isinstance(found, NoPlan)
    assert found.missing == ("Jar001 isOn Shelf2",)


def test_problems_can_be_sent_to_another_process() -> None:
    asked = Codec[Problem](Problem).decode(encode(problem("Jar001 isOn Platform001", TRANSFER)))
    assert len(sound(asked).steps) == 1
    assert Codec[Plan](Plan).decode(encode(sound(asked))) == sound(asked)


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
    asked = problem(goal, TRANSFER, WASH, map=map)
    found = plan(asked)
    assert isinstance(found, Plan), found
    assert len(found.steps) == count
    assert validate(found, asked) == []


def test_things_are_put_where_such_things_stand() -> None:
    (step,) = sound(problem("NOT Jar001 isOn Shelf1", TRANSFER, map=MAP.changed([FactAdded(Fact("isOn", ("Jar002", "Shelf2")))]))).steps
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
    asked = Problem(
        ontology=laboratory(),
        map=map,
        goal=parse("Jar001 isOn Platform001"),
        services=(AvailableService(carry, ("Robot1", "Robot2", "Robot3")),),
    )
    assert [step.provider for step in sound(asked).steps] == ["Robot3"]
    too_heavy = map.changed([ObjectAdded(Object(name="Jar001", type="Jar", values={"Weight": 4.0}))])
    found = plan(Problem(ontology=asked.ontology, map=too_heavy, goal=asked.goal, services=asked.services))
    assert isinstance(found, NoPlan)
    assert "Jar001.Weight <= Robot1.Payload" in found.explanation


def test_what_cannot_be_expressed_is_named() -> None:
    find = ServiceType(
        name="Find",
        inputs=(Parameter(name="Jar", type="Jar"),),
        outputs=(Parameter(name="Place", type="Object"),),
        effect="?Jar isOn ?Place",
    )
    found = plan(problem("Jar001 isOn Platform001", find))
    assert isinstance(found, NoPlan)
    assert "?Place is known only when the service is done" in found.explanation


def test_where_the_likely_places_will_not_do_all_places_are_tried() -> None:
    put = ServiceType(
        name="PutAway", inputs=TRANSFER.inputs, precondition='?Object isOn ?Source AND ?Destination.Label != "full"', effect=TRANSFER.effect
    )
    shelves = [Object(name=f"Shelf{n:02}", type="Shelf", values={"Label": "full" if n < 35 else "free"}) for n in range(40)]
    jars = [Object(name=f"Jar{n:02}", type="Jar") for n in range(35)]
    map = Map([*shelves, *jars], [Fact("isOn", (f"Jar{n:02}", f"Shelf{n:02}")) for n in range(35)])
    (step,) = sound(problem("NOT Jar00 isOn Shelf00", put, map=map)).steps
    assert str(step.inputs["Destination"]) in {f"Shelf{n}" for n in range(35, 40)}
    full = map.changed(ValueSet(shelf.name, "Label", "full") for shelf in shelves)
    found = plan(problem("NOT Jar00 isOn Shelf00", put, map=full))
    assert isinstance(found, NoPlan)
    assert not found.undecided
