"""Which actions come of service types: those that are reachable, with effects that make sense, and no more than are allowed."""

from __future__ import annotations

import pytest

from somrs.entish import Number
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.grounding.actions import Action
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.joins import TooLarge
from somrs.planner.grounding.relevance import demands
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.vocabulary import Fact as GroundFact
from somrs.planner.model.world import World

ONTOLOGY = Ontology(
    [
        AttributeType(name="Clean", kind=Kind.TRUTH),
        AttributeType(name="Level", kind=Kind.NUMBER, unit="m", minimum=0, maximum=5),
        AttributeType(name="Weight", kind=Kind.NUMBER, unit="kg", tolerance=0.5),
        AttributeType(name="Count", kind=Kind.NUMBER),
        AttributeType(name="Mode", kind=Kind.ENUMERATION, values=("Slow", "Fast")),
        AttributeType(name="Colour", kind=Kind.ENUMERATION),
        AttributeType(name="Label", kind=Kind.TEXT),
        ObjectType(name="Object", parent=None),
        ObjectType(name="Thing", parent="Object", attributes=("Clean", "Level", "Weight", "Count", "Mode", "Colour", "Label")),
        ObjectType(name="Cup", parent="Thing"),
        ObjectType(name="Place", parent="Object", attributes=("Level",)),
        ObjectType(name="Robot", parent="Object"),
        RelationType(name="on", joins=("Thing", "Object"), functional=True, excludes="place"),
        RelationType(name="heldBy", joins=("Thing", "Robot"), functional=True, excludes="place"),
        RelationType(name="at", joins=("Robot", "Place"), functional=True),
        RelationType(name="near", joins=("Object", "Object"), symmetric=True),
        RelationType(name="tiedTo", joins=("Object", "Object"), excludes="bond"),
        RelationType(name="gluedTo", joins=("Object", "Object"), functional=True, excludes="bond"),
        RelationType(name="marriedTo", joins=("Object", "Object"), symmetric=True, functional=True),
        RelationType(name="follows", joins=("Object", "Object"), functional=True),
        RelationType(name="likes", joins=("Object", "Object")),
        RelationType(name="marked", joins=("Object",)),
        RelationType(name="lent", joins=("Object", "Object", "Object")),
    ]
)
OBJECTS = {"T1": "Thing", "T2": "Thing", "C1": "Cup", "P1": "Place", "P2": "Place", "R1": "Robot"}


def service(name: str, precondition: str | None, effect: str, **inputs: str) -> ServiceType:
    parameters = tuple(Parameter(name=name, type=type_name) for name, type_name in inputs.items())
    return ServiceType(name=name, inputs=parameters, precondition=precondition, effect=effect)


def make_world(
    goal: str,
    *services: ServiceType,
    facts: str = "",
    values: dict[str, dict[str, float | str | bool]] | None = None,
    objects: dict[str, str] | None = None,
    counting: bool = False,
) -> tuple[Problem, World]:
    """`facts` as in `T1 on P1, marked T2`."""
    written = [text.split() for text in facts.split(", ") if text]
    map_facts = [Fact(words[1], (words[0], words[2])) if len(words) == 3 else Fact(words[0], tuple(words[1:])) for words in written]
    map = Map([Object(name=n, type=t, values=(values or {}).get(n, {})) for n, t in (objects or OBJECTS).items()], map_facts)
    offered = tuple(AvailableService(service_type, ("R1",)) for service_type in services)
    problem = Problem(ontology=ONTOLOGY, map=map, goal=parse(goal), services=offered)
    return problem, World(problem, counting=counting)


def ground_problem(
    instance: tuple[Problem, World], narrow: bool = False, max_actions: int | None = None, effort: int = 10_000
) -> Grounding:
    problem, world = instance
    demanded = demands(list(goal_operators(problem.goal, world.vocabulary)), world, narrow=narrow)
    return Grounding(world, demanded, narrow=narrow, effort=effort, max_actions=max_actions)


def format_fact(ground_fact: GroundFact) -> str:
    return f"{ground_fact[0]}({', '.join(map(str, ground_fact[1]))})"


def format_actions(grounding: Grounding) -> list[str]:
    """The actions other than the goal's, as in `Put T=T1 P=P1`."""
    return sorted(format_action(action) for action in grounding.actions if action.operator.service is not None)


def format_action(action: Action) -> str:
    name = action.operator.service.name if action.operator.service is not None else "goal"
    return " ".join([name, *(f"{variable}={action.binding[variable]}" for variable in action.operator.variables)])


PUT_SERVICE = service("Put", "?T heldBy ?Provider AND ?Provider at ?P", "?T on ?P", T="Thing", P="Place")
TAKE_SERVICE = service("Take", "?T on ?P AND ?Provider at ?P", "?T heldBy ?Provider", T="Thing")
GO_SERVICE = service("Go", "?Provider at ?From AND ?From near ?To", "?Provider at ?To", To="Place")


def test_the_actions_that_are_reachable() -> None:
    grounding = ground_problem(make_world("T1 on P2", PUT_SERVICE, TAKE_SERVICE, GO_SERVICE, facts="T1 on P1, R1 at P1, P2 near P1"))
    assert grounding.is_goal_reachable
    assert format_actions(grounding) == [
        "Go To=P1 Provider=R1 From=P2",
        "Go To=P2 Provider=R1 From=P1",
        "Put T=T1 P=P1 Provider=R1",
        "Put T=T1 P=P2 Provider=R1",
        "Take T=T1 Provider=R1 P=P1",
        "Take T=T1 Provider=R1 P=P2",
    ]
    put_action = next(action for action in grounding.actions if format_action(action).startswith("Put T=T1 P=P2"))
    assert [*map(format_fact, put_action.preconditions)] == ["heldBy(T1, R1)", "at(R1, P2)"]
    assert [*map(format_fact, put_action.add_effects)] == ["on(T1, P2)"]
    assert (put_action.delete_effects, put_action.numeric_conditions, put_action.numeric_effects, put_action.provider) == ((), (), (), "R1")


def test_what_is_too_far_is_not_reached() -> None:
    grounding = ground_problem(make_world("T1 on P2", PUT_SERVICE, TAKE_SERVICE, GO_SERVICE, facts="T1 on P1, R1 at P1"))
    assert not grounding.is_goal_reachable
    assert format_actions(grounding) == ["Put T=T1 P=P1 Provider=R1", "Take T=T1 Provider=R1 P=P1"]


def test_a_use_that_speaks_of_no_provider_has_none() -> None:
    grounding = ground_problem(make_world("marked(T1)", service("Mark", None, "marked(?T)", T="Thing")))
    assert [(format_action(action), action.provider) for action in grounding.actions] == [("Mark T=T1", None), ("goal", None)]


def test_actions_remove_what_their_effects_say() -> None:
    grounding = ground_problem(
        make_world("NOT P2 near P1", service("Part", None, "NOT ?P near ?Q", P="Place", Q="Place"), facts="P2 near P1")
    )
    removed = {format_action(action): [*map(format_fact, action.delete_effects)] for action in grounding.actions}
    assert removed["Part P=P2 Q=P1"] == removed["Part P=P1 Q=P2"] == ["near(P1, P2)"]
    assert [[*map(format_fact, grounding.forbidden_facts(action))] for action in grounding.actions if format_action(action) == "goal"] == [
        ["near(P1, P2)"]
    ]


@pytest.mark.parametrize(
    ("effect", "facts", "expected"),
    [
        ("?A on ?B", "", ["A=T1 B=P1", "A=T1 B=T2"]),
        ("?A near ?B", "", ["A=P1 B=T1", "A=T1 B=P1", "A=T1 B=T2", "A=T2 B=T1"]),
        ("?A tiedTo ?B", "", ["A=T1 B=P1", "A=T1 B=T2"]),
        ("?A follows ?B", "", ["A=T1 B=P1", "A=T1 B=T2"]),
        ("?A likes ?B", "", ["A=T1 B=P1", "A=T1 B=T1", "A=T1 B=T2"]),
        ("?A likes ?B", "T1 likes P1", ["A=T1 B=P1", "A=T1 B=T1", "A=T1 B=T2"]),
    ],
)
def test_nothing_enters_into_some_relations_with_itself(effect: str, facts: str, expected: list[str]) -> None:
    relation = effect.split()[1]
    objects = {"T1": "Thing", "T2": "Thing", "P1": "Place"}
    do_service = service("Do", None, effect, A="Object", B="Object")
    grounding = ground_problem(make_world(f"T1 {relation} ?X: Object", do_service, facts=facts, objects=objects))
    assert format_actions(grounding) == [f"Do {inputs_text}" for inputs_text in expected]


@pytest.mark.parametrize(
    ("effect", "new_value"),
    [
        ("?T.Level = 2 m", "2 m"),
        ("?T.Level = 200 cm", "2 m"),
        ("?T.Level = 2", "2 m"),
        ("?T.Level = 2 kg", None),
        ("?T.Level = 0 m", "0 m"),
        ("?T.Level = 5 m", "5 m"),
        ("?T.Level = 6 m", None),
        ("?T.Level = 0 m - 1 m", None),
        ("?T.Level = TRUE", None),
        ("?T.Level = ?T.Weight", None),
        ("?T.Count = 2 m", "2"),
        ("?T.Clean = TRUE", "TRUE"),
        ("?T.Clean = FALSE", "FALSE"),
        ("?T.Clean = 1", None),
        ('?T.Label = "a"', '"a"'),
        ("?T.Label = 1", None),
        ("?T.Mode = Slow", "Slow"),
        ('?T.Mode = "Slow"', "Slow"),
        ("?T.Mode = Slower", None),
        ("?T.Mode = 1", None),
        ("?T.Colour = Any", "Any"),
        ("?T.Nothing = 1", None),
        ("P1.Clean = TRUE", None),
        ("P1.Level = 1 m", "1 m"),
    ],
)
def test_which_values_attributes_are_given(effect: str, new_value: str | None) -> None:
    path = effect.split()[0].partition(".")[2]
    owner = "P1" if effect.startswith("P1") else "T1"
    do_service = service("Do", None, f"{effect} AND ?T likes P2", T="Thing")
    grounding = ground_problem(make_world("T1 likes P2", do_service))
    expected = [["." + path + f"({owner}, {new_value})", "likes(T1, P2)"]] if new_value is not None else []
    assert [[*map(format_fact, action.add_effects)] for action in grounding.actions if action.operator.service] == expected


def test_the_service_may_be_given_either_truth_and_no_value_that_nobody_named() -> None:
    grounding = ground_problem(make_world("T1.Clean = TRUE", service("Set", None, "?T.Clean = ?V AND ?T likes P1", T="Thing", V="truth")))
    assert format_actions(grounding) == ["Set T=T1 V=TRUE"]
    assert not grounding.joins.guessed
    free_grounding = ground_problem(make_world("T1 likes P1", service("Set", None, "?T.Clean = ?V AND ?T likes P1", T="Thing", V="truth")))
    assert format_actions(free_grounding) == ["Set T=T1 V=FALSE", "Set T=T1 V=TRUE"]
    assert not free_grounding.joins.guessed
    for type_name, path in (("number", "Count"), ("text", "Label")):
        do_service = service("Set", None, f"?T.{path} = ?V AND ?T likes P1", T="Thing", V=type_name)
        guessed = ground_problem(make_world("T1 likes P1", do_service))
        assert (format_actions(guessed), guessed.joins.guessed, guessed.is_goal_reachable) == ([], True, False)


def test_a_comparison_gives_a_variable_its_value() -> None:
    values: dict[str, dict[str, float | str | bool]] = {"T1": {"Count": 2.0}, "T2": {"Count": 3.0}}
    same_service = service("Same", "?V = ?Of.Count AND ?Of likes ?T", "?T.Weight = ?V AND marked(?T)", T="Thing", V="number")
    grounding = ground_problem(make_world("marked(C1)", same_service, facts="T1 likes C1", values=values))
    assert (format_actions(grounding), grounding.joins.guessed) == (["Same T=C1 V=2 Of=T1"], False)


def test_a_value_that_a_comparison_gives_has_to_meet_the_other_conditions() -> None:
    values: dict[str, dict[str, float | str | bool]] = {"T1": {"Count": 2.0}, "T2": {"Count": 4.0}, "C1": {"Count": 5.0}}
    do_service = service("Do", "?V = ?T.Count + 1 AND ?V >= 5 AND ?V != 6", "marked(?T)", T="Thing", V="number")
    grounding = ground_problem(make_world("marked(?X)", do_service, values=values))
    assert (format_actions(grounding), grounding.joins.guessed) == (["Do T=T2 V=5"], False)


def test_a_fact_of_a_symmetric_relation_that_comes_about_is_so_both_ways_round() -> None:
    join = service("Join", None, "?P near ?Q", P="Place", Q="Place")
    for goal, robot_place in (("R1 at P1", "P2"), ("R1 at P2", "P1")):
        grounding = ground_problem(make_world(goal, GO_SERVICE, join, facts=f"R1 at {robot_place}"))
        assert grounding.is_goal_reachable
        assert {action_text for action_text in format_actions(grounding) if action_text.startswith("Go")} == {
            "Go To=P1 Provider=R1 From=P2",
            "Go To=P2 Provider=R1 From=P1",
        }


@pytest.mark.parametrize(
    ("precondition", "expected"),
    [
        ("?T.Weight <= 2 kg", ["T=T1"]),
        ("NOT ?T.Weight <= 2 kg", ["T=C1", "T=T2"]),
        ("NOT ?T likes ?X", ["T=C1", "T=T2"]),
        ("?T likes P1", ["T=T1"]),
        ("?T != T1", ["T=C1", "T=T2"]),
        ("?T likes ?T", []),
    ],
)
def test_what_the_map_settles(precondition: str, expected: list[str]) -> None:
    do_service = service("Mark", precondition, "marked(?T)", T="Thing")
    values: dict[str, dict[str, float | str | bool]] = {"T1": {"Weight": 1.0}, "T2": {"Weight": 3.0}}
    grounding = ground_problem(make_world("marked(?X)", do_service, facts="T1 likes P1", values=values))
    assert format_actions(grounding) == [f"Mark {inputs_text}" for inputs_text in expected]


@pytest.mark.parametrize(
    ("goal", "facts", "expected"),
    [
        ("NOT T1 on P1 AND marked(T1)", "T1 on P1", ["on(T1, P1)"]),
        ("NOT ?X on P1 AND marked(T1)", "T1 on P1, T2 on P1, C1 on P2", ["on(C1, P1)", "on(T1, P1)", "on(T2, P1)"]),
        ("NOT ?X: Cup on P1 AND marked(T1)", "T1 on P1, C1 on P1", ["on(C1, P1)"]),
        ("NOT ?X likes ?X AND marked(T1)", "T1 likes T1, T1 likes T2", ["likes(T1, T1)"]),
        ("NOT T1.Level = 2 m AND marked(T1)", "", [".Level(T1, 2 m)"]),
        ("NOT T1.Level >= 1 m AND marked(T1)", "", [".Level(T1, 2 m)"]),
        ("NOT T1.Level > 2 m AND marked(T1)", "", []),
    ],
)
def test_what_must_not_be_so(goal: str, facts: str, expected: list[str]) -> None:
    services = [
        service("Put", None, "?T on ?P", T="Thing", P="Place"),
        service("Like", None, "NOT ?T likes ?P", T="Thing", P="Object"),
        service("Empty", None, "?T.Level = 0 m", T="Thing"),
        service("Mark", None, "marked(?T)", T="Thing"),
    ]
    grounding = ground_problem(make_world(goal, *services, facts=facts, values={"T1": {"Level": 2.0}}))
    (goal_action,) = (action for action in grounding.actions if action.operator.service is None)
    assert sorted(map(format_fact, grounding.forbidden_facts(goal_action))) == expected


def test_so_many_actions_are_allowed_and_no_more() -> None:
    instance = make_world("marked(?X)", service("Mark", None, "marked(?T)", T="Thing"))
    count = len(ground_problem(instance).actions)
    assert count == 6
    assert len(ground_problem(instance, max_actions=count).actions) == count
    with pytest.raises(TooLarge, match="there are more than 5 ways to use services, the last one of them the task's goal"):
        ground_problem(instance, max_actions=5)
    with pytest.raises(TooLarge, match="there are more than 1 ways to use services, the last one of them Mark"):
        ground_problem(instance, max_actions=1)


def test_so_many_facts_are_looked_at_and_no_more() -> None:
    instance = make_world("T1 on P2", PUT_SERVICE, TAKE_SERVICE, GO_SERVICE, facts="T1 on P1, R1 at P1, P2 near P1")
    with pytest.raises(TooLarge, match=r"there are too many ways to use services, (Put|Take|Go) among them"):
        ground_problem(instance, effort=2)
    sufficient_effort = next(effort for effort in range(1, 200) if _reached(instance, effort))
    assert not _reached(instance, sufficient_effort - 1)
    mark = make_world("marked(P1)", facts="marked P1")
    assert _reached(mark, 20), "an action has its effort, too"


def _reached(instance: tuple[Problem, World], effort: int) -> bool:
    try:
        return ground_problem(instance, effort=effort).is_goal_reachable
    except TooLarge:
        return False


def test_counters_are_compared_and_set_with_the_objects_named() -> None:
    fill = service("Fill", "?T.Count < ?Of.Count", "?T.Count = ?T.Count + 1", T="Thing", Of="Cup")
    close = service("Close", "?T.Count >= 3", "marked(?T)", T="Thing")
    grounding = ground_problem(make_world("T1.Count >= 2 AND marked(T1)", fill, close, counting=True))
    descriptions = [
        (
            format_action(action),
            [*map(str, action.numeric_conditions)],
            [f"{target} = {source}" for target, source in action.numeric_effects],
        )
        for action in grounding.actions
    ]
    assert ("Fill T=T1 Of=C1", ["T1.Count < C1.Count"], ["T1.Count = T1.Count + 1"]) in descriptions
    assert ("Close T=T1", ["T1.Count >= 3"], []) in descriptions
    assert ("goal", ["T1.Count >= 2"], []) in descriptions


def places(number: int, goal: str, standing: str, narrow: bool = True, type_name: str = "Place") -> list[str]:
    """Where a thing may be put, of so many places."""
    objects = {"T1": "Thing", "T2": "Thing", "C1": "Cup", "R1": "Robot", **{f"P{n:02}": type_name for n in range(number)}}
    put_service = service("Put", None, "?T on ?P", T="Thing", P=type_name)
    grounding = ground_problem(make_world(goal, put_service, facts=standing, objects=objects), narrow=narrow)
    return [action_text.partition("P=")[2] for action_text in format_actions(grounding)]


def test_when_planning_narrowly_so_many_places_are_tried_those_first_where_such_things_stand() -> None:
    assert len(places(40, "T1 on ?X: Place", "", narrow=False)) == 40
    assert places(40, "T1 on ?X: Place", "") == [f"P{n:02}" for n in range(16)]
    assert places(40, "T1 on ?X: Place", "T2 on P30") == [*(f"P{n:02}" for n in range(15)), "P30"]
    assert places(10, "T1 on ?X: Place", "T2 on P05") == [f"P{n:02}" for n in range(10)]
    assert places(40, "T1 on ?X: Place", "T2 on C1") == [f"P{n:02}" for n in range(16)]
    standing_facts = ", ".join(f"X{n} on P{n:02}" for n in range(20, 40))
    assert places(40, "T1 on ?X: Place", standing_facts) == [f"P{n:02}" for n in range(20, 36)]


def test_a_value_is_a_number_in_the_unit_of_its_attribute() -> None:
    grounding = ground_problem(make_world("T1.Level = 2 m", service("Set", None, "?T.Level = 200 cm", T="Thing")))
    assert grounding.is_goal_reachable
    assert [ground_fact for ground_fact in grounding.facts.new if ground_fact[0] == ".Level"] == [(".Level", ("T1", Number(2.0, "m")))]
