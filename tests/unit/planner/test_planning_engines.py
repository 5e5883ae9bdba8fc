"""What is answered at once, and whom the planner asks when its own search does not find out."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from msgspec import structs

from somrs.errors import SomrsError
from somrs.ontology.objects import Fact, Map, Object
from somrs.planner.encodings.sas import parse_sas
from somrs.planner.grounding.relevance import Demand, demands
from somrs.planner.model.operators import Operator
from somrs.planner.model.plan import NoPlan, Obstacle, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.world import World
from somrs.planner.planning import plan, plan_quickly
from somrs.planner.search.progress import Progress
from somrs.planner.search.search import TooHard, search
from tests.unit.planner import test_numbers
from tests.unit.planner.test_planning import FACTS, OBJECTS, TRANSFER, names, problem

GOAL = "Jar001 isOn Platform001"
MOVED = "TransferObject(Object: Jar001, Destination: Platform001)"
FAR = "3 states were looked at; at best 1 of the goal's 2 parts held at once"


class Asked:
    """An engine that notes what it is asked and gives the answer that it was made with."""

    def __init__(self, answer: object = None) -> None:
        self.answer = answer
        self.calls: list[tuple[object, ...]] = []

    def __call__(self, *given: object) -> list[str] | None:
        self.calls.append(given)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer  # type: ignore[return-value]


def too_hard(*_: object) -> None:
    raise TooHard(Progress(states=3, held_count=1, parts=2))


@pytest.fixture
def hard(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is found at once, nor by a short search."""
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    monkeypatch.setattr("somrs.planner.planning.cheapest", too_hard)


def jars(count: int) -> Problem:
    """So many jars that are to be put on the platform."""
    some = [Object(name=f"J{n}", type="Jar") for n in range(count)]
    map = Map(
        [*(Object(name=name, type=type_name) for name, type_name in OBJECTS.items()), *some],
        [*FACTS, *(Fact("isOn", (jar.name, "Shelf1")) for jar in some)],
    )
    return problem(" AND ".join(f"{jar.name} isOn Platform001" for jar in some), TRANSFER, map=map)


# What is answered at once


def test_what_holds_already_is_done() -> None:
    assert plan_quickly(problem("Jar001 isOn Shelf1")) == Plan()


def test_of_what_nobody_knows_it_is_not_said_that_it_is_done() -> None:
    said = "Jar001 isOn Shelf1 AND Jar002 isOn Shelf1: Jar002 is promised to another task, or nobody knows what state it is in"
    asked = problem("Jar001 isOn Shelf1 AND Jar002 isOn Shelf1", TRANSFER, excluded=frozenset({"Jar002", "Shelf2"}))
    assert plan_quickly(asked) == NoPlan(explanation=said, obstacles=(Obstacle.PROMISED,))


@pytest.mark.parametrize(("count", "steps"), [(1, 1), (9, 9), (10, None)])
def test_short_plans_are_found_at_once_and_long_ones_are_searched_for(count: int, steps: int | None) -> None:
    found = plan_quickly(jars(count))
    assert (len(found.steps) if isinstance(found, Plan) else found) == steps


def test_what_cannot_be_expressed_is_said_at_once() -> None:
    asked = problem(" AND ".join(f"(Jar001.Weight = {n} OR Jar002.Weight = {n})" for n in range(9)), TRANSFER)
    said = NoPlan(explanation=f"this cannot be planned for: {asked.goal}: it has more than 256 alternatives", undecided=True)
    assert plan_quickly(asked) == plan(asked) == said


# Engines


@pytest.mark.usefixtures("hard")
def test_without_an_engine_it_is_said_that_there_is_one() -> None:
    said = f"this takes a longer search ({FAR}); install the engine for it: pip install 'somrs[planner]'"
    assert plan(problem(GOAL, TRANSFER)) == NoPlan(explanation=said, undecided=True)


@pytest.mark.usefixtures("hard")
def test_an_engine_is_asked_for_the_moves() -> None:
    asked = Asked(["0 1"])
    found = plan(problem(GOAL, TRANSFER), asked)
    assert isinstance(found, Plan)
    assert names(found) == [MOVED]
    ((text, limit),) = asked.calls
    assert limit == 30.0
    assert [operation.move for operation in parse_sas(str(text)).operations] == [0]
    plan(problem(GOAL, TRANSFER), asked, 7.0)
    assert asked.calls[1:] == [(text, 7.0)]


@pytest.mark.usefixtures("hard")
def test_where_an_engine_finds_none_there_is_no_plan() -> None:
    found = plan(problem(GOAL, TRANSFER), Asked(None))
    assert isinstance(found, NoPlan)
    assert (found.unreachable, found.undecided) == ((GOAL,), False)


@pytest.mark.usefixtures("hard")
def test_what_an_engine_says_of_why_it_did_not_find_out_is_told() -> None:
    found = plan(problem(GOAL, TRANSFER), Asked(SomrsError("out of memory")))
    assert found == NoPlan(explanation=f"no plan was found: out of memory; of the short search before it, {FAR}", undecided=True)


# Better plans


@pytest.mark.parametrize("hurry", [True, False])
def test_a_better_plan_is_asked_for_where_the_first_one_is_long(hurry: bool) -> None:
    better = Asked([])
    for count in (9, 10):
        found = plan(structs.replace(jars(count), hurry=hurry), improver=better)  # type: ignore[arg-type]
        assert isinstance(found, Plan)
        assert len(found.steps) == count
    ((text, soon),) = better.calls
    assert len(parse_sas(str(text)).operations) == 10
    assert soon is hurry


def test_nobody_looks_for_a_better_plan_when_something_went_wrong_on_the_way() -> None:
    better = Asked([])
    first = plan(jars(11))
    assert isinstance(first, Plan)
    again = plan(structs.replace(jars(11), rest=first.steps[:3]), improver=better)  # type: ignore[arg-type]
    assert isinstance(again, Plan)
    assert (len(again.steps), better.calls) == (11, [])


def test_the_best_of_the_plans_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.planner.planning.cheapest", search)
    dear = structs.replace(TRANSFER, name="Dear", cost="5")
    cheap = structs.replace(TRANSFER, name="Cheap", cost="1")
    asked = jars(10)
    offers = [structs.replace(asked.services[0], service_type=one) for one in (dear, cheap)]
    both = structs.replace(asked, services=tuple(offers))

    def better(text: str, hurry: bool) -> list[list[str]]:
        operations = parse_sas(text).operations
        return [[f"{one.move} {one.device}" for one in operations if one.cost == cost] for cost in (5, 1, 5)]

    found = plan(both, improver=better)
    assert isinstance(found, Plan)
    assert {step.service_type for step in found.steps} == {"Cheap"}
    assert len(found.steps) == 10


# Numbers


FILLED = "Box1.Count = 3"


def box(goal: str = FILLED) -> Problem:
    map = Map([Object(name="Box1", type="Box", values={"Count": 2.0}), Object(name="Robot1", type="Rover")])
    return test_numbers.problem(map, goal, test_numbers.FILL)


@pytest.fixture
def many(monkeypatch: pytest.MonkeyPatch) -> None:
    """More values than are listed, and more states than are looked at."""
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    for name in ("VALUES", "STATES", "ALL_STATES"):
        monkeypatch.setattr(f"somrs.planner.planning.{name}", 0)


@pytest.mark.usefixtures("many")
def test_without_an_engine_for_numbers_it_is_said_that_there_is_one() -> None:
    said = "this is too large to be searched: 2 states were looked at; install the engine for numbers: pip install 'somrs[numbers]'"
    assert plan(box()) == NoPlan(explanation=said, undecided=True)


@pytest.mark.usefixtures("many")
@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (["a1", "a0"], ["Fill(Box: Box1)"]),
        (["a1", "a1", "a0"], None),
        (["a0"], None),
    ],
)
def test_what_an_engine_for_numbers_finds_is_calculated_again(answer: list[str], expected: Sequence[str] | None) -> None:
    asked = Asked(answer)
    found = plan(box(), numeric=asked, limit=7.0)
    if expected is None:
        said = "this is too large to be searched: the plan that the engine for numbers found is none when it is calculated exactly"
        assert found == NoPlan(explanation=said, undecided=True)
    else:
        assert isinstance(found, Plan)
        assert names(found) == expected
    ((domain, task, limit),) = asked.calls
    assert str(domain).startswith("(define (domain d)")
    assert str(task).startswith("(define (problem p)")
    assert limit == 7.0


@pytest.mark.usefixtures("many")
def test_where_an_engine_for_numbers_finds_none_there_is_no_plan() -> None:
    found = plan(box(), numeric=Asked(None))
    assert isinstance(found, NoPlan)
    assert not found.undecided


@pytest.mark.parametrize(
    ("setting", "numeric", "asks"),
    [("STATES", True, True), ("ALL_STATES", True, False), ("ALL_STATES", False, True), ("STATES", False, False)],
)
def test_with_an_engine_for_numbers_fewer_states_are_looked_at(
    setting: str, numeric: bool, asks: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    monkeypatch.setattr("somrs.planner.planning.VALUES", 0)
    monkeypatch.setattr(f"somrs.planner.planning.{setting}", 0)
    engine = Asked(["a1", "a0"])
    found = plan(box(), numeric=engine if numeric else None)
    assert isinstance(found, Plan) is (numeric or not asks)
    assert len(engine.calls) == (numeric and asks)


def test_a_plan_with_numbers_has_no_steps_that_it_can_do_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    for name in ("VALUES", "STATES"):
        monkeypatch.setattr(f"somrs.planner.planning.{name}", 0)
    found = plan(box("Box1.Count >= 3"), numeric=Asked(["a1", "a1", "a1", "a0"]))
    assert isinstance(found, Plan)
    assert names(found) == ["Fill(Box: Box1)"]


# What is likely to help comes first


@pytest.mark.parametrize("listed", [True, False])
@pytest.mark.parametrize(("charge", "tried"), [(60.0, [True]), (30.0, [True, False])])
def test_what_is_likely_to_help_is_tried_first_and_then_all(
    charge: float, tried: list[bool], listed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = list[bool]()

    def noted(goals: list[Operator], world: World, *, narrow: bool) -> list[Demand]:
        found.append(narrow)
        return demands(goals, world, narrow=narrow)

    monkeypatch.setattr("somrs.planner.search.matching.FACTS", 0)
    monkeypatch.setattr("somrs.planner.planning.demands", noted)
    if not listed:
        monkeypatch.setattr("somrs.planner.planning.VALUES", 0)
    asked = test_numbers.problem(test_numbers.corridor(3, charge), "Robot1 isInside Hall2", test_numbers.DRIVE)
    assert isinstance(plan(asked), Plan) is (tried == [True])
    assert found == (tried if listed else [True, *tried])
