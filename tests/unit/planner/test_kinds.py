"""What the three kinds of service mean to a plan: cognitive services find out, software services compute, and only physical services make
things so."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ValueSet
from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.ontology.types import RelationType
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.planning import plan, plan_quickly
from tests.support.laboratory import FACTS, MAP, TRANSFER, WASH, laboratory, make_problem, names

OBJECT = Parameter(name="Object", type="Graspable")
LOOK = ServiceType(
    name="RecognizeSituation",
    kind=ServiceKind.COGNITIVE,
    inputs=(Parameter(name="Object", type="PhysicalObject"),),
    effect="?Object.Unknown = FALSE",
)
SEE = ServiceType(
    name="SeeWhetherOn",
    kind=ServiceKind.COGNITIVE,
    inputs=(Parameter(name="Thing", type="PhysicalObject"), Parameter(name="Place", type="Object")),
    effect="?Thing isOn ?Place",
)
FIND_JARS = ServiceType(
    name="FindJars",
    kind=ServiceKind.COGNITIVE,
    inputs=(Parameter(name="Place", type="Support"),),
    outputs=(Parameter(name="Jar", type="Jar"),),
    effect="?Jar isOn ?Place",
)
WEIGH = ServiceType(
    name="Weigh",
    kind=ServiceKind.COGNITIVE,
    inputs=(OBJECT,),
    outputs=(Parameter(name="Weight", type="number"),),
    precondition="?Object isOn ?Provider",
    effect="?Object.Weight = ?Weight",
)
CARRY_LIGHT = ServiceType(
    name="CarryLight",
    inputs=TRANSFER.inputs,
    precondition="?Object isOn ?Source AND ?Object.Weight <= ?Provider.Payload",
    effect=TRANSFER.effect,
)
PICK_PLACE = ServiceType(
    name="PickPlace",
    kind=ServiceKind.SOFTWARE,
    inputs=(OBJECT,),
    outputs=(Parameter(name="Place", type="Support"),),
    effect="?Place isFreeFor ?Object",
)
STORE = ServiceType(
    name="Store",
    inputs=(OBJECT, Parameter(name="Place", type="Support")),
    precondition="?Object isOn ?Source AND ?Place isFreeFor ?Object",
    effect="?Object isOn ?Place",
)
RACK = ServiceType(
    name="PutIntoRack",
    inputs=(OBJECT,),
    outputs=(Parameter(name="Shelf", type="Shelf"),),
    precondition="?Object isOn ?Source",
    effect='?Object isOn ?Shelf AND ?Object.Label = "stored"',
)
PROVIDERS = {WASH.name: ("Washer1",), WEIGH.name: ("Platform001",), CARRY_LIGHT.name: ("Robot1", "Robot2")}


def problem(goal: str, *services: ServiceType, map: Map = MAP, unknown: str | None = None) -> Problem:
    """A problem in the laboratory, in which one object may be marked as unknown."""
    changes: list[Change] = [
        ValueSet("Robot1", "Payload", 1.0),
        ObjectAdded(Object(name="Robot2", type="DeliveryRobot", values={"Payload": 5.0})),
    ]
    if unknown is not None:
        changes += [ValueSet(unknown, "Unknown", True), *(FactRemoved(fact) for fact in FACTS if fact.arguments[0] == unknown)]
    ontology = laboratory().extended([RelationType(name="isFreeFor", joins=("Support", "Graspable"))])
    offers = tuple(AvailableService(service, PROVIDERS.get(service.name, ("Robot1",))) for service in services)
    excluded = frozenset({unknown} if unknown is not None else ())
    return structs.replace(
        make_problem(goal, map=map.changed(changes)), ontology=ontology, services=offers, excluded=excluded, unknown=excluded
    )


def planned(problem: Problem) -> Plan:
    result = plan(problem)
    assert isinstance(result, Plan), result
    return result


def refused(problem: Problem) -> NoPlan:
    result = plan(problem)
    assert isinstance(result, NoPlan), result
    return result


def executed(result: Plan) -> list[str]:
    """The steps that are executed before the plan is completed."""
    return names(result.certain_part)


# Nothing becomes so because it is looked at


def test_a_recogniser_is_never_planned_as_one_that_puts_things_there() -> None:
    goal = "Jar001 isOn Platform001"
    assert "no device offers now" in refused(problem(goal, SEE)).explanation, "TransferObject could"
    assert names(planned(problem(goal, SEE, TRANSFER))) == ["TransferObject(Object: Jar001, Destination: Platform001)"]


def test_a_software_service_moves_nothing() -> None:
    claims = structs.replace(PICK_PLACE, effect="?Object isOn ?Place", name="Book")
    assert isinstance(plan(problem("Jar001 isOn Platform001", claims)), NoPlan)
    assert isinstance(plan(problem("Jar001 isOn ?Place: Platform", claims)), NoPlan), "its place is known"


# Knowing before acting


def test_that_an_object_be_known_is_a_task_for_a_recogniser() -> None:
    result = planned(problem("Jar002.Unknown = FALSE", LOOK, TRANSFER, unknown="Jar002"))
    assert names(result) == ["RecognizeSituation(Object: Jar002)"]
    (step,) = result.steps
    assert str(step.effect) == "Jar002.Unknown = FALSE"
    assert step.kind is ServiceKind.COGNITIVE
    assert step.finds == ("Jar002",)


@pytest.mark.parametrize("keeps_fact", [False, True])
def test_an_unknown_object_is_looked_for_before_it_is_carried(keeps_fact: bool) -> None:
    stated = problem("Jar002 isOn Platform001", LOOK, TRANSFER, unknown="Jar002")
    if keeps_fact:  # the map may still say where it was
        stated = structs.replace(stated, map=stated.map.changed([FactAdded(Fact("isOn", ("Jar002", "Shelf1")))]))
    result = planned(stated)
    assert names(result) == ["RecognizeSituation(Object: Jar002)", "TransferObject(Object: Jar002, Destination: Platform001)"]
    assert [(link.before, link.after) for link in result.links] == [("step1", "step2")]
    assert executed(result) == ["RecognizeSituation(Object: Jar002)"]
    assert plan_quickly(stated) is None, "it is no answer of a few milliseconds"


def test_an_object_that_is_nowhere_on_the_map_is_looked_for_too() -> None:
    lost = MAP.changed([FactRemoved(Fact("isOn", ("Jar001", "Shelf1")))])
    result = planned(problem("Jar001 isOn Platform001", LOOK, TRANSFER, map=lost))
    assert executed(result) == ["RecognizeSituation(Object: Jar001)"]
    assert len(result.steps) == 2


def test_no_plan_relies_on_luck_where_it_need_not() -> None:
    washed = problem("Jar002.Clean = TRUE", LOOK, TRANSFER, WASH, unknown="Jar002")
    assert [step.service_type for step in planned(washed).steps] == ["RecognizeSituation", "TransferObject", "WashJar"]
    lucky = planned(problem("Jar002.Clean = TRUE", LOOK, WASH, unknown="Jar002"))
    assert [step.service_type for step in lucky.steps] == ["RecognizeSituation", "WashJar"], "it may be in the washer already"
    assert "Jar002 isOn Washer1" in str(lucky.steps[0].assumed)


def test_what_is_not_there_has_to_be_known_not_to_be_there() -> None:
    result = planned(problem("NOT Jar002 isOn Shelf1", LOOK, TRANSFER, unknown="Jar002"))
    assert executed(result) == ["RecognizeSituation(Object: Jar002)"]


def test_steps_that_use_the_object_wait_until_it_is_known() -> None:
    paint = ServiceType(name="PaintLabel", inputs=(OBJECT,), effect='?Object.Label = "red"')
    result = planned(problem('Jar002.Label = "red" AND Jar001 isOn Platform001', LOOK, TRANSFER, paint, unknown="Jar002"))
    look, painting = (next(step for step in result.steps if step.service_type == name) for name in ("RecognizeSituation", "PaintLabel"))
    assert look.id in result.predecessors(painting.id)
    assert executed(result) == ["RecognizeSituation(Object: Jar002)"]


def test_a_known_object_is_preferred() -> None:
    assert names(planned(problem("?It: Jar isOn Platform001", LOOK, TRANSFER, unknown="Jar002"))) == [
        "TransferObject(Object: Jar001, Destination: Platform001)"
    ]


def test_an_unknown_device_is_not_chosen_on_an_assumption() -> None:
    stated = problem("Jar001 isOn Platform001", LOOK, TRANSFER, unknown="Robot1")
    assert isinstance(plan(stated), NoPlan)


def test_what_is_not_weighed_is_put_on_the_scale_before_a_light_robot_takes_it() -> None:
    heavy = structs.replace(CARRY_LIGHT, name="CarryHeavy", precondition="?Object isOn ?Source", cost="20")
    light = structs.replace(CARRY_LIGHT, cost="1")
    on_scale = MAP.changed([FactRemoved(Fact("isOn", ("Jar001", "Shelf1"))), FactAdded(Fact("isOn", ("Jar001", "Platform001")))])
    result = planned(problem("Jar001 isOn Shelf2", WEIGH, light, map=on_scale))
    assert [step.service_type for step in result.steps] == ["Weigh", "CarryLight"]
    weighing = result.steps[0]
    assert str(weighing.effect) == "Jar001.Weight = ?Weight"
    assert weighing.provider == "Platform001"
    assert ("step1", "step2") in {(link.before, link.after) for link in result.links}
    weighed = on_scale.changed([ValueSet("Jar001", "Weight", 9.0)])
    assert "Jar001.Weight <= Robot1.Payload" in refused(problem("Jar001 isOn Shelf2", WEIGH, light, map=weighed)).explanation
    assert names(planned(problem("Jar001 isOn Shelf2", WEIGH, light, heavy))) == ["CarryHeavy(Object: Jar001, Destination: Shelf2)"]


@pytest.mark.parametrize(
    ("goal", "assumed"),
    [
        ("Jar001.Weight < 3 kg", True),
        ("Jar001.Weight > 3 kg", True),
        ("Jar001.Weight = 3 kg", True),
        ("Jar001.Weight != 3 kg", True),
        ("Jar001.Weight >= 300 g AND Jar001.Weight <= 500 g", True),
        ("Jar001.Weight < 0 kg", False),
    ],
)
def test_any_value_that_an_attribute_can_have_may_be_found(goal: str, assumed: bool) -> None:
    weigh = structs.replace(WEIGH, precondition=None)
    assert isinstance(plan(problem(goal, weigh)), Plan) is assumed


def test_what_is_known_already_is_not_found_out_otherwise() -> None:
    weighed = MAP.changed([ValueSet("Jar001", "Weight", 4.0)])
    assert isinstance(plan(problem("Jar001.Weight <= 3", structs.replace(WEIGH, precondition=None), map=weighed)), NoPlan)


def test_what_nobody_can_find_out_is_said() -> None:
    unknown = refused(problem("Jar002 isOn Platform001", TRANSFER, unknown="Jar002")).explanation
    assert unknown == (
        "Jar002 isOn Platform001: the place and state of Jar002 are unknown; "
        "RecognizeSituation, which no device offers now, could find it out"
    )
    no_scale = structs.replace(problem("Jar001 isOn Platform001", CARRY_LIGHT), ontology=laboratory().extended([WEIGH]))
    assert (
        "Jar001.Weight is not known; WeighObject or Weigh, which no device offers now, could find it out" in refused(no_scale).explanation
    )


def test_who_found_nothing_is_not_asked_again_but_others_are() -> None:
    stated = problem("Jar002 isOn Platform001", LOOK, TRANSFER, unknown="Jar002")
    fruitless = structs.replace(stated, fruitless=frozenset({("Robot1", "RecognizeSituation(Object: Jar002)")}))
    assert "Robot1 could not find it out" in refused(fruitless).explanation
    elsewhere = structs.replace(stated, fruitless=frozenset({("Robot1", "RecognizeSituation(Object: Jar001)")}))
    assert len(planned(elsewhere).steps) == 2
    others = structs.replace(fruitless, services=(AvailableService(LOOK, ("Robot1", "Camera1")), *stated.services[1:]))
    assert len(planned(others).steps) == 2


# Outputs


def test_an_output_stands_for_an_object_that_later_steps_use() -> None:
    result = planned(problem("Jar001 isOn ?Place AND ?Place isFreeFor Jar001", PICK_PLACE, STORE))
    assert names(result) == ["PickPlace(Object: Jar001)", "Store(Object: Jar001, Place: Some-Place)"]
    assert executed(result) == ["PickPlace(Object: Jar001)"]
    assert str(result.steps[0].effect) == "?Place isFreeFor Jar001"
    assert str(result.steps[0].assumed) == "Some-Place isFreeFor Jar001"


def test_an_output_is_used_only_after_the_service_that_makes_it() -> None:
    result = planned(problem("Jar001 isOn ?Place AND ?Place isFreeFor Jar001", PICK_PLACE, TRANSFER))
    assert [step.service_type for step in result.steps] == ["PickPlace", "TransferObject"]
    assert result.predecessors("step2") == ("step1",)


def test_an_output_is_made_by_its_service_and_not_looked_for() -> None:
    held = MAP.changed([FactRemoved(fact) for fact in FACTS if fact.arguments[0] == "Jar001"])
    result = planned(problem("Jar001 isOn ?Place AND ?Place isFreeFor Jar001", LOOK, PICK_PLACE, TRANSFER, map=held))
    assert {step.service_type for step in result.steps if "Some-Place" in map(str, step.inputs.values())} == {"TransferObject"}
    held = held.changed([FactAdded(Fact("isHeldBy", ("Jar001", "Robot1")))])
    for goal in ("Jar001 isOn Platform001", "Jar001 isOn ?Place AND ?Place isFreeFor Jar001"):
        assert isinstance(plan(problem(goal, LOOK, PICK_PLACE, TRANSFER, map=held)), NoPlan), "nobody can take it out of the gripper"


def test_the_place_of_a_kind_that_a_physical_service_chooses_satisfies_a_goal_that_leaves_it_open() -> None:
    result = planned(problem('Jar001.Label = "stored"', RACK))
    assert names(result) == ["PutIntoRack(Object: Jar001)"]
    assert isinstance(plan(problem("Jar001 isOn Shelf2", RACK)), NoPlan), "which shelf it will be is not known"
    moved = planned(problem('Jar001.Label = "stored" AND Jar001 isOn Platform001', RACK, TRANSFER))
    assert [step.service_type for step in moved.steps] == ["PutIntoRack", "TransferObject"]


def test_things_that_nobody_has_seen_yet_may_be_found() -> None:
    empty = MAP.changed([FactRemoved(fact) for fact in FACTS if fact.relation == "isOn"])
    stated = problem("?It: Jar isOn Platform001", FIND_JARS, TRANSFER, map=empty)
    result = planned(stated)
    assert result.steps[0].service_type == "FindJars"
    assert len(executed(result)) == 1


def code_services(kind: ServiceKind, type: str, attribute: str) -> tuple[ServiceType, ServiceType]:
    """A service whose output is a value of the attribute, and one that takes this value as an input."""
    tell = ServiceType(
        name="Tell", kind=kind, inputs=(OBJECT,), outputs=(Parameter(name="Value", type=type),), effect=f"?Object.{attribute} = ?Value"
    )
    use = ServiceType(
        name="Mark",
        inputs=(OBJECT, Parameter(name="Mark", type=type)),
        precondition=f"?Object.{attribute} = ?Mark",
        effect='?Object.Texture = "marked"',
    )
    return tell, use


@pytest.mark.parametrize("kind", ServiceKind)
@pytest.mark.parametrize(("type", "attribute"), [("text", "Label"), ("number", "Weight")])
def test_a_value_that_is_told_is_the_input_of_a_later_step(kind: ServiceKind, type: str, attribute: str) -> None:
    services = code_services(kind, type, attribute)
    result = planned(problem('Jar001.Texture = "marked"', *services))
    tell, mark = result.steps
    assert (tell.service_type, mark.service_type) == ("Tell", "Mark")
    assert executed(result) == ["Tell(Object: Jar001)"]
    assert str(tell.assumed) == f"Jar001.{attribute} = {mark.inputs['Mark']}"
    assert result.predecessors(mark.id) == (tell.id,)
    value = "fragile" if type == "text" else 2.5
    told = MAP.changed([ValueSet("Jar001", attribute, value)])
    (completed,) = planned(problem('Jar001.Texture = "marked"', *services, map=told)).steps
    assert completed.service_type == "Mark"
    assert str(completed.inputs["Mark"]) == ('"fragile"' if type == "text" else "2.5 kg")


def test_a_value_of_which_nothing_is_said_is_named_as_the_reason_for_no_plan() -> None:
    tell, mark = code_services(ServiceKind.SOFTWARE, "text", "Label")
    vague = structs.replace(mark, inputs=(*mark.inputs, Parameter(name="Note", type="text")))
    explanation = refused(problem('Jar001.Texture = "marked"', tell, vague)).explanation
    assert "Mark could bring about" in explanation
    assert "nothing says which value its input ?Note has" in explanation


def test_a_value_that_a_step_sets_is_the_input_of_a_later_step() -> None:
    _, mark = code_services(ServiceKind.PHYSICAL, "text", "Label")
    label = ServiceType(name="Label", inputs=(OBJECT,), effect='?Object.Label = "fragile"')
    result = planned(problem('Jar001.Texture = "marked"', label, mark))
    assert names(result) == ["Label(Object: Jar001)", 'Mark(Object: Jar001, Mark: "fragile")']


def test_each_use_of_a_service_has_an_output_of_its_own() -> None:
    goal = "Jar001 isOn ?Place AND ?Place isFreeFor Jar001 AND Jar002 isOn ?Other AND ?Other isFreeFor Jar002"
    result = planned(problem(goal, PICK_PLACE, STORE))
    places = {str(step.inputs["Object"]): str(step.inputs["Place"]) for step in result.steps if step.service_type == "Store"}
    assert set(places.values()) == {"Some-Place", "Some-Place-2"}
    assert {str(step.assumed) for step in result.steps if step.tells} == {f"{place} isFreeFor {jar}" for jar, place in places.items()}


PAINT = ServiceType(
    name="Paint",
    inputs=(OBJECT, Parameter(name="Text", type="text")),
    precondition="?Object isOn ?Source",
    effect="?Object.Label = ?Text",
)


@pytest.mark.parametrize("goal", ["Jar001 isOn ?P: Support", "Jar001 isOn ?P: Shelf", "?J: Jar isOn ?P: Shelf AND ?J != Jar002"])
@pytest.mark.parametrize("services", [(PICK_PLACE, SEE), (RACK, SEE), (LOOK, PICK_PLACE, FIND_JARS, RACK, SEE, PAINT)])
def test_what_a_known_place_is_enough_for_needs_no_output(goal: str, services: tuple[ServiceType, ...]) -> None:
    (step,) = names(planned(problem(goal, *services, unknown="Jar001")))
    assert "Some-" not in step


def test_one_step_is_enough_where_another_object_would_need_two() -> None:
    goal = "?J: Jar.Label = ?T AND Jar002 isOn Shelf1"
    assert names(planned(problem(goal, RACK, TRANSFER))) == ["PutIntoRack(Object: Jar001)"]


def test_a_plan_of_several_steps_has_no_output_more_than_it_needs() -> None:
    goal = "Jar001 isOn ?P: Support AND Jar001.Clean = TRUE"
    steps = names(planned(problem(goal, SEE, PICK_PLACE, WASH, unknown="Jar001")))
    assert steps[:2] == ["SeeWhetherOn(Thing: Jar001, Place: Washer1)", "WashJar(Jar: Jar001) by Washer1"]
    assert len(steps) == 3
    assert "Some-" not in steps[2]
