"""Numbers in tasks: tests that are settled before the search, values that services set, and counters such as a battery."""

from __future__ import annotations

import pytest

from somrs.entish import Formula
from somrs.entish.parse import parse
from somrs.ontology.check import check
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, FunctionType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.planning import plan
from tests.support.sound_plans import make_sound_plan

ONTOLOGY: Ontology = upper().extended(
    [
        AttributeType(name="Charge", kind=Kind.NUMBER, unit="%", minimum=0, maximum=100),
        AttributeType(name="Consumption", kind=Kind.NUMBER, unit="%/m"),
        AttributeType(name="Charger", kind=Kind.TRUTH),
        AttributeType(name="Count", kind=Kind.NUMBER),
        AttributeType(name="Closed", kind=Kind.TRUTH),
        AttributeType(name="Reach", kind=Kind.NUMBER, unit="m"),
        AttributeType(name="Capacity", kind=Kind.NUMBER, unit="kg"),
        AttributeType(name="Level", kind=Kind.NUMBER, unit="cm", tolerance=0.5),
        FunctionType(name="reach", parameters=("Device",), attribute="Reach"),
        FunctionType(name="capacity", parameters=("Device",), attribute="Capacity"),
        ObjectType(name="Rover", parent="MobileRobot", attributes=("Charge", "Consumption", "Reach", "Capacity"), required=()),
        ObjectType(name="Hall", parent="Room", attributes=("Charger", "PositionX", "PositionY")),
        ObjectType(name="Box", parent="Graspable", attributes=("Count", "Level", "Closed")),
        RelationType(name="isInside", joins=("Device", "Space"), functional=True),
        RelationType(name="leads", joins=("Space", "Space")),
    ]
)
DRIVE = ServiceType(
    name="DriveTo",
    inputs=(Parameter(name="To", type="Space"),),
    precondition="?Provider isInside ?From AND leads(?From, ?To) AND ?Provider.Charge >= 20 %",
    effect="?Provider isInside ?To AND ?Provider.Charge = ?Provider.Charge - 20 %",
)
FAR = ServiceType(
    name="DriveFar",
    inputs=(Parameter(name="To", type="Space"),),
    precondition="?Provider isInside ?From AND leads(?From, ?To) AND ?Provider.Charge >= ?Provider.Consumption * distance(?From, ?To)",
    effect="?Provider isInside ?To AND ?Provider.Charge = ?Provider.Charge - ?Provider.Consumption * distance(?From, ?To)",
)
RECHARGE = ServiceType(
    name="Recharge",
    precondition="?Provider isInside ?Room AND ?Room.Charger = TRUE",
    effect="?Provider.Charge = 100 %",
)


FILL = ServiceType(name="Fill", inputs=(Parameter(name="Box", type="Box"),), effect="?Box.Count = ?Box.Count + 1")


def corridor(length: int, charge: float, charger: int = 2) -> Map:
    """Halls in a row, ten metres apart, one with a charger; a robot in the first."""
    halls = [
        Object(name=f"Hall{n}", type="Hall", values={"Charger": n == charger, "PositionX": 10.0 * n, "PositionY": 0.0})
        for n in range(length)
    ]
    ways = [Fact("leads", (f"Hall{source}", f"Hall{target}")) for n in range(length - 1) for source, target in ((n, n + 1), (n + 1, n))]
    robot = Object(name="Robot1", type="Rover", values={"Charge": charge, "Consumption": 1.5})
    return Map([*halls, robot], [Fact("isInside", ("Robot1", "Hall0")), *ways])


def make_problem(map: Map, goal: str, *services: ServiceType) -> Problem:
    for service in services:
        types = {parameter.name: parameter.type for parameter in service.inputs} | {"Provider": "Rover"}
        for text in (service.precondition, service.effect):
            if text is not None:
                check(text, ONTOLOGY, map, types)
    return Problem(
        ontology=ONTOLOGY, map=map, goal=check(goal, ONTOLOGY, map), services=tuple(AvailableService(s, ("Robot1",)) for s in services)
    )


def planned(problem: Problem) -> list[str]:
    return [str(step).removesuffix(" by Robot1") for step in make_sound_plan(problem).steps]


def test_a_robot_recharges_to_get_there() -> None:
    assert planned(make_problem(corridor(6, 60), "Robot1 isInside Hall5", DRIVE, RECHARGE)) == [
        "DriveTo(To: Hall1)",
        "DriveTo(To: Hall2)",
        "Recharge()",
        "DriveTo(To: Hall3)",
        "DriveTo(To: Hall4)",
        "DriveTo(To: Hall5)",
    ]


def test_a_robot_with_enough_does_not_recharge() -> None:
    assert "Recharge()" not in planned(make_problem(corridor(6, 100), "Robot1 isInside Hall5", DRIVE, RECHARGE))


def test_a_charger_out_of_reach_is_no_help() -> None:
    result = plan(make_problem(corridor(6, 35), "Robot1 isInside Hall5", DRIVE, RECHARGE))
    assert isinstance(result, NoPlan)
    assert not result.undecided
    assert "DriveTo could bring about Robot1 isInside Hall5, but needs" in result.explanation
    assert "?From leads Hall5, and no order of services leads to that" in result.explanation


def test_what_is_left_in_the_end_can_be_wished_for() -> None:
    steps = planned(make_problem(corridor(6, 100), "Robot1 isInside Hall5 AND Robot1.Charge >= 40 %", DRIVE, RECHARGE))
    assert steps.count("Recharge()") == 1
    assert steps.index("Recharge()") == 2


def test_a_way_costs_what_it_is_long() -> None:
    problem = make_problem(corridor(9, 40), "Robot1 isInside Hall8", FAR, RECHARGE)
    assert planned(problem).index("Recharge()") == 2
    assert isinstance(plan(make_problem(corridor(11, 40), "Robot1 isInside Hall10", FAR, RECHARGE)), NoPlan), "100 % are for 66 m"


def test_the_steps_say_what_is_left_after_them() -> None:
    result = plan(make_problem(corridor(3, 60), "Robot1 isInside Hall2", DRIVE, RECHARGE))
    assert isinstance(result, Plan)
    assert [str(step.effect) for step in result.steps] == [
        "Robot1 isInside Hall1 AND Robot1.Charge = 40 %",
        "Robot1 isInside Hall2 AND Robot1.Charge = 20 %",
    ]
    assert "Robot1.Charge = 40 %" in {link.fact for link in result.links}


def test_a_counter_without_an_end_counts_as_far_as_it_has_to() -> None:
    map = Map([Object(name="Box1", type="Box", values={"Count": 2.0}), Object(name="Robot1", type="Rover")])
    assert planned(make_problem(map, "Box1.Count = 5", FILL)) == ["Fill(Box: Box1)"] * 3


def test_two_counters_without_an_end_are_made_the_same() -> None:
    pair = ServiceType(
        name="Pair",
        inputs=(Parameter(name="Box", type="Box"), Parameter(name="Other", type="Box")),
        precondition="?Box.Count = ?Other.Count + 1 AND ?Box != ?Other",
        effect="?Other.Closed = TRUE AND ?Box.Closed = TRUE",
    )
    boxes = [Object(name=f"Box{n}", type="Box", values={"Count": float(n)}) for n in (1, 4)]
    map = Map([*boxes, Object(name="Robot1", type="Rover")])
    steps = planned(make_problem(map, "Box1.Closed = TRUE AND Box1.Count >= 4", FILL, pair))
    assert steps.count("Fill(Box: Box1)") >= 3
    assert any(step.startswith("Pair") for step in steps)


@pytest.mark.parametrize(("goal", "count"), [("Box1.Level = 12.4 cm", 0), ("Box1.Level = 125 mm", 0), ("Box1.Level = 13 cm", 1)])
def test_numbers_are_the_same_within_the_tolerance_of_their_attribute(goal: str, count: int) -> None:
    pour = ServiceType(
        name="Pour",
        inputs=(Parameter(name="Box", type="Box"), Parameter(name="Height", type="number")),
        effect="?Box.Level = ?Height",
    )
    map = Map([Object(name="Box1", type="Box", values={"Level": 12.0}), Object(name="Robot1", type="Rover")])
    assert len(planned(make_problem(map, goal, pour))) == count


def test_what_does_not_change_is_settled_before_the_search() -> None:
    carry = ServiceType(
        name="Carry",
        inputs=(Parameter(name="Box", type="Box"), Parameter(name="To", type="Shelf")),
        precondition="?Box isOn ?From AND ?Box.Weight <= capacity(?Provider) AND distance(?From, ?To) <= reach(?Provider)",
        effect="?Box isOn ?To",
    )
    shelves = [Object(name=f"Shelf{n}", type="Shelf", values={"PositionX": 2.5 * n, "PositionY": 0.0}) for n in range(4)]
    robots = [
        Object(name="Robot1", type="Rover", values={"Capacity": 5.0, "Reach": 3.0}),
        Object(name="Robot2", type="Rover", values={"Capacity": 1.0, "Reach": 9.0}),
    ]
    for weight, expected in ((0.5, 1), (3.0, 3)):
        box = Object(name="Box1", type="Box", values={"Weight": weight})
        map = Map([*shelves, *robots, box], [Fact("isOn", ("Box1", "Shelf0"))])
        goal: Formula = parse("Box1 isOn Shelf3")
        problem = Problem(ontology=ONTOLOGY, map=map, goal=goal, services=(AvailableService(carry, ("Robot1", "Robot2")),))
        assert len(planned(problem)) == expected


def test_decimals_are_counted_as_they_are_written() -> None:
    sip = ServiceType(
        name="Sip",
        inputs=(Parameter(name="Box", type="Box"),),
        precondition="?Box.Count >= 0.1",
        effect="?Box.Count = ?Box.Count - 0.1",
    )
    map = Map([Object(name="Box1", type="Box", values={"Count": 0.3}), Object(name="Robot1", type="Rover")])
    assert len(planned(make_problem(map, "Box1.Count = 0", sip))) == 3


@pytest.mark.parametrize("length", [3, 5])
@pytest.mark.parametrize("charge", [10.0, 40.0, 60.0, 100.0])
@pytest.mark.parametrize("charger", [0, 1, 4])
def test_counting_finds_what_listing_the_values_finds(length: int, charge: float, charger: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for service in (DRIVE, FAR):
        problem = make_problem(corridor(length, charge, charger), f"Robot1 isInside Hall{length - 1}", service, RECHARGE)
        listed = plan(problem)
        monkeypatch.setattr("somrs.planner.planning.VALUES", 0)
        monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
        if isinstance(listed, Plan):
            assert len(planned(problem)) <= len(listed.steps) + 2
        else:
            assert isinstance(plan(problem), NoPlan)
        monkeypatch.undo()
