"""Formulas while they are written: what is wrong with them, all at once, and what can come next."""

from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.api.context import Context
from somrs.api.formulas import CheckFormula, CheckResult, CompleteFormula, FormulaService, check_text
from somrs.client.refusals import NotFound
from somrs.entish.parse import parse
from somrs.errors import FormulaError, UsageError
from somrs.ontology.check import check
from somrs.ontology.completion import Completions, complete
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from tests.support.paths import SCENARIO_1

SITE = SCENARIO_1
ONTOLOGY = load([str(SITE)]).ontology
MAP = load([str(SITE)]).map or Map()
FORMULAS = FormulaService(cast(Context, SimpleNamespace(ontology=ONTOLOGY, map=MAP)))


def checking(text: str, **variables: str) -> CheckResult:
    return check_text(text, ONTOLOGY, MAP, variables)


def completing(marked: str) -> Completions:
    """What can come at the `|` in the text, else at its end."""
    cursor = marked.index("|") if "|" in marked else len(marked)
    return complete(marked.replace("|", "", 1), cursor, ONTOLOGY, MAP)


def words(marked: str) -> list[str]:
    return [item.text for item in completing(marked).items]


# What is wrong


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("Jar002 isOn Platform001", []),
        ("Jar002 isOm Table001", ["isOm"]),
        ("Jar002 isOn Table9 AND Jar003 isOm Table001", ["Table9", "isOm"]),
        ("Jar9 isOn Table001 OR (NOT Jar8 isOn Table001 AND Jar002 isOn Platform001)", ["Jar9", "Jar8"]),
        ("Jar002.Shape.Hight = 3", ["Shape.Hight"]),
        ("FORALL ?Jar: Graspable (NOT ?Jar isOm Table001) AND EXISTS ?x: Tabel (Jar002 isOn ?x)", ["isOm", "Tabel"]),
        ("NOT (FORALL ?Jar: Graspable (?Jar isOn Table9 AND", ["Table9", ""]),
        ('Jar002 isOn Table001 AND Jar003.Label = "a AND', ['"']),
        # A mistake is said while the formula is not there to its end, and when another part cannot be read.
        ("Jar002 isOm Table001 AND Jar003 isOn", ["isOm", ""]),
        ("Jar002 isOm Table001 AND ( AND Jar9 isOn Table001", ["isOm", "AND", "Jar9"]),
        ("distance(Jar9, Robot1) < 3 AND (Jar002 isOn", ["Jar9", ""]),
        ("Jar002 isOn ?x: Foo AND ?x isOn Bar", ["Foo", "Bar"]),
        ("Jar002.Weight < 30 cm", ["30"]),
        ("$", ["$"]),
    ],
)
def test_every_mistake_has_its_place(text: str, wrong: list[str]) -> None:
    result = checking(text)
    assert [text[problem.position : problem.end] for problem in result.problems] == wrong
    assert result.ok == (not wrong)


def test_a_mistake_says_what_was_meant() -> None:
    (problem,) = checking("Jar002 isOm Table001").problems
    assert (problem.problem, problem.hint) == ("there is no relation isOm", "did you mean isOn?")


@pytest.mark.parametrize(
    "text", ["", "  ", "Jar002", "Jar002 isOn ", "NOT", "Jar002 isOn Table001 AND", "(Jar002 isOn Table001", "Jar002.Color ="]
)
def test_what_ends_too_early_is_unfinished_rather_than_wrong(text: str) -> None:
    result = checking(text)
    assert result.unfinished
    assert not result.ok


@pytest.mark.parametrize("text", ["Jar002 isOm", "Jar9 isOn Table001 AND", "Jar002 isOn isOn isOn", "Jar002 isOn Table001"])
def test_what_is_wrong_or_right_is_not_unfinished(text: str) -> None:
    assert not checking(text + " AND Jar7.Weight = 3 AND").unfinished


def test_variables_may_have_types_from_elsewhere() -> None:
    assert checking("?Self.Weight <= 5 kg", Self="Jar").ok
    assert [problem.problem for problem in checking("?Self.Speed <= 5", Self="Wall").problems] == ["a Wall has no attribute Speed"]


LETTERS = (
    'Jar002 Jar9 isOn isOm Table001 AND OR NOT ( ) ? ?x : Jar . Color Shape.Height = < Red 5 kg " # - + * , distance connects TRUE ż 𝔸 \\'
)
TEXTS = st.text(max_size=30) | st.lists(st.sampled_from([*LETTERS.split(" "), " ", " ", "\n"]), max_size=14).map("".join)


@given(TEXTS, st.integers(min_value=-3, max_value=60))
def test_no_text_is_too_odd(text: str, cursor: int) -> None:
    result = checking(text)
    assert all(0 <= problem.position <= problem.end <= len(text) for problem in result.problems)
    assert result.ok or result.problems
    offered = complete(text, cursor, ONTOLOGY, MAP)
    assert 0 <= offered.start <= offered.end <= len(text)
    assert len({item.text for item in offered.items}) == len(offered.items)


@given(TEXTS)
def test_the_first_mistake_is_the_one_that_check_raises(text: str) -> None:
    raised: FormulaError | None = None
    try:
        check(text, ONTOLOGY, MAP)
    except FormulaError as error:
        raised = error
    problems = {(problem.position, problem.problem) for problem in checking(text).problems}
    assert ((raised.position, raised.problem) in problems) if raised is not None else not problems


# What can come next


@pytest.mark.parametrize(
    ("marked", "first"),
    [
        ("", ["Door001", "Jar002", "Jar003"]),  # what services act on comes before walls
        ("jar", ["Jar002", "Jar003"]),
        ("lab", ["Room001"]),  # by its label
        ("cupb", ["Cupboard001"]),
        ("Jar002 ", ["isOn", "isIn"]),
        ("Jar002 isH", ["isHeldBy"]),
        ("Jar002 isHeldBy ", ["Robot1", "Robot2"]),
        ("Jar002 isOn pla", ["Platform001"]),
        ("Robot1 isAt ", ["Entrance", "Charger001", "Charger002"]),
        ("Jar002.Col", ["Color"]),
        ("Jar002.Shape.", ["Form", "Width", "Depth", "Height"]),
        ("Jar002.Color = ", ["Black", "White"]),
        ("Jar002.Color = Re", ["Red"]),
        ("Door001.Open = ", ["TRUE", "FALSE"]),
        ("Room001.Label = ", ['"Laboratory"', '"Store"']),
        ('Room001.Label = "S', ['"Store"']),
        ("Jar002.Weight > 5 ", ["kg", "g", "AND", "OR"]),
        ("Jar002.Weight ", ["=", "!=", "<"]),
        ("?x: Bott", ["Bottle"]),
        ("?Where: Support isPartOf Room001 AND Jar002 isOn ?", ["?Where"]),
        ("?J isOn Table001 AND ?J.Pos", ["PositionX", "PositionY", "PositionZ"]),
        ("connects(Door001, ", ["Room001", "Room002"]),
        ("range(", ["Robot1", "Robot2"]),
        ("distance(Jar002, Rob", ["Robot1", "Robot2"]),
        ("distance(Jar002, Robot1) ", ["=", "!=", "<"]),
        ("distance(Jar002, Robot1) < 3 ", ["m", "mm", "cm", "km", "AND", "OR"]),
        ("connects(Door001, Room001, ", ["Room001", "Room002"]),
        ("connects(", ["Door001", "?Door: Door"]),
        ("Jar002.Weight < 5 kg + 3 ", ["kg", "g", "AND", "OR"]),
        ("Jar002.Weight < Jar003.Weight * ", ["Door001", "Jar002"]),
        ("Jar002.Weight < 3 kg ", ["AND", "OR"]),
        ("5 kg ", ["=", "!=", "<"]),
        ("Door001.Open ", ["=", "!="]),
        ("?x:Jar ", ["isOn", "isIn"]),
        ("?x:Bottle.We", ["Weight"]),
        ("(Jar002 isOn Table001) ", ["AND", "OR"]),
        ("Jar002 isOn Table001 an", ["AND"]),
        ("# jar", []),
        ("Jar002 isOn Platform001", []),  # nothing else than what is there
        ("Jar9 isOm Foo AND ( OR jar", ["Jar002", "Jar003"]),  # whatever is wrong elsewhere
    ],
)
def test_what_can_come_next(marked: str, first: list[str]) -> None:
    assert words(marked)[: len(first)] == first
    assert first or not words(marked)


@pytest.mark.parametrize(
    ("marked", "kind"),
    [
        ("", "object"),
        ("Jar002 ", "relation"),
        ("Jar002.", "attribute"),
        ("Door001.Open = ", "value"),
        ("Jar002.Color = ", "value"),
        ("Room001.Label = ", "value"),
        ("Jar002.Weight > 5 ", "unit"),
        ("?x: ", "type"),
        ("?Where: Support isPartOf Room001 AND Jar002 isOn ?", "variable"),
        ("Jar002.Weight ", "operator"),
        ("Jar002 isOn Table001 ", "keyword"),
    ],
)
def test_what_comes_is_said_to_be_what_it_is(marked: str, kind: str) -> None:
    assert completing(marked).items[0].kind == kind


@pytest.mark.parametrize(
    ("marked", "start", "end", "first"),
    [
        ("Jar|9 isOn Table001", 0, 4, "Jar002"),
        ("Jar002 |isOn Table001", 7, 7, "isOn"),
        ("Jar002 is|Om Table001", 7, 11, "isOn"),
        ("Jar002 isOn Pl| AND Jar003 isOn Table001", 12, 14, "Platform001"),
        ("Jar002.Sh|.Height = 3", 7, 9, "Shape"),
    ],
)
def test_in_the_middle_of_a_text(marked: str, start: int, end: int, first: str) -> None:
    completions = completing(marked)
    assert (completions.start, completions.end, completions.items[0].text) == (start, end, first)


def test_only_what_fits_is_offered() -> None:
    held = completing("Jar002 isHeldBy ").items
    assert {item.text for item in held if item.kind == "object"} == {"Robot1", "Robot2"}
    assert "Speed" not in words("Jar002.")
    assert "Speed" in words("Robot1.")
    assert "isHeldBy" not in words("Room001 ")


@given(st.data())
def test_what_is_offered_can_be_written(data: st.DataObject) -> None:
    """Whoever takes what is offered, again and again, may not be at the end, but writes nothing wrong."""
    text = ""
    for _ in range(data.draw(st.integers(min_value=1, max_value=14))):
        # The signs within parentheses, and numbers, are not offered.
        items = [item for item in complete(text, len(text), ONTOLOGY, MAP).items if item.suffix != "("]
        if not items:
            break
        item = data.draw(st.sampled_from(items))
        text += item.text + item.suffix
        result = checking(text)
        assert result.ok or result.unfinished, (text, result.problems)


def test_many_objects_are_no_burden() -> None:
    objects = [Object(name=f"Shelf{number}", type="Shelf", values={"Label": f"Aisle {number % 70}"}) for number in range(2500)]
    objects += [Object(name=f"Jar{number}", type="Jar") for number in range(2500)]
    map = Map(objects, [Fact("isOn", (f"Jar{number}", f"Shelf{number}")) for number in range(2500)])
    complete("Jar1 isOn ", 10, ONTOLOGY, map)
    for text in ("", "Jar24", "Jar1 isOn ", "Jar1 isOn aisle", "Jar1 isOn shelf2", "Jar1.Label = "):
        start_time = time.process_time()
        completions = complete(text, len(text), ONTOLOGY, map)
        elapsed = time.process_time() - start_time
        assert completions.items
        assert elapsed < 0.5, f"{text!r} took {elapsed * 1000:.0f} ms"


# For those who do not write formulas


def test_things_are_found_by_name_label_and_type() -> None:
    async def names(**query: object) -> list[str]:
        return [thing.name for thing in (await FORMULAS.things(**query)).things]  # type: ignore[arg-type]

    async def run() -> None:
        assert await names(typed="jar") == ["Jar002", "Jar003"]
        assert await names(typed="laboratory") == ["Room001"]
        assert await names(typed="pioneer") == ["Robot1", "Robot2"]
        assert await names(relation="isHeldBy", place=1) == ["Robot1", "Robot2"]
        assert (await names(relation="isOn", place=1))[:5] == ["Cupboard001", "Platform001", "Table001", "Table002", "Shelf001"]
        assert await names(type="Charger") == ["Charger001", "Charger002"]
        things = await FORMULAS.things(limit=2)
        assert len(things.things) == 2
        assert things.is_truncated
        assert (await FORMULAS.things(typed="Jar002")).things[0].location == "Cupboard001"
        with pytest.raises(NotFound, match="did you mean isOn"):
            await names(relation="isOm")
        with pytest.raises(UsageError, match="no place 2"):
            await names(relation="isOn", place=2)

    asyncio.run(run())


def test_what_can_be_said_of_a_thing() -> None:
    sayable = asyncio.run(FORMULAS.sayable("Jar002"))
    assert sayable.relations[0].name == "isOn"
    assert sayable.relations[0].achievable
    attributes = {attribute.path: attribute for attribute in sayable.attributes}
    assert attributes["Weight"].units == ("kg", "g")
    assert attributes["Weight"].now == 0.3
    assert "Red" in attributes["Color"].values
    with pytest.raises(NotFound, match="did you mean"):
        asyncio.run(FORMULAS.sayable("Jar02"))


@pytest.mark.parametrize(
    ("thing", "target", "formula"),
    [
        ("Jar002", "Platform001", "Jar002 isOn Platform001"),
        ("Jar002", "Entrance", "Jar002 isOn Entrance"),
        ("Jar002", "Robot1", "Jar002 isHeldBy Robot1"),
        ("Robot1", "Entrance", "Robot1 isAt Entrance"),
    ],
)
def test_what_it_means_to_bring_a_thing_somewhere(thing: str, target: str, formula: str) -> None:
    placings = asyncio.run(FORMULAS.placings(thing, target))
    assert placings.formulas[0] == formula
    assert all(parse(text) for text in placings.formulas)


def test_the_operations_answer_like_the_functions() -> None:
    assert asyncio.run(FORMULAS.check(CheckFormula(text="Jar9 isOn Table001"))) == checking("Jar9 isOn Table001")
    assert asyncio.run(FORMULAS.complete(CompleteFormula(text="jar", cursor=3))) == completing("jar")
