"""Why there is no plan: the smallest part of the goal that cannot be, what is missing for it, or how far the search got."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec import structs

from somrs.entish.parse import parse
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object, ObjectAdded, ValueSet
from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.plan import NoPlan, Obstacle
from somrs.planner.model.problem import AvailableService, LostService, Problem
from somrs.planner.planning import plan, plan_quickly
from tests.integration.test_planner_engine import tower
from tests.support.laboratory import DRIVE, FACTS, LABEL, MAP, TRANSFER, WASH, laboratory, make_problem

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
    offered = (AvailableService(STRIKE, ("Robot1", "Robot2")), AvailableService(UNLOCK, ("Robot1",)))
    return Problem(ontology=CELLAR, map=map, goal=parse(goal), services=offered, excluded=excluded)


def refused(problem: Problem) -> NoPlan:
    result = plan(problem)
    assert isinstance(result, NoPlan), result
    return result


def test_of_a_long_wish_the_two_parts_that_exclude_each_other_are_named() -> None:
    wish = "Jar002 isOn Platform001 AND Jar001 isOn Shelf2 AND Jar002.Clean = TRUE AND Jar001 isOn Platform001"
    result = refused(make_problem(wish, TRANSFER, WASH))
    assert set(result.unreachable) == {"Jar001 isOn Shelf2", "Jar001 isOn Platform001"}
    assert "Jar001 would be in two places at a time" in result.explanation
    assert result.obstacles == (Obstacle.TWO_PLACES,)
    assert not result.undecided


def test_parts_that_use_up_the_same_thing_are_named() -> None:
    result = refused(cellar("Lamp1.Lit = TRUE AND Door1.Open = FALSE AND Lamp3.Lit = TRUE"))
    assert set(result.unreachable) == {"Lamp1.Lit = TRUE", "Lamp3.Lit = TRUE"}
    assert "can each be brought about, but not all together" in result.explanation
    assert plan(cellar("Lamp1.Lit = TRUE AND Door1.Open = FALSE AND Lamp3.Lit = TRUE", ("Robot1", "Robot2"))) != result


def test_one_part_that_no_order_of_services_makes_true_is_explained_by_what_it_needs() -> None:
    result = refused(cellar("Door1.Open = TRUE"))
    assert result.unreachable == ("Door1.Open = TRUE",)
    conflict_text = "Lamp1.Lit = TRUE and Lamp2.Lit = TRUE"
    assert (
        f"OpenDoor could bring about Door1.Open = TRUE, but needs {conflict_text}, and no order of services leads to that"
        in result.explanation
    )
    assert result.missing == (conflict_text,)


def test_a_provider_that_is_taken_is_named() -> None:
    result = refused(cellar("Lamp1.Lit = TRUE", ("Robot1", "Robot2"), frozenset({"Robot1", "Robot2"})))
    assert "could be brought about by LightLamp, but Robot1 and Robot2 are reserved by other tasks" in result.explanation
    assert result.unoffered == ()
    assert result.obstacles == (Obstacle.PROMISED,)


def test_what_is_too_large_is_not_said_to_be_impossible(monkeypatch: pytest.MonkeyPatch) -> None:
    jars = [Object(name=f"Jar{n:03}", type="Jar") for n in range(3, 40)]
    problem = make_problem("Jar001 isOn Shelf1 AND Shelf2 isOn Shelf1", TRANSFER)
    large_problem = Problem(
        ontology=problem.ontology,
        map=Map([*problem.map.objects.values(), *jars], [*problem.map.facts(), *(Fact("isOn", (jar.name, "Shelf2")) for jar in jars)]),
        goal=parse("NOT ?x: Jar isOn Shelf2 AND NOT ?x: Jar isOn Shelf1"),
        services=problem.services,
    )
    for effort in ("EFFORT", "QUICK_EFFORT"):
        monkeypatch.setattr(f"somrs.planner.planning.{effort}", 50)
    result = refused(large_problem)
    assert result.undecided
    assert "too large to be searched: there are too many ways to use services" in result.explanation
    assert result.unreachable == ()


def test_values_that_nobody_named_leave_it_open_whether_there_is_a_plan() -> None:
    ship = ServiceType(
        name="Ship", inputs=(Parameter(name="Jar", type="Jar"),), precondition='?Jar.Label != "none"', effect="?Jar.Shipped = TRUE"
    )
    ontology = laboratory().extended(
        [AttributeType(name="Shipped", kind=Kind.TRUTH), ObjectType(name="Jar", parent="Graspable", attributes=("Clean", "Shipped"))]
    )
    problem = make_problem("Jar001.Shipped = TRUE", LABEL, WASH, TRANSFER)
    result = refused(
        Problem(ontology=ontology, map=problem.map, goal=problem.goal, services=(*problem.services, AvailableService(ship, ("Robot1",))))
    )
    assert result.undecided
    assert "a number or text as input" in result.explanation


def test_a_search_that_was_not_finished_says_how_far_it_got() -> None:
    result = refused(tower(40))
    assert result.undecided
    assert "states were looked at; at best" in result.explanation
    assert "of the goal's 39 parts held at once" in result.explanation


def test_at_once_nothing_is_said_to_be_impossible() -> None:
    """A short match finds plans only; that there is none, a search has to show."""
    assert plan_quickly(cellar("Lamp1.Lit = TRUE")) is not None
    assert plan_quickly(cellar("Lamp1.Lit = TRUE AND Lamp3.Lit = TRUE")) is None


JAR_IS_NOWHERE = Map(MAP.objects.values(), [fact for fact in FACTS if fact.arguments[0] != "Jar001"])
SHUT = MAP.changed([ValueSet("DoorAB", "Open", False)])
WRITE = ServiceType(name="Write", inputs=WASH.inputs, precondition="?Jar.Clean = TRUE", effect='?Jar.Label = "a"')
READ = ServiceType(name="Read", inputs=WASH.inputs, precondition='?Jar.Label = "a"', effect="?Jar.Clean = TRUE")
NOWHERE = "and the map does not say where Jar001 is"
DENIED = "does not hold on the map, and no service type brings it about"
GOAL = "Jar001 isOn Platform001"


def missed(goal: str, *losses: tuple[ServiceType, str, str], services: tuple[ServiceType, ...] = ()) -> Problem:
    """A problem for which these services are lost."""
    problem = make_problem(goal, *services)
    lost = tuple(LostService(*loss) for loss in losses)
    return Problem(ontology=problem.ontology, map=problem.map, goal=problem.goal, services=problem.services, lost=lost)


def test_devices_that_an_operator_lets_begin_no_work_are_named() -> None:
    resting = tuple(LostService(TRANSFER, f"Robot{n}.TransferObject", f"Robot{n} is out of service") for n in range(1, 5))
    result = plan(structs.replace(make_problem(GOAL), resting=resting[:1]))
    assert isinstance(result, NoPlan)
    text = f"{GOAL} could be brought about by TransferObject, which no device offers now"
    assert result.separate_reasons == (f"{text} (Robot1 is out of service)",)
    assert result.unoffered == ("TransferObject",)
    result = plan(structs.replace(make_problem(GOAL), resting=resting))
    assert isinstance(result, NoPlan)
    assert result.separate_reasons == (f"{text} (Robot1 is out of service; Robot2 is out of service; 2 more would, too)",)


@pytest.mark.parametrize(
    ("problem", "reasons", "rest"),
    [
        (
            make_problem("Jar001.Clean = TRUE", TRANSFER),
            [f"Jar001.Clean = TRUE {DENIED}"],
            {"missing": ("Jar001.Clean = TRUE",), "obstacles": (Obstacle.NO_SERVICE_TYPE,)},
        ),
        (
            make_problem(GOAL),
            [f"{GOAL} could be brought about by TransferObject, which no device offers now"],
            {"unoffered": ("TransferObject",), "obstacles": (Obstacle.NOT_OFFERED,)},
        ),
        (
            make_problem("Shelf1 isOn Platform001", TRANSFER),
            [f"Shelf1 isOn Platform001 {DENIED}: TransferObject takes only a Graspable as its Object, and Shelf1 is a Shelf"],
            {"missing": ("Shelf1 isOn Platform001",), "obstacles": (Obstacle.NO_SERVICE_TYPE,)},
        ),
        (
            make_problem("Zzzzzzzzzz isOn Shelf1", TRANSFER),
            ["Zzzzzzzzzz isOn Shelf1: there is no object Zzzzzzzzzz on the map"],
            {"obstacles": (Obstacle.NO_OBJECT,)},
        ),
        (
            make_problem("Jar009 isOn Shelf1", TRANSFER),
            ["Jar009 isOn Shelf1: there is no object Jar009 on the map; did you mean Jar002 or Jar001?"],
            {"obstacles": (Obstacle.NO_OBJECT,)},
        ),
        (
            make_problem(GOAL, TRANSFER, excluded=frozenset({"Platform001"})),
            [f"{GOAL}: Platform001 is reserved by another task"],
            {"obstacles": (Obstacle.PROMISED,)},
        ),
        (
            structs.replace(make_problem(GOAL, TRANSFER, excluded=frozenset({"Platform001"})), unknown=frozenset({"Platform001"})),
            [f"{GOAL}: the place and state of Platform001 are unknown; RecognizeSituation, which no device offers now, could find it out"],
            {"obstacles": (Obstacle.NOT_OFFERED, Obstacle.UNKNOWN), "unoffered": ("RecognizeSituation",)},
        ),
        (
            make_problem(GOAL, TRANSFER, excluded=frozenset({"Robot1"})),
            [f"{GOAL} could be brought about by TransferObject, but Robot1 is reserved by another task"],
            {"obstacles": (Obstacle.PROMISED,)},
        ),
        (
            missed(GOAL, (TRANSFER, "s1", "it failed"), (TRANSFER, "s2", "it failed"), (TRANSFER, "s3", "it refused")),
            [f"{GOAL} could be brought about by TransferObject, but no service is left (s1 and s2: it failed; s3: it refused)"],
            {"lost": ("s1", "s2", "s3")},
        ),
        (
            missed("Jar001.Clean = TRUE", (WASH, "w1", "it fell silent"), (TRANSFER, "t1", "it failed"), services=(TRANSFER,)),
            ["Jar001.Clean = TRUE could be brought about by WashJar, but no service is left (w1: it fell silent)"],
            {"lost": ("w1",)},
        ),
        (
            make_problem("Jar001.Clean = TRUE", WASH),
            [
                "WashJar could bring about Jar001.Clean = TRUE, but needs Jar001 isOn Washer1, and the map says Jar001 isOn Shelf1",
                "Jar001 isOn Washer1 could be brought about by TransferObject, which no device offers now",
            ],
            {"missing": ("Jar001 isOn Washer1",), "unoffered": ("TransferObject",), "obstacles": (Obstacle.NOT_OFFERED,)},
        ),
        (
            make_problem('Jar001.Label = "x"', LABEL),
            ['PrintLabel could bring about Jar001.Label = "x", but needs Jar001.Clean = TRUE', f"Jar001.Clean = TRUE {DENIED}"],
            {"missing": ("Jar001.Clean = TRUE",), "obstacles": (Obstacle.NO_SERVICE_TYPE,)},
        ),
        (
            make_problem("Jar001.Clean = TRUE", TRANSFER, WASH, map=JAR_IS_NOWHERE),
            [
                f"WashJar could bring about Jar001.Clean = TRUE, but needs Jar001 isOn Washer1, {NOWHERE}",
                f"TransferObject could bring about Jar001 isOn Washer1, but needs Jar001 isOn ?, {NOWHERE}",
            ],
            {"missing": ("Jar001 isOn Washer1", "Jar001 isOn ?")},
        ),
        (
            make_problem("Robot1 isInside RoomB", DRIVE, map=SHUT),
            [
                "DriveTo could bring about Robot1 isInside RoomB, but needs DoorAB.Open = TRUE",
                "DoorAB.Open = TRUE could be brought about by OpenDoor, which no device offers now",
            ],
            {"missing": ("DoorAB.Open = TRUE",), "unoffered": ("OpenDoor",), "obstacles": (Obstacle.NOT_OFFERED,)},
        ),
        (make_problem("Jar001 isOn Jar001", TRANSFER), ["TransferObject has such effects, but not Jar001 isOn Jar001"], {}),
        (
            make_problem("Jar001.Clean = TRUE", READ, WRITE),
            [
                'Read could bring about Jar001.Clean = TRUE, but needs Jar001.Label = "a"',
                'Write could bring about Jar001.Label = "a", but needs Jar001.Clean = TRUE',
            ],
            {"missing": ('Jar001.Label = "a"', "Jar001.Clean = TRUE")},
        ),
        (
            cellar("Door1.Open = TRUE", ()),
            [
                "OpenDoor could bring about Door1.Open = TRUE, but needs Lamp1.Lit = TRUE",
                "LightLamp could bring about Lamp1.Lit = TRUE, but needs hasMatch(Robot1)",
                f"hasMatch(Robot1) {DENIED}",
                "OpenDoor could bring about Door1.Open = TRUE, but needs Lamp2.Lit = TRUE",
            ],
            {"missing": ("Lamp1.Lit = TRUE", "hasMatch(Robot1)", "Lamp2.Lit = TRUE"), "obstacles": (Obstacle.NO_SERVICE_TYPE,)},
        ),
        (
            cellar("Door1.Open = TRUE"),
            [
                "no order of services makes Door1.Open = TRUE true",
                "OpenDoor could bring about Door1.Open = TRUE, but needs Lamp1.Lit = TRUE and Lamp2.Lit = TRUE, "
                "and no order of services leads to that",
            ],
            {"missing": ("Lamp1.Lit = TRUE and Lamp2.Lit = TRUE",)},
        ),
    ],
)
def test_all_that_is_said_of_a_wish_that_nothing_brings_about(
    problem: Problem, reasons: list[str], rest: dict[str, tuple[str, ...]]
) -> None:
    assert refused(problem) == NoPlan(
        explanation="; ".join(reasons),
        separate_reasons=tuple(reasons),
        unreachable=(str(problem.goal),),
        **rest,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("problem", "parts", "cause"),
    [
        (
            make_problem("Jar001 isOn Shelf2 AND Jar002.Clean = TRUE AND Jar001 isOn Platform001", TRANSFER, WASH),
            ("Jar001 isOn Shelf2", "Jar001 isOn Platform001"),
            ": Jar001 would be in two places at a time",
        ),
        (
            cellar("Lamp1.Lit = TRUE AND Door1.Open = FALSE AND Lamp3.Lit = TRUE"),
            ("Lamp1.Lit = TRUE", "Lamp3.Lit = TRUE"),
            ", in no order of services",
        ),
    ],
)
def test_all_that_is_said_of_parts_that_exclude_each_other(problem: Problem, parts: tuple[str, ...], cause: str) -> None:
    explanation = f"{' and '.join(parts)} can each be brought about, but not all together{cause}"
    obstacles = (Obstacle.TWO_PLACES,) if "places" in cause else ()
    assert refused(problem) == NoPlan(explanation=explanation, separate_reasons=(explanation,), unreachable=parts, obstacles=obstacles)


def test_of_alternatives_the_one_that_lacks_least_is_explained() -> None:
    lacking = "Jar001.Clean = TRUE AND Jar009 isOn Shelf1"
    washed = "Jar002.Clean = TRUE"
    for goal in (f"({lacking}) OR {washed}", f"{washed} OR ({lacking})", f"{washed} OR Jar001.Clean = TRUE"):
        assert refused(make_problem(goal, TRANSFER)).separate_reasons == (f"Jar002.Clean = TRUE {DENIED}",)


def test_a_program_that_nobody_runs_now_is_named() -> None:
    assign = ServiceType(
        name="AssignShelf",
        kind=ServiceKind.SOFTWARE,
        inputs=(Parameter(name="Jar", type="Jar"),),
        outputs=(Parameter(name="Shelf", type="Shelf"),),
        effect="?Shelf isFor ?Jar",
    )
    relation = RelationType(name="isFor", joins=("Shelf", "Jar"))
    ontology = laboratory().extended([relation, assign])
    result = refused(structs.replace(make_problem("?Shelf isFor Jar001", TRANSFER), ontology=ontology))
    assert result.separate_reasons == ("? isFor Jar001 could be brought about by AssignShelf, which no device offers now",)
    assert result.unoffered == ("AssignShelf",)
    named = refused(structs.replace(make_problem("Shelf1 isFor Jar001", TRANSFER), ontology=ontology))
    assert named.unoffered == (), "the program picks the shelf itself"


MOVE = ServiceType(name="Move", inputs=(Parameter(name="Room", type="Space"),), effect="?Provider isInside ?Room")


@pytest.mark.parametrize(
    ("changes", "text", "rest"),
    [
        ({}, "Move, which Robot1 does not offer now", {"unoffered": ("Move",)}),
        (
            {"resting": (LostService(MOVE, "Robot1.Move", "Robot1 is out of service"),)},
            "Move, which Robot1 does not offer now (Robot1 is out of service)",
            {"unoffered": ("Move",)},
        ),
        (
            {"lost": (LostService(MOVE, "Robot1.Move", "its key switch is at MANUAL"),)},
            "Move, but no service is left (Robot1.Move: its key switch is at MANUAL)",
            {"lost": ("Robot1.Move",)},
        ),
    ],
)
def test_a_device_that_does_not_do_what_others_offer_is_named(changes: dict[str, Any], text: str, rest: dict[str, Any]) -> None:
    robots = [ObjectAdded(Object(name=name, type="MobileRobot")) for name in ("Robot1", "Robot2")]
    problem = make_problem("Robot1 isInside RoomB")
    problem = structs.replace(problem, map=problem.map.changed(robots), services=(AvailableService(MOVE, ("Robot2",)),), **changes)
    result = refused(problem)
    assert result.separate_reasons == (f"Robot1 isInside RoomB could be brought about by {text}",)
    for name, value in rest.items():
        assert getattr(result, name) == value


def test_a_service_for_its_own_door_only_does_not_hide_the_service_for_any_door() -> None:
    own = ServiceType(name="OpenItself", effect="?Provider.Open = TRUE")
    problem = cellar("Door1.Open = TRUE")
    map = problem.map.changed([ObjectAdded(Object(name="Door2", type="Door", values={"Open": False}))])
    ontology = problem.ontology.extended([structs.replace(UNLOCK, precondition=None)])
    result = refused(structs.replace(problem, ontology=ontology, map=map, services=(AvailableService(own, ("Door2",)),)))
    assert result.separate_reasons == ("Door1.Open = TRUE could be brought about by OpenDoor, which no device offers now",)
    assert result.unoffered == ("OpenDoor",)


def test_services_that_cannot_be_planned_with_are_named_where_they_matter_and_elsewhere() -> None:
    effect = '?Jar isOn Platform001 AND (?Jar.Clean = TRUE OR ?Jar.Label = "dirty")'
    doubtful_service = ServiceType(name="Drop", inputs=WASH.inputs, effect=effect)
    near_result = refused(make_problem(GOAL, doubtful_service))
    (near_reason,) = near_result.separate_reasons
    assert near_reason.startswith(f"{GOAL} could be brought about by Drop, which cannot be planned with: Drop: ")
    assert near_reason.endswith("an effect with OR does not say what becomes true")
    reason = near_reason.partition("planned with: ")[2]
    assert near_result.undecided
    far_result = refused(make_problem("Jar001.Volume = 1", doubtful_service))
    assert far_result.separate_reasons == (f"Jar001.Volume = 1 {DENIED}", f"not considered: {reason}")
    assert far_result.undecided


@pytest.mark.parametrize(
    ("precondition", "denied"),
    [
        ("Jar001 isOn Shelf2", ("Jar001 isOn Shelf2",)),
        (
            "Jar001 isOn Shelf1 AND Jar002 isOn Shelf2 AND NOT Robot1 isInside RoomA",
            ("Jar002 isOn Shelf2", "NOT Robot1 isInside RoomA"),
        ),
    ],
)
def test_what_the_map_denies_of_the_beginning(precondition: str, denied: tuple[str, ...]) -> None:
    problem = make_problem(GOAL, TRANSFER)
    wrong = Problem(
        ontology=problem.ontology, map=problem.map, goal=problem.goal, services=problem.services, precondition=parse(precondition)
    )
    explanation = f"the task starts from {' and '.join(denied)}, which does not hold on the map"
    assert refused(wrong) == NoPlan(explanation=explanation, missing=denied, obstacles=(Obstacle.PRECONDITION,))


def chain(length: int) -> Problem:
    """Each service needs what the next one brings about, and the last one what nothing does."""
    ontology = laboratory().extended([RelationType(name=f"is{n}", joins=("Jar",)) for n in range(length + 1)])
    services = [
        ServiceType(name=f"Do{n}", inputs=WASH.inputs, precondition=f"is{n + 1}(?Jar)", effect=f"is{n}(?Jar)") for n in range(length)
    ]
    problem = make_problem("Jar001 isOn Shelf2")
    offered = tuple(AvailableService(service_type, ("Robot1",)) for service_type in services)
    return Problem(ontology=ontology, map=problem.map, goal=parse("is0(Jar001)"), services=offered)


@pytest.mark.parametrize("length", [1, 4, 5, 9])
def test_reasons_are_looked_for_so_many_services_back(length: int) -> None:
    explained_count = min(length, 5)
    reasons = [f"Do{n} could bring about is{n}(Jar001), but needs is{n + 1}(Jar001)" for n in range(explained_count)]
    last_reasons = [f"is{length}(Jar001) {DENIED}"] if length < 5 else []
    result = refused(chain(length))
    assert list(result.separate_reasons) == [*reasons, *last_reasons]
    assert result.missing == tuple(f"is{n + 1}(Jar001)" for n in range(explained_count))
