"""Which services bring about what, and facts that are found by their arguments."""

from __future__ import annotations

import pytest

from somrs.ontology.services import ServiceType
from somrs.planner.model.facts import Facts
from somrs.planner.model.repertoire import Repertoire, repertoire
from somrs.planner.model.vocabulary import Pattern
from tests.unit.planner.grounding.test_grounding import ONTOLOGY, make_world, service


def describe_repertoire(compiled_repertoire: Repertoire) -> dict[str, list[str]]:
    """For each outcome the patterns of effects that bring it about."""

    def format_pattern(pattern: Pattern) -> str:
        return f"{pattern[0]}({', '.join(map(str, pattern[1]))})"

    return {
        ("" if truth else "NOT ") + predicate: [format_pattern(p) for _, p in entries]
        for (truth, predicate), entries in compiled_repertoire.achievers.items()
    }


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        ("marked(?T)", {"marked": ["marked(?T)"], "marked *": ["marked *(?T)"]}),
        ("NOT marked(?T)", {"NOT marked": ["marked(?T)"]}),
        (
            "?T on ?P",
            {
                "on": ["on(?T, ?P)"],
                "on *": ["on *(?T)"],
                "NOT on": ["on(?T, ?)"],
                "NOT heldBy": ["heldBy(?T, ?)"],
            },
        ),
        ("?T tiedTo ?P", {"tiedTo": ["tiedTo(?T, ?P)"], "tiedTo *": ["tiedTo *(?T)"], "NOT gluedTo": ["gluedTo(?T, ?)"]}),
        ("?T near ?P", {"near": ["near(?T, ?P)", "near(?P, ?T)"], "near *": ["near *(?T)"]}),
        ("NOT ?T near ?P", {"NOT near": ["near(?T, ?P)", "near(?P, ?T)"]}),
        (
            "?T marriedTo ?P",
            {
                "marriedTo": ["marriedTo(?T, ?P)", "marriedTo(?P, ?T)"],
                "marriedTo *": ["marriedTo *(?T)"],
                "NOT marriedTo": ["marriedTo(?T, ?)", "marriedTo(?, ?T)"],
            },
        ),
        ("lent(?T, ?P, T1)", {"lent": ["lent(?T, ?P, T1)"], "lent *": ["lent *(?T)"]}),
        ("?T.Clean = TRUE", {".Clean": [".Clean(?T, TRUE)"], "NOT .Clean": [".Clean(?T, ?)"]}),
        ("?T.Count = 2 AND NOT marked(?T)", {".Count": [".Count(?T, 2)"], "NOT .Count": [".Count(?T, ?)"], "NOT marked": ["marked(?T)"]}),
    ],
)
def test_what_effects_bring_about(effect: str, expected: dict[str, list[str]]) -> None:
    assert describe_repertoire(repertoire(ONTOLOGY, (service("Do", None, effect, T="Object", P="Object"),))) == expected


def test_what_is_counted_comes_about_with_any_value() -> None:
    compiled_repertoire = repertoire(ONTOLOGY, (service("Fill", None, "?T.Count = ?T.Count + 1", T="Thing"),), True)
    assert describe_repertoire(compiled_repertoire) == {".Count": [".Count(?T, ?)"]}


def test_each_alternative_of_each_service_brings_it_about() -> None:
    either_service = service("Either", "marked(T1) OR marked(T2)", "marked(?T)", T="Thing")
    compiled_repertoire = repertoire(ONTOLOGY, (either_service, service("Mark", None, "marked(?T)", T="Thing")))
    assert [operator.service.name for operator, _ in compiled_repertoire.achievers[True, "marked"] if operator.service] == [
        "Either",
        "Either",
        "Mark",
    ]
    assert compiled_repertoire.omissions == ()


def test_services_that_cannot_be_expressed_are_left_out() -> None:
    vague = "T1 on P1 AND (marked(T1) OR marked(T2))"
    doubtful_service = ServiceType(name="Drop", effect=vague)
    compiled_repertoire = repertoire(ONTOLOGY, (doubtful_service, service("Mark", None, "marked(?T)", T="Thing")))
    reason = "an effect with OR does not say what becomes true"
    assert [(str(omission), omission.formula, omission.reason) for omission in compiled_repertoire.omissions] == [
        (f"Drop: marked(T1) OR marked(T2): {reason}", "Drop: marked(T1) OR marked(T2)", reason)
    ]
    assert set(describe_repertoire(compiled_repertoire)) == {"marked", "marked *"}
    assert compiled_repertoire.vocabulary.relations == {"on", "heldBy", "marked"}


# Facts


def test_facts_are_found_by_any_argument() -> None:
    _, world = make_world("marked(T1)", service("Lay", None, "?T on ?P", T="Thing", P="Place"), facts="T1 on P1")
    facts = Facts(world)
    new_facts = [("on", ("T2", "P1")), ("on", ("C1", "P1")), ("on", ("T2", "P2"))]
    assert [facts.add(fact) for fact in (("on", ("T1", "P1")), *new_facts, new_facts[0])] == [False, True, True, True, False]
    assert [*facts.new] == new_facts
    assert [fact in facts for fact in (("on", ("T1", "P1")), *new_facts, ("on", ("C1", "P2")))] == [True, True, True, True, False]
    for known_arguments, matches in (
        ((None, None), [("T1", "P1"), ("T2", "P1"), ("C1", "P1"), ("T2", "P2")]),
        ((None, "P1"), [("T1", "P1"), ("T2", "P1"), ("C1", "P1")]),
        (("T2", None), [("T2", "P1"), ("T2", "P2")]),
        (("C1", "P1"), [("C1", "P1")]),
        ((None, "R1"), []),
    ):
        assert facts.find_facts("on", known_arguments) == matches
        assert facts.count("on", known_arguments) >= len(matches)
    assert [facts.count("on", known_arguments) for known_arguments in ((None, None), (None, "P1"), ("T2", None))] == [4, 3, 2]
