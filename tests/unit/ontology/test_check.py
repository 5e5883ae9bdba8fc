"""Formulas that do not fit an ontology or a map, and where that is shown."""

from __future__ import annotations

import pytest
from hypothesis import given

from somrs.entish.formula import Formula
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.check import check
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.units import convert_unit, is_known_unit
from tests.support.examples import examples
from tests.support.small_ontology import ONTOLOGY, formulas, maps

MAP = Map(
    [
        Object(name="Jar1", type="Jar"),
        Object(name="Table1", type="Table"),
        Object(name="Robot1", type="PioneerP3DX"),
        Object(name="Door1", type="Door"),
        Object(name="Hall", type="Room"),
    ]
)


@pytest.mark.parametrize(
    "text",
    [
        "Jar1 isOn Table1",
        "?x isOn Table1 AND ?x isAt ?y",
        "connects(Door1, Hall, ?Room: Room)",
        "?x.OperationRange < 5 km",
        "Jar1.Color = Red AND Jar1.Color = ?c AND ?c != Blue",
        'Jar1.Label = "sugar"',
        "Jar1.Shape.Height > 5 cm",
        "Robot1.Price < 5 EUR",
        "Robot1.Charge > 20 %",
        "Robot1.Speed < 5 km/h",
        "Jar1.RotationZ = 90 °",
        "range(?Provider) >= distance(?Object, ?Provider)",
        "?x isOn Table1 OR connects(Door1, ?x, Hall)",
        "?w < 5 kg AND Jar1.Weight = ?w",
        "?n: number = Jar1.Weight",
        "?t: text = Jar1.Label",
        "Robot1 = ?x AND ?x != ?y AND ?y isOn Table1",
        "Robot1.Charge - 5 % >= 20 %",
        "Jar1.Weight * 2 + 500 g <= ?w AND ?w = Table1.Weight",
        "distance(Jar1, Robot1) * 2 - 1 <= range(Robot1)",
    ],
)
def test_what_fits(text: str) -> None:
    assert check(text, upper(), MAP) == parse(text)
    assert check(parse(text), upper(), MAP) == parse(text)
    assert check(text, upper()) == parse(text)


@pytest.mark.parametrize(
    ("text", "position", "problem", "hint"),
    [
        ("Jar1 isOm Table1", 5, "there is no relation isOm", "isOn"),
        ("Jra1 isOn Table1", 0, "there is no object Jra1", "Jar1"),
        ("Table1 isPartOf Hall AND Jra1 isOn Table1", 25, "there is no object Jra1", "Jar1"),
        ("Hall isOn Table1", 0, "Hall is a Room, and here a PhysicalObject is meant", ""),
        ("Jar1 isHeldBy Table1", 14, "Table1 is a Table, and here a Device is meant", ""),
        ("?x: Room isOn Table1", 0, "?x is a Room, and here a PhysicalObject is meant", ""),
        ("?x isAt Table1 AND ?x: Jar isOn Hall", 0, "?x is a Jar, and here a Device is meant", ""),
        ("?x isOn ?y: Tabel", 12, "there is no type Tabel", "Table"),
        ("connects(Door1, Hall)", 0, "connects joins 3 objects, not 2", "Passage, Space, Space"),
        ("Jar1.Weigth < 5", 5, "Jar1, a Jar, has no attribute Weigth", "Weight"),
        ("?x: Room.Weight < 5", 9, "a Room has no attribute Weight", ""),
        ("Jar1.Weight < 5 m", 14, "kg and m do not measure the same thing", ""),
        ("Jar1.Weight < 5 blah", 14, "kg and blah do not measure the same thing", ""),
        ("Jar1.Weight = heavy", 14, "Jar1.Weight is a number, and heavy is a name", ""),
        ("Jar1.Color = Rad", 13, "Rad is no Color", "Red"),
        ("Jar1.Color = Rot", 13, "Rot is no Color", "one of Black"),
        ('Jar1.Color = "Red"', 13, "a value of a list", "without quotes: Red"),
        ("Jar1.Color < Red", 11, "< compares numbers", "use = or !="),
        ("Jar1.Label = sugar", 13, "is a text", 'in quotes: "sugar"'),
        ("Door1.Open = 5", 13, "TRUE or FALSE", ""),
        ("Jar1.Shape = 5", 5, "Shape is a group of attributes", "Form, Width"),
        ("distanc(Jar1, Hall) < 5", 0, "there is no function distanc", "distance"),
        ("distance(Jar1) < 5", 0, "distance takes 2 objects, not 1", ""),
        ("distance(Jar1, 5) < 5", 15, "5 is not an object", ""),
        ("range(Jar1) < 5", 6, "Jar1 is a Jar, and here a Device is meant", ""),
        ("?w < 5 kg AND Robot1.OperationRange = ?w", 21, "do not measure the same thing", ""),
        ("?x: number isOn Table1", 0, "a number, and here an object", ""),
        ("Jar1.Weight + 5 m < 3 kg", 14, "kg and m do not measure the same thing", ""),
        ("Jar1.Weight * 5 m < 3 kg", 20, "do not measure the same thing", ""),
        ("Jar1.Weight + Jar1.Label < 3 kg", 19, "Jar1.Label is a text, and + is for numbers", ""),
        ("?x isOn Table1 AND Jar1.Weight < 2 * ?x", 37, "?x is an object, and * is for numbers", ""),
        ("Rob1 = ?x", 0, "neither an object on the map nor a value", "Robot1"),
    ],
)
def test_what_does_not_fit_is_shown_in_its_place(text: str, position: int, problem: str, hint: str) -> None:
    with pytest.raises(FormulaError) as caught:
        check(text, upper(), MAP)
    assert problem in caught.value.problem
    assert hint in caught.value.hint
    assert caught.value.position == position


def test_declared_variables() -> None:
    declared = {"Object": "Graspable", "Destination": "Object"}
    assert check("?Object isOn ?Destination", upper(), variables=declared) == parse("?Object isOn ?Destination")
    with pytest.raises(FormulaError, match="Graspable, and here a Device"):
        check("?Object isAt ?Place", upper(), variables=declared)
    with pytest.raises(FormulaError, match="no type Graspeble"):
        check("?Object isOn ?Place", upper(), variables={"Object": "Graspeble"})


@examples(75)
@given(formulas, maps())
def test_any_formula_fits_or_is_refused_in_a_place(formula: Formula, map: Map) -> None:
    text = str(formula)
    try:
        assert check(text, ONTOLOGY, map) == formula
    except FormulaError as error:
        refusal = error
    else:
        return
    assert 0 <= refusal.position < len(text)


def test_units() -> None:
    assert convert_unit(500, "g", "kg") == pytest.approx(0.5)
    assert convert_unit(0, "°C", "K") == pytest.approx(273.15)
    assert convert_unit(3, "EUR", "EUR") == 3
    assert convert_unit(3, "pieces", "pieces") == 3
    for unit in ("s", "blah", "m**", "", "1/0", "kg/0", "***", "m^m"):
        assert convert_unit(1, unit, "m") is None
    assert is_known_unit("m/s")
    assert is_known_unit("EUR")
    assert is_known_unit("percent")
    assert not is_known_unit("blah")
