"""What is answered at once, and whom the planner asks when its own search does not find out."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from msgspec import structs

from somrs.errors import SomrsError
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.planner.encodings.sas import parse_sas
from somrs.planner.grounding.relevance import Demand, demands
from somrs.planner.grounding.task import Move, Task
from somrs.planner.model.operators import Operator
from somrs.planner.model.plan import NoPlan, Obstacle, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.world import World
from somrs.planner.planning import plan, plan_quickly
from somrs.planner.search.progress import Progress
from somrs.planner.search.search import TooHard, search
from tests.support.laboratory import FACTS, OBJECTS, OPEN, TRANSFER, make_problem, names
from tests.unit.planner import test_numbers

GOAL = "Jar001 isOn Platform001"
MOVED = "TransferObject(Object: Jar001, Destination: Platform001)"
FAR = "3 states were looked at; at best 1 of the goal's 2 parts held at once"


class RecordingEngine:
    """An engine that notes what it is asked and gives the answer that it was made with."""

    def __init__(self, answer: object = None) -> None:
        self.answer = answer
        self.calls: list[tuple[object, ...]] = []

    def __call__(self, *arguments: object) -> list[str] | None:
        self.calls.append(arguments)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer  # type: ignore[return-value]


def too_hard(*_: object, **__: object) -> None:
    raise TooHard(Progress(states=3, held_count=1, parts=2))


def search_once(task: Task, effort: int, **_: object) -> list[Move] | None:
    """Without the second search."""
    return search(task, effort)


@pytest.fixture
def hard(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is found at once, nor by a short search."""
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    monkeypatch.setattr("somrs.planner.planning.cheapest", too_hard)


def jars(count: int) -> Problem:
    """So many jars that are to be put on the platform."""
    jar_objects = [Object(name=f"J{n}", type="Jar") for n in range(count)]
    map = Map(
        [*(Object(name=name, type=type_name) for name, type_name in OBJECTS.items()), *jar_objects],
        [*FACTS, *(Fact("isOn", (jar.name, "Shelf1")) for jar in jar_objects)],
    )
    return make_problem(" AND ".join(f"{jar.name} isOn Platform001" for jar in jar_objects), TRANSFER, map=map)


# What is answered at once


def test_what_holds_already_is_done() -> None:
    assert plan_quickly(make_problem("Jar001 isOn Shelf1")) == Plan()


def test_of_what_nobody_knows_it_is_not_said_that_it_is_done() -> None:
    goal = "Jar001 isOn Shelf1 AND Jar002 isOn Shelf1"
    problem = make_problem(goal, TRANSFER, excluded=frozenset({"Jar001", "Jar002", "Shelf2"}))
    reserved = f"{goal}: Jar001 and Jar002 are reserved by other tasks"
    assert plan_quickly(problem) == NoPlan(explanation=reserved, obstacles=(Obstacle.PROMISED,))
    partly_unknown = f"{goal}: Jar001 is reserved by another task, and the place and state of Jar002 are unknown"
    expected = NoPlan(explanation=partly_unknown, obstacles=(Obstacle.PROMISED, Obstacle.UNKNOWN))
    assert plan_quickly(structs.replace(problem, unknown=frozenset({"Jar002"}))) == expected


@pytest.mark.parametrize(("count", "steps"), [(1, 1), (9, 9), (10, None)])
def test_short_plans_are_found_at_once_and_long_ones_are_searched_for(count: int, steps: int | None) -> None:
    result = plan_quickly(jars(count))
    assert (len(result.steps) if isinstance(result, Plan) else result) == steps


def test_what_cannot_be_expressed_is_said_at_once() -> None:
    problem = make_problem(" AND ".join(f"(?Jar.Weight = {n} OR ?Jar.Weight = {n + 9})" for n in range(9)), TRANSFER)
    expected = NoPlan(explanation=f"this cannot be planned for: {problem.goal}: it has more than 256 alternatives", undecided=True)
    assert plan_quickly(problem) == plan(problem) == expected


# Engines


@pytest.mark.usefixtures("hard")
def test_without_an_engine_it_is_said_that_there_is_one() -> None:
    explanation = f"this takes a longer search ({FAR}); install the engine for it: pip install 'somrs[planner]'"
    assert plan(make_problem(GOAL, TRANSFER)) == NoPlan(explanation=explanation, undecided=True)


@pytest.mark.usefixtures("hard")
def test_an_engine_is_asked_for_the_moves() -> None:
    engine = RecordingEngine(["0 1"])
    result = plan(make_problem(GOAL, TRANSFER), engine)
    assert isinstance(result, Plan)
    assert names(result) == [MOVED]
    ((text, limit),) = engine.calls
    assert limit == 15.0, "half of the time, as there are more relevant actions than likely ones"
    assert [operation.move for operation in parse_sas(str(text)).operations] == [0]
    plan(make_problem(GOAL, TRANSFER), engine, 7.0)
    assert engine.calls[1:] == [(text, 3.5)]


@pytest.mark.usefixtures("hard")
def test_where_an_engine_finds_none_there_is_no_plan() -> None:
    result = plan(make_problem(GOAL, TRANSFER), RecordingEngine(None))
    assert isinstance(result, NoPlan)
    assert (result.unreachable, result.undecided) == ((GOAL,), False)


FREE_HAND = "NOT ?Other isHeldBy ?Provider"
PICK = ServiceType(
    name="Pick",
    inputs=(Parameter(name="Object", type="Graspable"),),
    precondition=f"?Object isOn ?Place AND NOT ?Top isOn ?Object AND {FREE_HAND}",
    effect="?Object isHeldBy ?Provider AND NOT ?Object isOn ?Place",
)
PUT = ServiceType(
    name="Put",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="Place", type="Support")),
    precondition="?Object isHeldBy ?Provider",
    effect="?Object isOn ?Place AND NOT ?Object isHeldBy ?Provider",
)
DISCARD = ServiceType(
    name="Discard",
    inputs=(Parameter(name="Object", type="Graspable"),),
    precondition="?Object isHeldBy ?Provider",
    effect="NOT ?Object isHeldBy ?Provider",
)
COVERED = Map(
    (Object(name=name, type=type) for name, type in {**OBJECTS, "Jar003": "Jar"}.items()),
    [Fact("isOn", ("Jar001", "Shelf1")), Fact("isOn", ("Jar002", "Jar001")), Fact("isOn", ("Jar003", "Jar002"))],
)


def operations(call: tuple[object, ...]) -> int:
    return len(parse_sas(str(call[0])).operations)


@pytest.mark.usefixtures("hard")
@pytest.mark.parametrize(("similar", "shares"), [(9.0, [1.0]), (1.0, [0.5, 1.0])])
def test_what_frees_a_hand_that_is_free_now_is_not_left_out_for_long(
    monkeypatch: pytest.MonkeyPatch, similar: float, shares: list[float]
) -> None:
    """The hand has to be free, and is: only after the uppermost jar was taken off is it to be made free."""
    monkeypatch.setattr("somrs.planner.planning.SIMILAR", similar)
    engine = RecordingEngine(SomrsError("no time is left"))
    problem = make_problem("Jar001 isOn Shelf2", PICK, PUT, DISCARD, map=COVERED)
    assert plan(problem, engine, 10.0).undecided  # type: ignore[union-attr]
    assert [seconds for _, seconds in engine.calls] == [10.0 * share for share in shares]
    monkeypatch.setattr("somrs.planner.planning.cheapest", search_once)
    result = plan(problem)
    assert isinstance(result, Plan)
    assert len(result.steps) > 4, "all three are taken"
    if len(shares) == 2:
        assert operations(engine.calls[0]) < operations(engine.calls[1])


@pytest.mark.usefixtures("hard")
def test_an_engine_need_not_prove_twice_that_there_is_no_plan() -> None:
    engine = RecordingEngine(None)
    shut = Map([Object(name="DoorAB", type="Door", values={"Open": False})])
    assert isinstance(plan(make_problem("DoorAB.Open = TRUE", OPEN, map=shut), engine), NoPlan)
    assert len(engine.calls) == 1, "all relevant actions are likely ones"


@pytest.mark.usefixtures("hard")
def test_what_an_engine_says_of_why_it_did_not_find_out_is_told() -> None:
    result = plan(make_problem(GOAL, TRANSFER), RecordingEngine(SomrsError("out of memory")))
    assert result == NoPlan(explanation=f"no plan was found: out of memory; the short search before it: {FAR}", undecided=True)


# Better plans


@pytest.mark.parametrize("hurry", [True, False])
def test_a_better_plan_is_asked_for_where_the_first_one_is_long(hurry: bool) -> None:
    better = RecordingEngine([])
    for count in (9, 10):
        result = plan(structs.replace(jars(count), hurry=hurry), improver=better)  # type: ignore[arg-type]
        assert isinstance(result, Plan)
        assert len(result.steps) == count
    ((text, is_hurried),) = better.calls
    assert len(parse_sas(str(text)).operations) == 10
    assert is_hurried is hurry


def test_nobody_looks_for_a_better_plan_when_something_went_wrong_on_the_way() -> None:
    better = RecordingEngine([])
    first = plan(jars(11))
    assert isinstance(first, Plan)
    second_plan = plan(structs.replace(jars(11), rest=first.steps[:3]), improver=better)  # type: ignore[arg-type]
    assert isinstance(second_plan, Plan)
    assert (len(second_plan.steps), better.calls) == (11, [])


def test_the_best_of_the_plans_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.planner.planning.cheapest", search_once)
    dear = structs.replace(TRANSFER, name="Dear", cost="5")
    cheap = structs.replace(TRANSFER, name="Cheap", cost="1")
    problem = jars(10)
    offers = [structs.replace(problem.services[0], service_type=service_type) for service_type in (dear, cheap)]
    combined_problem = structs.replace(problem, services=tuple(offers))

    def better(text: str, hurry: bool) -> list[list[str]]:
        operations = parse_sas(text).operations
        return [[f"{operation.move} {operation.device}" for operation in operations if operation.cost == cost] for cost in (5, 1, 5)]

    result = plan(combined_problem, improver=better)
    assert isinstance(result, Plan)
    assert {step.service_type for step in result.steps} == {"Cheap"}
    assert len(result.steps) == 10


# Numbers


FILLED = "Box1.Count = 3"


def box(goal: str = FILLED) -> Problem:
    map = Map([Object(name="Box1", type="Box", values={"Count": 2.0}), Object(name="Robot1", type="Rover")])
    return test_numbers.make_problem(map, goal, test_numbers.FILL)


@pytest.fixture
def low_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """More values than are listed, and more states than are looked at."""
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    for name in ("VALUES", "STATES", "ALL_STATES"):
        monkeypatch.setattr(f"somrs.planner.planning.{name}", 0)


@pytest.mark.usefixtures("low_limits")
def test_without_an_engine_for_numbers_it_is_said_that_there_is_one() -> None:
    explanation = "this is too large to be searched: 2 states were looked at; install the engine for numbers: pip install 'somrs[numbers]'"
    assert plan(box()) == NoPlan(explanation=explanation, undecided=True)


@pytest.mark.usefixtures("low_limits")
@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (["a1", "a0"], ["Fill(Box: Box1)"]),
        (["a1", "a1", "a0"], None),
        (["a0"], None),
    ],
)
def test_what_an_engine_for_numbers_finds_is_calculated_again(answer: list[str], expected: Sequence[str] | None) -> None:
    engine = RecordingEngine(answer)
    result = plan(box(), numeric=engine, limit=7.0)
    if expected is None:
        explanation = "this is too large to be searched: the plan from the engine for numbers fails in exact arithmetic"
        assert result == NoPlan(explanation=explanation, undecided=True)
    else:
        assert isinstance(result, Plan)
        assert names(result) == expected
    ((domain, task, limit),) = engine.calls
    assert str(domain).startswith("(define (domain d)")
    assert str(task).startswith("(define (problem p)")
    assert limit == 7.0


@pytest.mark.usefixtures("low_limits")
def test_where_an_engine_for_numbers_finds_none_there_is_no_plan() -> None:
    result = plan(box(), numeric=RecordingEngine(None))
    assert isinstance(result, NoPlan)
    assert not result.undecided


@pytest.mark.parametrize(
    ("setting", "numeric", "is_engine_called"),
    [("STATES", True, True), ("ALL_STATES", True, False), ("ALL_STATES", False, True), ("STATES", False, False)],
)
def test_with_an_engine_for_numbers_fewer_states_are_looked_at(
    setting: str, numeric: bool, is_engine_called: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    monkeypatch.setattr("somrs.planner.planning.VALUES", 0)
    monkeypatch.setattr(f"somrs.planner.planning.{setting}", 0)
    engine = RecordingEngine(["a1", "a0"])
    result = plan(box(), numeric=engine if numeric else None)
    assert isinstance(result, Plan) is (numeric or not is_engine_called)
    assert len(engine.calls) == (numeric and is_engine_called)


def test_a_plan_with_numbers_has_no_steps_that_it_can_do_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    for name in ("VALUES", "STATES"):
        monkeypatch.setattr(f"somrs.planner.planning.{name}", 0)
    result = plan(box("Box1.Count >= 3"), numeric=RecordingEngine(["a1", "a1", "a1", "a0"]))
    assert isinstance(result, Plan)
    assert names(result) == ["Fill(Box: Box1)"]


# What is likely to help comes first


@pytest.mark.parametrize("listed", [True, False])
@pytest.mark.parametrize(("charge", "expected_flags"), [(60.0, [True]), (30.0, [True, False])])
def test_what_is_likely_to_help_is_tried_first_and_then_all(
    charge: float, expected_flags: list[bool], listed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    narrow_flags = list[bool]()

    def noted(goals: list[Operator], world: World, *, narrow: bool) -> list[Demand]:
        narrow_flags.append(narrow)
        return demands(goals, world, narrow=narrow)

    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    monkeypatch.setattr("somrs.planner.planning.demands", noted)
    if not listed:
        monkeypatch.setattr("somrs.planner.planning.VALUES", 0)
    problem = test_numbers.make_problem(test_numbers.corridor(3, charge), "Robot1 isInside Hall2", test_numbers.DRIVE)
    assert isinstance(plan(problem), Plan) is (expected_flags == [True])
    assert narrow_flags == (expected_flags if listed else [True, *expected_flags])
