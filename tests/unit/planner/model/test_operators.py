"""What service types become for a search: what they need, forbid, test, add and take away."""

from __future__ import annotations

import pytest

from somrs.entish import Name, Number
from somrs.entish.parse import parse, parse_term
from somrs.ontology.services import Parameter, ServiceType
from somrs.planner.model.operators import Operator, goal_operators, operators
from somrs.planner.model.vocabulary import GOAL, Inexpressible, Pattern, Vocabulary, providers_of
from tests.support.planner_vocabulary import ALL_EFFECTS, make_vocabulary


def service(precondition: str | None, effect: str, outputs: tuple[str, ...] = (), **inputs: str) -> ServiceType:
    return ServiceType(
        name="Does",
        inputs=tuple(Parameter(name=name, type=type_name) for name, type_name in inputs.items()),
        outputs=tuple(Parameter(name=name, type="Object") for name in outputs),
        precondition=precondition,
        effect=effect,
    )


def compile_operator(precondition: str | None, effect: str, vocabulary: Vocabulary | None = None, **inputs: str) -> Operator:
    (operator,) = operators(service(precondition, effect, (), **inputs), vocabulary or make_vocabulary(ALL_EFFECTS))
    return operator


def compile_goal(goal: str, vocabulary: Vocabulary | None = None) -> Operator:
    (operator,) = goal_operators(parse(goal), vocabulary or make_vocabulary(ALL_EFFECTS))
    return operator


def format_pattern(pattern: Pattern) -> str:
    return f"{pattern[0]}({', '.join(map(str, pattern[1]))})"


def describe_operator(operator: Operator) -> dict[str, list[str]]:
    """What an operator says, of the fields that say anything."""
    description = {
        "needs": [format_pattern(pattern) for pattern in operator.preconditions],
        "forbids": [
            format_pattern(negative.pattern) + (f" if {negative.test.comparison}" if negative.test else "")
            for negative in operator.negative_preconditions
        ],
        "tests": [str(test.comparison) for test in operator.tests],
        "static": [str(literal) for literal in operator.static_conditions],
        "adds": [format_pattern(pattern) for pattern in operator.add_effects],
        "removes": [format_pattern(pattern) for pattern in operator.delete_effects],
        "counts": [str(literal) for literal in operator.numeric_conditions],
        "sets": [f"{target} = {source}" for target, source in operator.numeric_effects],
    }
    return {field: lines for field, lines in description.items() if lines}


# Services


@pytest.mark.parametrize(
    ("precondition", "effect", "expected"),
    [
        (None, "marked(?T)", {"adds": ["marked(?T)"]}),
        (None, "NOT marked(?T)", {"removes": ["marked(?T)"]}),
        ("marked(?T)", "?T on P1", {"needs": ["marked(?T)"], "adds": ["on(?T, P1)"]}),
        ("NOT marked(?T)", "?T on P1", {"forbids": ["marked(?T)"], "adds": ["on(?T, P1)"]}),
        ("?T heldBy ?R", "NOT marked(?T)", {"needs": ["heldBy *(?T)"], "removes": ["marked(?T)"]}),
        ("?T heldBy ?R", "?R at P1", {"needs": ["heldBy(?T, ?R)"], "adds": ["at(?R, P1)"]}),
        ("?T heldBy ?R AND ?T on ?P AND ?P near ?Q", "marked(?T)", {"needs": ["heldBy *(?T)", "on(?T, ?P)", "near(?P, ?Q)"]}),
        ("?T heldBy R1", "marked(?T)", {"needs": ["heldBy(?T, R1)"]}),
        ("?T gluedTo ?P", "marked(?T)", {"needs": ["gluedTo(?T, ?P)"]}),
        ("?T tiedTo ?P", "marked(?T)", {"needs": ["tiedTo(?T, ?P)"]}),
        ("?T on ?P: Object", "marked(?T)", {"needs": ["on *(?T)"]}),
        ("?T on ?P: Place", "marked(?T)", {"needs": ["on *(?T)"]}),
        ("?T on ?P: Cup", "marked(?T)", {"needs": ["on(?T, ?P)"]}),
        ("meet(?T, T1, P1) AND NOT meet(?T, T2, P1)", "marked(?T)", {"static": ["meet(?T, T1, P1)", "NOT meet(?T, T2, P1)"]}),
        ("?T.Weight <= 2 kg", "marked(?T)", {"static": ["?T.Weight <= 2 kg"]}),
        ("NOT ?T.Weight <= 2 kg", "marked(?T)", {"static": ["NOT ?T.Weight <= 2 kg"]}),
        ("?T.Level <= 2 m", "marked(?T)", {"needs": [".Level(?T, ??T.Level)"], "tests": ["??T.Level <= 2 m"]}),
        ("NOT ?T.Level <= 2 m", "marked(?T)", {"forbids": [".Level(?T, ??T.Level) if ??T.Level <= 2 m"]}),
        (
            "?T.Level + 1 m <= level(T1)",
            "marked(?T)",
            {"needs": [".Level(?T, ??T.Level)", ".Level(T1, ?T1.Level)"], "tests": ["??T.Level + 1 m <= ?T1.Level"]},
        ),
        (None, "marked(?T) AND ?T.Level = 2 m", {"adds": ["marked(?T)", ".Level(?T, 2 m)"]}),
        (None, "marked(?T) AND 2 m = ?T.Level", {"adds": ["marked(?T)", ".Level(?T, 2 m)"]}),
        (None, "marked(?T) AND T1.Level = ?T.Weight", {"adds": ["marked(?T)", ".Level(T1, ?T.Weight)"]}),
        (None, "marked(?T) AND T1.Level = ?T.Level", {"needs": [".Level(?T, ??T.Level)"], "adds": ["marked(?T)", ".Level(T1, ??T.Level)"]}),
    ],
)
def test_what_a_service_becomes(precondition: str | None, effect: str, expected: dict[str, list[str]]) -> None:
    description = describe_operator(compile_operator(precondition, effect))
    assert description == {**({"adds": ["marked(?T)"]} if effect == "marked(?T)" else {}), **expected}


def test_when_counting_numbers_are_compared_and_set_apart_from_facts() -> None:
    vocabulary = make_vocabulary(ALL_EFFECTS, counting=True)
    operator = compile_operator(
        "?T.Level >= 1 m AND NOT ?T.Level > 5 m AND ?T.Clean = TRUE", "?T.Level = ?T.Level - 1 m AND 1 m = T1.Level", vocabulary
    )
    assert describe_operator(operator) == {
        "needs": [".Clean(?T, ??T.Clean)"],
        "tests": ["??T.Clean = TRUE"],
        "counts": ["?T.Level >= 1 m", "NOT ?T.Level > 5 m"],
        "sets": ["?T.Level = ?T.Level - 1 m", "T1.Level = 1 m"],
    }


def test_the_variables_that_have_to_be_bound() -> None:
    operator = compile_operator(
        "?Provider at ?P AND NOT ?X on ?P AND NOT ?Y.Weight = 1 kg AND meet(?A, ?B, ?C) AND ?T.Weight < 2 kg", "?T on ?P"
    )
    assert operator.variables == ("Provider", "P", "T", "A", "B", "C")
    counting = compile_operator(
        "?A.Level >= 1 m AND NOT ?X.Level > 1 m AND NOT marked(?M)",
        "?B.Level = ?D.Level AND NOT marked(?E)",
        make_vocabulary(ALL_EFFECTS, counting=True),
        Z="Thing",
    )
    assert counting.variables == ("Z", "E", "A", "B", "D")


def test_a_place_that_does_not_matter_is_not_bound() -> None:
    assert compile_operator("?T heldBy ?R", "marked(?T)", T="Thing").variables == ("T",)


def test_the_types_that_variables_must_be_of() -> None:
    operator = compile_operator("?T on ?P AND NOT ?X heldBy ?Provider AND ?P near ?Q: Object", "?T heldBy ?Provider", T="Cup")
    assert operator.types == {
        "T": {"Cup", "Thing"},
        "P": {"Place"},
        "Q": {"Object", "Place"},
        "Provider": {"provider of Does", "Robot"},
    }
    assert providers_of("Does") == "provider of Does"


def test_a_variable_behind_not_is_of_the_type_that_is_written() -> None:
    assert compile_operator("NOT ?X: Cup on P1", "marked(T1)").types == {"X": {"Cup"}}


def test_values_come_with_the_tolerance_of_their_attribute() -> None:
    operator = compile_operator("?T.Level = 1 m AND ?T.Clean = TRUE", "marked(?T)")
    assert [dict(test.hidden) for test in operator.tests] == [{"?T.Level": 0.5}, {"?T.Clean": 0.0}]


def test_the_provider_is_bound_only_where_formulas_speak_of_it() -> None:
    assert compile_operator(None, "marked(T1)").variables == ()
    assert compile_operator("T1 heldBy ?Provider", "marked(T1)").variables == ("Provider",)
    assert compile_operator(None, "T1 heldBy ?Provider").variables == ("Provider",)


def test_each_alternative_is_an_operator_with_what_is_written() -> None:
    service_type = service("marked(T1) OR marked(T2)", "marked(T3)")
    operator_list = list(operators(service_type, make_vocabulary(ALL_EFFECTS)))
    assert [operator.condition for operator in operator_list] == [(parse("marked(T1)"),), (parse("marked(T2)"),)]
    assert [operator.preconditions for operator in operator_list] == [(("marked", ("T1",)),), (("marked", ("T2",)),)]
    assert {operator.service for operator in operator_list} == {service_type}
    assert {operator.effect for operator in operator_list} == {parse("marked(T3)")}


@pytest.mark.parametrize(
    ("precondition", "effect", "message"),
    [
        (None, "marked(T1) OR marked(T2)", "marked(T1) OR marked(T2): an effect with OR does not say what becomes true"),
        (None, "T1.Level > 1 m", "T1.Level > 1 m: this does not say what becomes true"),
        (None, "NOT T1.Clean = TRUE", "NOT T1.Clean = TRUE: this does not say what becomes true"),
        (
            "NOT T1.Level = T2.Level",
            "marked(T1)",
            "NOT T1.Level = T2.Level: NOT before a comparison of two attributes that services change",
        ),
    ],
)
def test_what_cannot_be_expressed(precondition: str | None, effect: str, message: str) -> None:
    with pytest.raises(Inexpressible) as raised:
        compile_operator(precondition, effect)
    assert str(raised.value) == message


def test_a_service_that_chooses_what_it_makes_is_not_planned_without_assumptions() -> None:
    vocabulary = make_vocabulary(ALL_EFFECTS)
    assert list(operators(service(None, "T1 on ?P", outputs=("P",)), vocabulary)) == []
    assert len(list(operators(service(None, "T1 on ?P", outputs=("P",), P="Place"), vocabulary))) == 1
    assert len(list(operators(service(None, "T1 on P1", outputs=("P",)), vocabulary))) == 1


def test_there_may_be_so_many_alternatives_and_no_more() -> None:
    eight = " AND ".join(f"(marked(A{n}) OR marked(B{n}))" for n in range(8))
    assert len(list(goal_operators(parse(eight), make_vocabulary(ALL_EFFECTS)))) == 256
    independent = list(goal_operators(parse(f"{eight} AND (marked(C1) OR marked(C2))"), make_vocabulary(ALL_EFFECTS)))
    assert [operator.reaches_goal for operator in independent] == [True] + 18 * [False]
    assert independent[0].preconditions == tuple((f"choice {n} of the goal", ()) for n in range(1, 10))
    related = " AND ".join(f"(?T on A{n} OR ?T on B{n})" for n in range(9))
    with pytest.raises(Inexpressible, match="it has more than 256 alternatives"):
        list(goal_operators(parse(related), make_vocabulary(ALL_EFFECTS)))


def test_objects_that_do_not_depend_on_each_other_are_chosen_one_by_one() -> None:
    goal = "?T: Cup on P1 AND ?U: Cup on P2 AND ?V: Cup on ?W: Thing AND marked(?W) AND NOT marked(P1)"
    first, *choices = goal_operators(parse(goal), make_vocabulary(ALL_EFFECTS))
    assert describe_operator(first) == {
        "needs": ["choice 1 of the goal()", "choice 2 of the goal()", "choice 3 of the goal()"],
        "forbids": ["marked(P1)"],
        "adds": ["()"],
    }
    assert [choice.variables for choice in choices] == [("T",), ("U",), ("V", "W")]
    assert [choice.add_effects for choice in choices] == [((f"choice {n} of the goal", ()),) for n in (1, 2, 3)]


# Goals


def test_a_goal_adds_that_the_task_is_accomplished() -> None:
    operator = compile_goal("?T: Cup on P1 AND NOT marked(?T)")
    assert (operator.service, operator.effect, operator.add_effects) == (None, None, (GOAL,))
    assert describe_operator(operator) == {"needs": ["on(?T, P1)"], "forbids": ["marked(?T)"], "adds": ["()"]}
    assert operator.types == {"T": {"Cup", "Thing"}}
    assert operator.variables == ("T",)


def test_patterns_have_names_as_texts_and_values_as_they_are() -> None:
    operator = compile_operator(None, "T1 on ?P AND T1.Level = 1 m")
    assert operator.add_effects == (("on", ("T1", parse_term("?P"))), (".Level", ("T1", Number(1.0, "m"))))
    assert Name("T1") not in operator.add_effects[0][1]
