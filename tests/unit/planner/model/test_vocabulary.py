"""Which facts services can change, and which facts replace each other."""

from __future__ import annotations

import pytest

from somrs.entish import Truth
from somrs.entish.parse import parse_term
from somrs.planner.model.vocabulary import Argument, Fact, Inexpressible
from tests.support.planner_vocabulary import ALL_EFFECTS, make_vocabulary


def test_a_vocabulary_has_what_effects_speak_of_and_what_these_replace() -> None:
    vocabulary = make_vocabulary("?T on ?P AND NOT marked(?T)", "?T.Clean = TRUE", "2 m = ?T.Level")
    assert vocabulary.relations == {"on", "heldBy", "marked"}
    assert vocabulary.paths == {"Clean", "Level"}
    assert vocabulary.counters == set()


def test_only_numbers_are_counters_and_only_when_counting() -> None:
    vocabulary = make_vocabulary("?T.Clean = TRUE", "?T.Level = 2 m", "?T.Unknown = 1", counting=True)
    assert vocabulary.counters == {"Level"}
    assert vocabulary.paths == {"Clean", "Unknown"}


@pytest.mark.parametrize(
    ("effects", "calculates"),
    [
        (("?T.Level = 1 m",), False),
        (("?T.Level = ?T.Level + 1 m",), True),
        (("?T.Level + 1 m = ?T.Level",), True),
        (("?T.Level = ?T.Level + 1 m", "?T.Clean = TRUE"), True),
        (("marked(?T)",), False),
    ],
)
def test_whether_effects_calculate(effects: tuple[str, ...], calculates: bool) -> None:
    assert make_vocabulary(*effects).calculates is calculates


@pytest.mark.parametrize(
    ("relation", "excluded", "exclusive", "symmetric"),
    [
        ("on", ["heldBy"], True, False),
        ("heldBy", ["on"], True, False),
        ("at", [], True, False),
        ("near", [], False, True),
        ("marriedTo", [], False, True),
        ("meet", [], False, False),
        ("tiedTo", ["gluedTo"], False, False),
        ("gluedTo", ["tiedTo"], False, False),
        ("marked", [], False, False),
        ("unknown", [], False, False),
    ],
)
def test_which_relations_replace_each_other(relation: str, excluded: list[str], exclusive: bool, symmetric: bool) -> None:
    vocabulary = make_vocabulary(ALL_EFFECTS)
    assert vocabulary.excluded_by(relation) == tuple(excluded)
    assert vocabulary.is_exclusive(relation) is exclusive
    assert vocabulary.is_symmetric(relation) is symmetric


@pytest.mark.parametrize(
    ("fact", "variable"),
    [
        (("on", ("T1", "P1")), ("place", "T1")),
        (("heldBy", ("T1", "R1")), ("place", "T1")),
        (("at", ("R1", "P1")), ("at", "R1")),
        ((".Clean", ("T1", Truth(True))), (".Clean", "T1")),
        (("near", ("P1", "P2")), None),
        (("marked", ("T1",)), None),
    ],
)
def test_facts_that_replace_each_other_share_a_variable(fact: Fact, variable: tuple[str, Argument] | None) -> None:
    assert make_vocabulary(ALL_EFFECTS).variable_of(fact) == variable


@pytest.mark.parametrize(
    ("term", "read"),
    [
        ("T1.Level", "T1.Level"),
        ("?T.Level", "?T.Level"),
        ("T1.Weight", None),
        ("level(T1)", "T1.Level"),
        ("level(?T)", "?T.Level"),
        ("level(2)", None),
        ("level(T1, T2)", None),
        ("weight(T1)", None),
        ("unknown(T1)", None),
        ("distance(T1, P1)", None),
        ("T1", None),
    ],
)
def test_terms_that_read_what_services_change(term: str, read: str | None) -> None:
    listed, counting = make_vocabulary("?T.Level = 1 m"), make_vocabulary("?T.Level = 1 m", counting=True)
    assert listed.changing(parse_term(term)) == (parse_term(read) if read is not None else None)
    assert counting.counter(parse_term(term)) == (parse_term(read) if read is not None else None)
    assert listed.counter(parse_term(term)) is None
    assert counting.changing(parse_term(term)) is None


@pytest.mark.parametrize("path", ["PositionX", "PositionY"])
def test_a_distance_is_not_counted_with_where_services_move_things(path: str) -> None:
    with pytest.raises(Inexpressible, match=r"distance\(T1, P1\): services on offer move what it measures") as raised:
        make_vocabulary(f"?T.{path} = 1 m").changing(parse_term("distance(T1, P1)"))
    assert raised.value.formula == parse_term("distance(T1, P1)")
    assert raised.value.reason == "services on offer move what it measures"
