"""Effects made true in maps, and what they end."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.entish.formula import Attribute, Comparison, Formula, Literal, Name, Not, Relation, conjunction, conjuncts
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.differences import differences
from somrs.ontology.effects import apply_effect, changes, evaluate_effect, net_effect
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.paged import LARGE
from somrs.ontology.truth import formula_holds
from tests.support.examples import examples
from tests.support.small_ontology import OBJECTS, ONTOLOGY, constants, facts, maps

MAP = Map(
    [
        Object(name="A", type="Jar", values={"Size": 1.0}),
        Object(name="B", type="Shelf"),
        Object(name="C", type="Shelf"),
        Object(name="D", type="Thing"),
    ],
    [Fact("isOn", ("A", "B")), Fact("isNear", ("B", "C")), Fact("isPairedWith", ("D", "A")), Fact("between", ("A", "B", "C"))],
)


def fact_added(relation: str, *arguments: str) -> Change:
    return FactAdded(Fact(relation, arguments))


def fact_removed(relation: str, *arguments: str) -> Change:
    return FactRemoved(Fact(relation, arguments))


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        ("A isOn B", []),
        ("A isOn C", [fact_removed("isOn", "A", "B"), fact_added("isOn", "A", "C")]),
        ("A isIn C", [fact_removed("isOn", "A", "B"), fact_added("isIn", "A", "C")]),
        ("D isOn B", [fact_added("isOn", "D", "B")]),
        ("NOT A isOn B", [fact_removed("isOn", "A", "B")]),
        ("NOT A isOn C", []),
        ("C isNear B", []),
        ("NOT C isNear B", [fact_removed("isNear", "B", "C")]),
        ("C isNear A", [fact_added("isNear", "C", "A")]),
        ("A isPairedWith C", [fact_removed("isPairedWith", "D", "A"), fact_added("isPairedWith", "A", "C")]),
        ("between(A, C, B)", [fact_added("between", "A", "C", "B")]),
        ("A.Size = 3", [ValueSet("A", "Size", 3.0)]),
        ("A.Size = 300 cm", [ValueSet("A", "Size", 3.0)]),
        ("A.Size = 1.4", []),  # within the tolerance
        ("D.Size = 2", []),  # the type's default
        ("A.Open = TRUE", []),
        ("FALSE = A.Open", [ValueSet("A", "Open", False)]),
        ("A.Color = Blue", [ValueSet("A", "Color", "Blue")]),
        ('B.Label = "one"', [ValueSet("B", "Label", "one")]),
        ("B.Size = D.Size", [ValueSet("B", "Size", 2.0)]),
        (
            "A isOn C AND NOT B isNear C AND A.Color = Blue",
            [
                fact_removed("isOn", "A", "B"),
                fact_added("isOn", "A", "C"),
                fact_removed("isNear", "B", "C"),
                ValueSet("A", "Color", "Blue"),
            ],
        ),
        ("NOT A isOn B AND A isOn C", [fact_removed("isOn", "A", "B"), fact_added("isOn", "A", "C")]),
    ],
)
def test_changes(effect: str, expected: list[Change]) -> None:
    assert changes(parse(effect), MAP, ONTOLOGY) == expected


@pytest.mark.parametrize(
    ("effect", "position", "problem"),
    [
        ("A isOn ?x", 7, "?x is not bound"),
        ("A isOn B OR A isOn C", 2, "OR"),
        ("A.Size > 3", 7, "does not say what becomes true"),
        ("NOT A.Size = 3", 11, "does not say what becomes true"),
        ("A = B", 2, "does not say what becomes true"),
        ("A isOm B", 2, "there is no relation isOm"),
        ("A isOn E", 7, "there is no object E"),
        ("between(A, B)", 2, "joins 3 objects, not 2"),  # as printed: A between B
        ("E.Size = 3", 0, "there is no object E"),
        ("A.Sise = 3", 2, "a Jar has no attribute Sise"),
        ("A.Size = 3 kg", 9, "kg cannot be converted to m"),
        ("A.Size = Red", 9, "is no value of Size"),
        ("A.Color = Rod", 10, "Rod is no Color"),
        ("A.Label = B.Label", 12, "has no value"),
        ("A isOn B AND A isOn C", 2, "contradicts"),
        ("A isOn C AND A isIn B", 2, "contradicts"),
        ("A isOn C AND NOT A isOn C", 2, "contradicts"),
        ("A.Size = 3 AND A.Size = 5", 7, "contradicts"),
    ],
)
def test_what_is_no_effect_is_shown_in_its_place(effect: str, position: int, problem: str) -> None:
    with pytest.raises(FormulaError) as caught:
        changes(parse(effect), MAP, ONTOLOGY)
    assert problem in caught.value.problem
    assert caught.value.position == position


@pytest.mark.parametrize(
    ("effect", "position", "problem", "hint"),
    [
        ("A isOn ?x", 7, "?x is not bound", "an effect is made true of named objects and values"),
        ("A isOn B OR A isOn C", 2, "an effect with OR does not say what becomes true", "choose one of its alternatives"),
        ("A.Size > 3", 7, "this does not say what becomes true", "write Object.Attribute = value"),
        ("NOT A.Size = 3", 11, "this does not say what becomes true", "say which value the attribute gets"),
        ("NOT A isOm B", 6, "there is no relation isOm", "did you mean isOn?"),
        ("A isOn Aa", 7, "there is no object Aa on the map", "did you mean A?"),
        ("A.Sise = 3", 2, "a Jar has no attribute Sise", "did you mean Size?"),
        ("A.Size = 3 kg", 9, "kg cannot be converted to m, the unit of Size", ""),
        ("A.Size = Red", 9, "Red is no value of Size, a number", ""),
        ("A.Open = 3", 9, "3 is no value of Open, a truth", ""),
        ("A.Label = 3", 10, "3 is no value of Label, a text", ""),
        ("A.Color = Rod", 10, "Rod is no Color", "did you mean Red?"),
        ("A.Label = B.Label", 12, "B.Label has no value", ""),
        ("B.Size = B.Size + 1", 16, "B.Size + 1 has no value", ""),
        (
            "A isNear D AND NOT D isNear A",
            21,
            "this contradicts the rest of the effect",
            "an effect says what holds at one moment",
        ),
    ],
)
def test_what_is_said_of_no_effect(effect: str, position: int, problem: str, hint: str) -> None:
    with pytest.raises(FormulaError) as caught:
        changes(parse(effect), MAP, ONTOLOGY)
    assert (caught.value.text, caught.value.position) == (effect, position)
    assert (caught.value.problem, caught.value.hint) == (problem, hint)


@pytest.mark.parametrize(
    ("effect", "evaluated_effect", "expected"),
    [
        ("A.Size = A.Size + 2", "A.Size = 3 m", [ValueSet("A", "Size", 3.0)]),
        ("A.Size = A.Size - 50 cm", "A.Size = 0.5 m", []),  # within the tolerance
        ("A.Size + 1 = A.Size", "A.Size = 2 m", [ValueSet("A", "Size", 2.0)]),
        ("A.Size = 3", "A.Size = 3", [ValueSet("A", "Size", 3.0)]),
        ("B.Size = D.Size", "B.Size = D.Size", [ValueSet("B", "Size", 2.0)]),
        (
            "A.Size = A.Size + 1 AND D isOn C",
            "A.Size = 2 m AND D isOn C",
            [ValueSet("A", "Size", 2.0), fact_added("isOn", "D", "C")],
        ),
    ],
)
def test_what_is_calculated_is_settled_before(effect: str, evaluated_effect: str, expected: list[Change]) -> None:
    assert str(evaluate_effect(parse(effect), MAP, ONTOLOGY)) == evaluated_effect
    assert changes(parse(effect), MAP, ONTOLOGY) == expected
    assert apply_effect(parse(effect), MAP, ONTOLOGY) == MAP.changed(expected)


def test_what_is_not_settled_stays() -> None:
    assert str(evaluate_effect(parse("A.Size > A.Size + 1"), MAP, ONTOLOGY)) == "A.Size > A.Size + 1"
    assert str(evaluate_effect(parse("B.Size = B.Size + 1"), MAP, ONTOLOGY)) == "B.Size = B.Size + 1", "it has no value"
    assert apply_effect(parse("A isOn B"), MAP, ONTOLOGY) is MAP


def test_a_place_by_relation_gives_no_position() -> None:
    map_after = MAP.changed(changes(parse("A isOn C"), MAP, ONTOLOGY))
    assert map_after.objects["A"] == MAP.objects["A"]


# In general

atoms = facts.map(lambda fact: Relation(fact.relation, tuple(Name(name) for name in fact.arguments)))
equations = st.builds(
    Comparison,
    st.builds(Attribute, st.sampled_from(OBJECTS).map(Name), st.sampled_from(["Size", "Color", "Label", "Open"])),
    st.just("="),
    constants,
)
parts: st.SearchStrategy[Literal] = st.one_of(atoms, st.builds(Not, atoms), equations)
effects: st.SearchStrategy[Formula] = st.lists(parts, min_size=1, max_size=4).map(lambda effect_parts: conjunction(*effect_parts))


@examples(100)
@given(effects, maps())
def test_an_effect_becomes_true_or_is_refused(effect: Formula, map: Map) -> None:
    try:
        found_changes = changes(effect, map, ONTOLOGY)
    except FormulaError:
        return
    map_after = map.changed(found_changes)
    assert formula_holds(effect, map_after, ONTOLOGY)
    assert changes(effect, map_after, ONTOLOGY) == []
    if found_changes:
        assert map_after != map
    for change in found_changes:
        assert map.changed([change]) != map, "only real changes"
    for part in conjuncts(effect):
        if isinstance(part, Relation) and part.relation in ("isOn", "isIn"):
            first = str(part.arguments[0])
            assert [f for f in map_after.facts() if f.relation in ("isOn", "isIn") and f.arguments[0] == first] == [
                Fact(part.relation, tuple(str(argument) for argument in part.arguments))
            ]


@examples(50)
@given(st.lists(effects, max_size=5), maps())
def test_indexes_follow_the_changes(sequence: list[Formula], map: Map) -> None:
    """A map that was changed, asked and changed again answers as one that is made anew."""
    for effect in sequence:
        try:
            map = map.changed(changes(effect, map, ONTOLOGY))
        except FormulaError:
            continue
        fresh = Map(map.objects.values(), map.facts())
        for name in OBJECTS:
            assert set(map.facts_about(name)) == set(fresh.facts_about(name)) == {f for f in map.facts() if name in f.arguments}
            assert set(map.facts_with("isOn", 0, name)) == {f.arguments for f in map.facts("isOn") if f.arguments[0] == name}


NAMES = ("A", "B", "C")
any_change = st.one_of(
    st.builds(
        ObjectAdded,
        st.builds(
            Object,
            name=st.sampled_from(NAMES),
            type=st.sampled_from(["Jar", "Shelf"]),
            values=st.dictionaries(st.sampled_from(["Open", "Weight"]), st.sampled_from([True, False]), max_size=2),
        ),
    ),
    st.builds(ObjectRemoved, st.sampled_from(NAMES)),
    st.builds(ValueSet, st.sampled_from(NAMES), st.sampled_from(["Open", "Weight"]), st.sampled_from([None, True, False])),
    st.builds(FactAdded, st.builds(Fact, st.just("near"), st.tuples(st.sampled_from(NAMES), st.sampled_from(NAMES)))),
    st.builds(FactRemoved, st.builds(Fact, st.just("near"), st.tuples(st.sampled_from(NAMES), st.sampled_from(NAMES)))),
)


@examples(75)
@given(st.lists(st.lists(any_change, max_size=4), max_size=4))
def test_every_index_follows_any_change(sequence: list[list[Change]]) -> None:
    """Each map of a history, asked when it was new and when all of its successors are there."""
    maps = [Map([Object(name=name, type="Jar", values={"Open": True}) for name in NAMES])]
    answers = [_answers(maps[0])]
    for changes_ in sequence:
        try:
            maps.append(maps[-1].changed(changes_))
        except KeyError:
            continue  # a value for an object that was removed
        answers.append(_answers(maps[-1]))
    for map, answer in zip(maps, answers, strict=True):
        fresh = Map(map.objects.values(), map.facts())
        assert fresh == map
        assert _answers(map) == answer == _answers(fresh)
        assert map.changed(differences(map, maps[-1])) == maps[-1]
        assert list(differences(map, fresh)) == []


def _answers(map: Map) -> list[set[object]]:
    answers: list[set[object]] = [set(map.of_type(name)) for name in ("Jar", "Shelf")]
    answers += [set(map.with_value(path, value)) for path in ("Open", "Weight") for value in (True, False)]
    answers += [set(map.facts_with("near", place, name)) for place in (0, 1) for name in NAMES]
    return answers


def test_indexes_are_right_while_a_relation_becomes_large_and_small_again() -> None:
    count = 3 * LARGE // 2
    map = Map((Object(name=f"O{n}", type="Jar") for n in range(count)), [Fact("near", (f"O{n}", "O0")) for n in range(0, count, 2)])
    assert len(map.facts_with("near", 1, "O0")) == count / 2
    for n in range(count):
        addition = FactAdded(Fact("near", (f"O{n}", "O1")))
        map = map.changed([addition] if n % 2 else [addition, FactRemoved(Fact("near", (f"O{n}", "O0")))])
    assert len(map.facts_with("near", 1, "O0")) == 0
    assert len(map.facts_with("near", 1, "O1")) == count
    assert set(map.objects_at("near", 1)) == {"O1"}
    assert all(list(map.facts_with("near", 0, f"O{n}")) == [(f"O{n}", "O1")] for n in range(count))
    map = map.changed(ObjectRemoved(f"O{n}") for n in range(5, count))
    assert sorted(map.facts_with("near", 1, "O1")) == [(f"O{n}", "O1") for n in range(5)]
    assert sorted(map.of_type("Jar")) == [f"O{n}" for n in range(5)]


# One effect after the other


@pytest.mark.parametrize(
    ("effects", "net"),
    [
        ([], None),
        (["A isOn B"], None),
        (["A isOn C", "A isOn B"], None),
        (["A isOn C", "D isOn B"], "A isOn C AND D isOn B"),
        (["A isOn C", "A isIn D"], "A isIn D"),
        (["A isOn C", "NOT A isOn C"], "NOT A isOn B"),
        (["NOT A isOn B", "A isOn C"], "A isOn C"),
        (["A isPairedWith C", "C isPairedWith B"], "C isPairedWith B AND NOT D isPairedWith A"),
        (["C isNear A", "B isNear A"], "B isNear A AND C isNear A"),
        (["A.Size = 3", "A.Size = 1"], None),
        (["A.Size = 3 AND A.Size = 5", "D isOn C"], "D isOn C"),
        (["A isOn C AND A isOn D", "A isIn D"], "A isIn D"),
        (["NOT A isOn B", "A isOn B"], None),
        (["A isOn C", "A isOn B", "NOT A isOn B"], "NOT A isOn B"),
        (["Nobody isOn B AND A isOn C", "Nobody isOn C"], None),
        (["D.Size = 4", "B.Size = D.Size", "D.Size = 5"], "B.Size = 4 m AND D.Size = 5 m"),
        (["Nobody isOn B", "A.Open = FALSE"], "A.Open = FALSE"),
    ],
)
def test_what_effects_change_in_the_end(effects: list[str], net: str | None) -> None:
    result = net_effect([*map(parse, effects)], MAP, ONTOLOGY)
    assert (str(result) if result is not None else None) == net


@examples(100)
@given(st.lists(effects, max_size=5), maps())
def test_the_net_effect_leads_to_the_same_map_as_all_effects(sequence: list[Formula], start: Map) -> None:
    """The plain twin applies one effect after the other, to the whole map."""
    step_by_step = start
    for effect in sequence:
        try:
            step_by_step = apply_effect(effect, step_by_step, ONTOLOGY)
        except FormulaError:
            continue
    net = net_effect(sequence, start, ONTOLOGY)
    assert (apply_effect(net, start, ONTOLOGY) if net is not None else start) == step_by_step
