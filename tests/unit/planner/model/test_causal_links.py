"""The order that a plan needs, beside every order there is: on small random plans, by doing each of them."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from itertools import combinations, islice, permutations

import pytest

from somrs.entish import Formula
from somrs.entish.formula import conjunction, terms
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import AttributeType, FunctionType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.causal_links import derive_links, find_useful_steps, touches
from somrs.planner.model.plan import Link, Plan, Step, linearisations
from somrs.planner.model.problem import Problem
from somrs.planner.model.validation import apply_step
from tests.support.relay import carried, longest, maps_of, problem

ONTOLOGY = Ontology(
    [
        AttributeType(name="Level", kind=Kind.NUMBER),
        AttributeType(name="Weight", kind=Kind.NUMBER),
        FunctionType(name="level", parameters=("Object",), attribute="Level"),
        ObjectType(name="Object", parent=None, attributes=("Level", "Weight")),
        RelationType(name="marked", joins=("Object",)),
        RelationType(name="on", joins=("Object", "Object"), functional=True, excludes="place"),
        RelationType(name="heldBy", joins=("Object", "Object"), functional=True, excludes="place"),
        RelationType(name="tiedTo", joins=("Object", "Object"), symmetric=True),
    ]
)
ATOMS = ["marked(A)", "A on B", "A on C", "A heldBy D", "C heldBy D", "tiedTo(A, B)", "tiedTo(B, A)"]
Order = frozenset[tuple[int, int]]
"""Pairs of steps, by number: the first has to be done before the second."""


def random_plan(seed: int) -> tuple[list[Step], list[Map], Problem]:
    """Steps that can be done in the order given, on a map where everything that they need is so."""
    dice = random.Random(seed)
    map = Map([Object(name=name, type="Object") for name in "ABCD"])
    start = Problem(ontology=ONTOLOGY, map=map, goal=parse("marked(A)"))
    for atom in dice.sample(ATOMS, 3):
        map = apply_step(_step("start", atom), map, start)
    maps, steps = [map], list[Step]()
    for number in range(dice.randint(4, 5)):
        true_literals = [literal for literal in _literals() if formula_holds(parse(literal), maps[-1], ONTOLOGY)]
        condition = conjunction(*map_parse(dice.sample(true_literals, dice.randint(0, 2)))) if true_literals else None
        steps.append(_step(f"step{number}", dice.choice([*_literals()]), condition))
        maps.append(apply_step(steps[-1], maps[-1], start))
    true_literals = [literal for literal in _literals() if formula_holds(parse(literal), maps[-1], ONTOLOGY)]
    goal = conjunction(*map_parse(dice.sample(true_literals, dice.randint(1, 2))))
    return steps, maps, Problem(ontology=ONTOLOGY, map=map, goal=goal)


def _literals() -> Iterator[str]:
    for atom in ATOMS:
        yield atom
        yield f"NOT {atom}"


def map_parse(texts: list[str]) -> list[Formula]:
    return [parse(text) for text in texts]


def _step(id: str, effect: str, condition: Formula | None = None) -> Step:
    precondition = condition if condition is not None and str(condition) else None
    return Step(id=id, service_type="Does", inputs={}, effect=parse(effect), precondition=precondition)


def is_executable(steps: tuple[Step, ...], problem: Problem) -> bool:
    map = problem.map
    for step in steps:
        if step.precondition is not None and not formula_holds(step.precondition, map, problem.ontology):
            return False
        map = apply_step(step, map, problem)
    return formula_holds(problem.goal, map, problem.ontology)


def closed(order: Order) -> Order:
    """With whatever follows from it."""
    closure = set(order)
    while (
        new_pairs := {(source, next_target) for source, target in closure for next_source, next_target in closure if target == next_source}
        - closure
    ):
        closure |= new_pairs
    return frozenset(closure)


def in_every_way(order: Order, good: set[tuple[int, ...]], count: int) -> bool:
    """Whether the steps can be done in every way that the order allows."""
    ways = (way for way in permutations(range(count)) if all(way.index(first) < way.index(second) for first, second in order))
    return all(way in good for way in ways)


def makespan(order: Order, count: int) -> int:
    depth = [1] * count
    for first, second in sorted(order, key=lambda pair: pair[1]):
        depth[second] = max(depth[second], depth[first] + 1)
    return max(depth)


@pytest.mark.parametrize("seed", range(60))
def test_no_order_is_shorter_and_none_of_it_can_be_left_out(seed: int) -> None:
    steps, maps, random_problem = random_plan(seed)
    count = len(steps)
    place = {step.id: number for number, step in enumerate(steps)}
    links = derive_links(steps, maps, random_problem)
    mine = closed(frozenset((place[link.before], place[link.after]) for link in links))
    good = {way for way in permutations(range(count)) if is_executable(tuple(steps[number] for number in way), random_problem)}
    assert in_every_way(mine, good, count), links
    for first, second in mine:
        if not any((first, middle) in mine and (middle, second) in mine for middle in range(count)):
            assert not in_every_way(mine - {(first, second)}, good, count), f"step{first} need not come before step{second}: {links}"
    pairs = [*combinations(range(count), 2)]
    orders = (frozenset(pair for bit, pair in enumerate(pairs) if chosen >> bit & 1) for chosen in range(1 << len(pairs)))
    shorter = (order for order in orders if makespan(order, count) < makespan(mine, count) and closed(order) == order)
    assert not any(in_every_way(order, good, count) for order in shorter), links


def test_each_link_says_which_fact_it_is_for() -> None:
    relay_problem = problem(couriers=2, parcels=1)
    steps = carried(couriers=2, parcels=1)[:6]
    links = {
        (link.before, link.after): link.fact
        for link in derive_links(steps, maps_of(steps, relay_problem), relay_problem)
        if not link.is_protection
    }
    assert links["step2", "step3"] == "Courier0 isAt Place1"
    assert links["step3", "step5"] == "Parcel0 isOn Place1"
    assert ("step1", "step6") not in links


def test_hundreds_of_steps_are_linked_within_a_moment() -> None:
    steps, relay_problem = carried(couriers=10, parcels=11), problem(couriers=10, parcels=11)
    maps = maps_of(steps, relay_problem)
    started_at = time.process_time()
    links = derive_links(steps, maps, relay_problem)
    assert time.process_time() - started_at < 5.0, "0.08 s where it was measured, for 440 steps"
    plan = Plan(tuple(steps), links)
    assert longest(plan) == 30 + 4 * 10 + 1


def test_a_plan_of_many_couriers_can_be_done_in_other_orders() -> None:
    steps, relay_problem = carried(couriers=2, parcels=2), problem(couriers=2, parcels=2)
    plan = Plan(tuple(steps), derive_links(steps, maps_of(steps, relay_problem), relay_problem))
    for order in islice(linearisations(plan), 200):
        assert is_executable(order, relay_problem)


@pytest.mark.parametrize(
    ("effect", "condition", "expected"),
    [
        ("marked(A)", "marked(A)", True),
        ("NOT marked(A)", "marked(A)", True),
        ("marked(A)", "NOT marked(A)", True),
        ("marked(A)", "marked(B)", False),
        ("marked(A)", "NOT marked(?X)", True),
        ("A on B", "A on C", True),
        ("NOT A on B", "A on C", False),
        ("A on B", "C on B", False),
        ("A on B", "A heldBy D", True),
        ("A on B", "B heldBy A", False),
        ("A on B", "?X heldBy D", True),
        ("A on B", "marked(A)", False),
        ("tiedTo(A, B)", "tiedTo(B, A)", True),
        ("tiedTo(A, B)", "tiedTo(A, C)", False),
        ("tiedTo(A, B)", "NOT tiedTo(?X, A)", True),
        ("unknown(A)", "unknown(A)", False),
        ("A.Level = 1", "A.Level > 2", True),
        ("1 = A.Level", "NOT 2 < A.Level", True),
        ("A.Level = 1", "B.Level > 2", False),
        ("A.Level = 1", "A.Weight > 2", False),
        ("A.Level = 1", "NOT ?X.Level > 2", True),
        ("A.Level = 1", "B.Weight + A.Level > 2", True),
        ("A.Level = 1", "level(A) > 2", True),
        ("A.Level = 1", "3 > 2 * level(A)", True),
        ("A.Level = 1", "level(B) > 2", False),
        ("A.Weight = 1", "level(A) > 2", False),
        ("A.Level = 1", "NOT level(?X) > 2", True),
        ("A.Level = 1", "unknown(A) > 2", False),
        ("A.Level = 1", "marked(A)", False),
        ("marked(A)", "A.Level = 1", False),
    ],
)
def test_which_effects_may_change_whether_a_condition_holds(effect: str, condition: str, expected: bool) -> None:
    assert touches(parse(effect), parse(condition), ONTOLOGY) is expected  # type: ignore[arg-type]


def test_the_steps_that_the_goal_needs() -> None:
    start = Map([Object(name=name, type="Object") for name in "ABCD"])
    planning_problem = Problem(ontology=ONTOLOGY, map=start, goal=parse("A on B AND NOT marked(D)"))
    steps = [
        _step("step0", "marked(A)"),
        _step("step1", "marked(B)"),
        _step("step2", "marked(A)"),
        _step("step3", "C on B", parse("marked(A)")),
        _step("step4", "A on B", parse("C on B")),
    ]
    maps = [start]
    for step in steps:
        maps.append(apply_step(step, maps[-1], planning_problem))
    assert find_useful_steps(steps, maps, planning_problem) == [0, 3, 4]
    links = {(link.before, link.after, link.fact, link.is_protection) for link in derive_links(steps, maps, planning_problem)}
    assert links == {("step0", "step3", "marked(A)", False), ("step3", "step4", "C on B", False)}
    assert derive_links(steps[:1], maps[:2], planning_problem) == ()


@pytest.mark.parametrize("effect", ["A.Level = B.Level + 1", "B.Level + 1 = A.Level", "A.Level = 1 + level(B)"])
def test_what_an_effect_is_calculated_from_has_to_be_so_by_then(effect: str) -> None:
    start = Map([Object(name=name, type="Object", values={"Level": 0.0, "Weight": 0.0}) for name in "ABCD"])
    planning_problem = Problem(ontology=ONTOLOGY, map=start, goal=parse("A.Level = 3"))
    steps = [
        _step("step0", "B.Weight = 2"),
        _step("step1", "B.Level = 2"),
        _step("step2", "A.Level = 3"),
        _step("step3", "B.Level = 4"),
        _step("step4", "C.Level = 5"),
    ]
    maps = maps_of(steps, planning_problem)
    written = [*(step.effect for step in steps[:2]), parse(effect), *(step.effect for step in steps[3:])]
    (read,) = {"level(B)", "B.Level"} & {str(term) for term in terms(parse(effect))}
    assert derive_links(steps, maps, planning_problem, written) == (
        Link("step1", "step2", f"{read} = 2"),
        Link("step2", "step3", f"{read} = 2", is_protection=True),
    )
    assert derive_links(steps, maps, planning_problem) == ()
