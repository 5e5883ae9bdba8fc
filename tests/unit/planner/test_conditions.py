"""Plans with the conditions that services stated when they were asked for a step."""

from __future__ import annotations

import pytest

from somrs.entish import Name, Number
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactAdded, Object, ObjectAdded, ValueSet
from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.ontology.types import ObjectType
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import AvailableService, Problem, StepBid
from somrs.planner.model.validation import validate
from somrs.planner.planning import plan, plan_quickly
from tests.support.laboratory import FACTS, LABEL, MAP, OPEN, TRANSFER, laboratory

GOAL = "Jar001 isOn Shelf2"
INPUTS = (("Object", Name("Jar001")), ("Destination", Name("Shelf2")))


def bid(provider: str, price: float | None, condition: str | None = None, inputs: tuple[tuple[str, Name], ...] = INPUTS) -> StepBid:
    return StepBid(
        service_type="TransferObject",
        inputs=inputs,
        provider=provider,
        service=f"{provider}.TransferObject",
        condition=parse(condition) if condition is not None else None,
        price=price,
    )


def problem(
    *bids: StepBid, goal: str = GOAL, opening: float = 1.0, carriers: tuple[str, ...] = ("Robot1", "Robot2"), **fields: object
) -> Problem:
    services = (
        AvailableService(OPEN, ("Porter1",), (("Porter1", opening),)),
        AvailableService(TRANSFER, carriers, tuple((name, 5.0) for name in carriers)),
    )
    map = MAP.changed([ValueSet("DoorAB", "Open", False)])
    return Problem(ontology=laboratory(), map=map, goal=parse(goal), services=services, bids=bids, **fields)  # type: ignore[arg-type]


def steps(problem: Problem) -> list[str]:
    result = plan(problem)
    assert isinstance(result, Plan), result
    return [f"{step}{f' if {step.condition}' if step.condition is not None else ''}" for step in result.steps]


OPENED = "OpenDoor(Door: DoorAB)"
CARRIED = "TransferObject(Object: Jar001, Destination: Shelf2)"
DOOR_OPEN = "DoorAB.Open = TRUE"


def test_without_bids_nothing_is_demanded() -> None:
    assert steps(problem()) == [CARRIED]


def test_a_condition_of_all_providers_is_made_true_first() -> None:
    task = problem(bid("Robot1", 4.0, DOOR_OPEN), bid("Robot2", 6.0, DOOR_OPEN))
    assert steps(task) == [OPENED, f"{CARRIED} if {DOOR_OPEN}"]
    result = plan(task)
    assert isinstance(result, Plan)
    assert [(link.before, link.after, link.fact) for link in result.links] == [("step1", "step2", DOOR_OPEN)]
    assert validate(result, task) == [], "it is a plan of the original problem"
    assert DOOR_OPEN in str(result.steps[1].precondition)


@pytest.mark.parametrize(("opening", "expected"), [(1.0, [OPENED, f"{CARRIED} if {DOOR_OPEN}"]), (10.0, [CARRIED])])
def test_the_total_decides_between_a_condition_and_a_higher_price(opening: float, expected: list[str]) -> None:
    assert steps(problem(bid("Robot1", 4.0, DOOR_OPEN), bid("Robot2", 12.0), opening=opening)) == expected


def test_of_two_conditions_the_cheaper_one_is_made_true() -> None:
    task = problem(bid("Robot1", 4.0, "Robot1 isInside RoomB"), bid("Robot2", 6.0, DOOR_OPEN))
    assert steps(task) == [OPENED, f"{CARRIED} if {DOOR_OPEN}"], "no service moves Robot1"


def test_a_condition_that_holds_costs_nothing() -> None:
    assert steps(problem(bid("Robot1", 4.0, "DoorAB.Open = FALSE"), bid("Robot2", 6.0))) == [f"{CARRIED} if DoorAB.Open = FALSE"]


def test_a_condition_that_holds_no_more_is_not_kept_with_the_rest_of_a_plan() -> None:
    """The services answered when the door was to be opened. It is shut, and they are asked again: they may know better than the map."""
    first = plan(problem(bid("Robot1", 4.0, DOOR_OPEN), bid("Robot2", 6.0, DOOR_OPEN)))
    assert isinstance(first, Plan)
    for promised in frozenset[str](), frozenset({"step2"}):
        assert steps(problem(rest=first.steps[1:], promised=promised)) == [CARRIED]


def test_a_service_that_was_not_asked_may_do_it_without_a_condition() -> None:
    assert steps(problem(bid("Robot1", None, DOOR_OPEN), opening=50.0)) == [CARRIED]
    assert steps(problem(bid("Robot1", None, DOOR_OPEN), carriers=("Robot1",), opening=50.0)) == [OPENED, f"{CARRIED} if {DOOR_OPEN}"]


def test_other_uses_of_the_service_are_as_before() -> None:
    other = (("Object", Name("Jar002")), ("Destination", Name("Shelf2")))
    goal = "Jar001 isOn Shelf2 AND Jar002 isOn Shelf2"
    assert sorted(steps(problem(bid("Robot1", 4.0, DOOR_OPEN, other), goal=goal, carriers=("Robot1",)))) == [
        OPENED,
        "TransferObject(Object: Jar001, Destination: Shelf2)",
        f"TransferObject(Object: Jar002, Destination: Shelf2) if {DOOR_OPEN}",
    ]


def test_many_requests_with_the_same_condition_share_the_step_that_makes_it_true() -> None:
    jars = {f"Jar{n}": Object(name=f"Jar{n}", type="Jar") for n in range(20)}
    door = Object(name="DoorAB", type="Door", values={"Open": False})
    facts = [*MAP.facts(), *(type(FACTS[0])("isOn", (jar, "Shelf1")) for jar in jars)]
    map = Map([*MAP.objects.values(), *jars.values(), door], facts)
    bids = tuple(bid("Robot1", 4.0, DOOR_OPEN, (("Object", Name(jar)), ("Destination", Name("Shelf2")))) for jar in jars)
    task = problem(*bids, goal=" AND ".join(f"{jar} isOn Shelf2" for jar in jars), carriers=("Robot1",))
    result = plan_quickly(Problem(ontology=task.ontology, map=map, goal=task.goal, services=task.services, bids=task.bids)) or plan(
        Problem(ontology=task.ontology, map=map, goal=task.goal, services=task.services, bids=task.bids)
    )
    assert isinstance(result, Plan), result
    assert len(result.steps) == 21
    assert sum(step.service_type == "OpenDoor" for step in result.steps) == 1


def test_a_condition_that_nothing_makes_true_is_explained() -> None:
    result = plan(problem(bid("Robot1", 4.0, "Robot1 isInside RoomB"), carriers=("Robot1",)))
    assert isinstance(result, NoPlan)
    assert "TransferObject(Jar001, Shelf2) by Robot1, if Robot1 isInside RoomB" in result.explanation
    assert "isRequested" not in result.explanation


def test_inputs_that_are_values_are_told_apart() -> None:
    inputs = (("Jar", Name("Jar001")), ("Level", Number(5.0)))
    fill = ServiceType(
        name="Fill", inputs=(Parameter(name="Jar", type="Jar"), Parameter(name="Level", type="number")), effect="?Jar.Weight = ?Level"
    )
    condition = StepBid(service_type="Fill", inputs=inputs, provider="Robot1", service="Robot1.Fill", condition=parse(DOOR_OPEN), price=1.0)
    base = problem(carriers=("Robot1",))
    services = (*base.services, AvailableService(fill, ("Robot1",)))

    def of(goal: str) -> list[str]:
        task = Problem(ontology=base.ontology, map=base.map, goal=parse(goal), services=services, bids=(condition,))
        return [step.partition("(")[0] for step in steps(task)]

    assert of("Jar001.Weight = 5") == ["OpenDoor", "Fill"]
    assert of("Jar001.Weight = 7") == of("Jar002.Weight = 5") == ["Fill"]


def test_a_service_type_without_inputs() -> None:
    ring = ServiceType(name="Ring", effect='Washer1.Label = "rings"')
    condition = StepBid(service_type="Ring", inputs=(), provider="Robot1", service="Robot1.Ring", condition=parse(DOOR_OPEN))
    base = problem(carriers=("Robot1",))
    task = Problem(
        ontology=base.ontology,
        map=base.map,
        goal=parse('Washer1.Label = "rings"'),
        services=(*base.services, AvailableService(ring, ("Robot1",))),
        bids=(condition,),
    )
    assert steps(task) == [OPENED, f"Ring() if {DOOR_OPEN}"]
    assert LABEL.inputs


WEIGH = ServiceType(
    name="Weigh",
    kind=ServiceKind.COGNITIVE,
    inputs=(Parameter(name="Object", type="Graspable"),),
    outputs=(Parameter(name="Weight", type="number"),),
    effect="?Object.Weight = ?Weight",
)


@pytest.mark.parametrize(
    ("helper", "expected"),
    [
        (2.0, ["TransferObject(Object: Parcel001, Destination: Shelf2)"]),
        (20.0, ["Weigh(Object: Parcel001)", "TransferObject(Object: Parcel001, Destination: Shelf2) if Parcel001.Weight <= 2"]),
    ],
)
def test_a_condition_about_what_is_not_known_is_found_out_if_that_is_better_than_doing_without(helper: float, expected: list[str]) -> None:
    inputs = (("Object", Name("Parcel001")), ("Destination", Name("Shelf2")))
    base = problem(carriers=("Robot1", "Robot2"))
    task = Problem(
        ontology=base.ontology.extended([ObjectType(name="Parcel", parent="Graspable")]),
        map=base.map.changed([ObjectAdded(Object(name="Parcel001", type="Parcel")), FactAdded(Fact("isOn", ("Parcel001", "Shelf1")))]),
        goal=parse("Parcel001 isOn Shelf2"),
        services=(*base.services, AvailableService(WEIGH, ("Scale1",), (("Scale1", 1.0),))),
        bids=(bid("Robot1", 5.0, "Parcel001.Weight <= 2", inputs), bid("Robot2", helper, None, inputs)),
    )
    assert plan_quickly(task) is None, "whether to find it out takes a comparison"
    assert steps(task) == expected
