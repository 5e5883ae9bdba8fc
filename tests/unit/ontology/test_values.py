"""What terms stand for in a map, what is calculated with them, and how they compare."""

from __future__ import annotations

import pytest

from somrs.entish.formula import Constant, Name, Number, Term, Text, Truth
from somrs.entish.parse import parse_term
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import AttributeType, FunctionType, Kind, Value
from somrs.ontology.values import MeasuredValue, attribute_at, compare, constant, evaluate, measure, value_of
from tests.support.small_ontology import ONTOLOGY as SMALL

ONTOLOGY = SMALL.extended(
    [
        FunctionType(name="way", parameters=("Object", "Object"), values={"A B": 7.0}, unit="km"),
        FunctionType(name="height", parameters=("Object",), unit="m"),
    ]
)
MAP = Map(
    [
        Object(name="A", type="Jar", values={"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 1.0, "Label": "one"}),
        Object(name="B", type="Shelf", values={"PositionX": 4.0, "PositionY": 5.0, "PositionZ": 13.0, "Size": 3.0}),
        Object(name="C", type="Shelf", values={"PositionX": 4.0, "PositionY": 5.0}),
        Object(name="D", type="Shelf", values={"PositionX": 4.0}),
        Object(name="E", type="Shelf", values={"PositionY": 4.0}),
    ]
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("A.Color", "Red"),
        ("A.Label", "one"),
        ("A.Open", True),
        ("B.Open", None),
        ("B.Size", 3.0),
        ("X.Size", None),
        ("?x.Size", None),
        ("A", "A"),
        ("5 cm", 5.0),
        ("size(B)", 3.0),
        ("size(B, A)", None),
        ("size(?x)", None),
        ("unknown(B)", None),
        ("height(B)", None),
        ("way(A, B)", 7.0),
        ("way(B, A)", None),
        ("distance(A, B)", 13.0),
        ("distance(A, C)", 5.0),
        ("distance(A, D)", None),
        ("distance(A, E)", None),
        ("distance(D, A)", None),
        ("distance(A, ?x)", None),
        ("B.Size + 50 cm", 3.5),
        ("50 cm + B.Size", 350.0),
        ("B.Size - 50 cm", 2.5),
        ("B.Size - 0.5", 2.5),
        ("2 * B.Size", 6.0),
        ("0.1 + 0.2", 0.3),
        ("B.Size + 5 kg", None),
        ("B.Size + D.Size", None),
        ("D.Size + B.Size", None),
        ("B.Size + A.Label", None),
        ("A.Label * B.Size", None),
    ],
)
def test_what_a_term_comes_to(text: str, value: Value | None) -> None:
    assert evaluate(parse_term(text), MAP, ONTOLOGY) == value


@pytest.mark.parametrize(
    ("text", "measured"),
    [
        ("B.Size", MeasuredValue(Number(3.0, "m"), 0.5)),
        ("size(B)", MeasuredValue(Number(3.0, "m"), 0.5)),
        ("B.PositionX", MeasuredValue(Number(4.0, "m"))),
        ("way(A, B)", MeasuredValue(Number(7.0, "km"))),
        ("distance(A, C)", MeasuredValue(Number(5.0, "m"))),
        ("A.Color", MeasuredValue(Name("Red"))),
        ("A.Label", MeasuredValue(Text("one"))),
        ("A.Open", MeasuredValue(Truth(True))),
        ("B.Size * 2", MeasuredValue(Number(6.0, "m"), 1.0)),
        ("-2 * B.Size", MeasuredValue(Number(-6.0, "m"), 1.0)),
        ("B.Size * A.Size", MeasuredValue(Number(6.0, "(m) * (m)"), 2.5)),
        ("3 * 4", MeasuredValue(Number(12.0))),
        ("B.Size + A.Size", MeasuredValue(Number(5.0, "m"), 1.0)),
        ("B.Size - A.Size", MeasuredValue(Number(1.0, "m"), 1.0)),
        ("5 + B.Size", MeasuredValue(Number(8.0, "m"), 0.5)),
        ("100 cm + B.Size", MeasuredValue(Number(400.0, "cm"), 50.0)),
    ],
)
def test_tolerances_and_units_are_kept_and_calculated_with(text: str, measured: MeasuredValue) -> None:
    assert measure(parse_term(text), MAP, ONTOLOGY) == measured


@pytest.mark.parametrize(
    ("text", "bound", "measured"),
    [
        ("?x", {"x": Number(5.0, "m")}, MeasuredValue(Number(5.0, "m"))),
        ("?x", {"x": Text("a")}, MeasuredValue(Text("a"))),
        ("?x", {"x": parse_term("A.Size")}, None),
        ("?x", {"y": Name("A")}, None),
        ("?x.Size", {"x": Name("B")}, MeasuredValue(Number(3.0, "m"), 0.5)),
        ("?x.Size", {"x": Text("B")}, None),
        ("distance(A, ?x)", {"x": Name("C")}, MeasuredValue(Number(5.0, "m"))),
        ("?x + 1", {"x": Number(5.0)}, MeasuredValue(Number(6.0))),
    ],
)
def test_what_variables_stand_for(text: str, bound: dict[str, Term], measured: MeasuredValue | None) -> None:
    assert measure(parse_term(text), MAP, ONTOLOGY, bound) == measured


@pytest.mark.parametrize(
    ("left_constant", "right_constant", "holding"),
    [
        (Number(1), Number(1), {"=", "<=", ">="}),
        (Number(1), Number(2), {"!=", "<", "<="}),
        (Number(2), Number(1), {"!=", ">", ">="}),
        (Number(1, "m"), Number(100, "cm"), {"=", "<=", ">="}),
        (Number(1, "m"), Number(2, "cm"), {"!=", ">", ">="}),
        (Number(1, "m"), Number(1), {"=", "<=", ">="}),
        (Number(1), Number(1, "m"), {"=", "<=", ">="}),
        (Number(1, "m"), Number(1, "kg"), set()),
        (Number(1e9), Number(1e9 + 1), {"=", "<=", ">="}),
        (Number(-1e9), Number(-1e9 - 1), {"=", "<=", ">="}),
        (Number(1e9), Number(1e9 + 2), {"!=", "<", "<="}),
        (Number(0), Number(1e-12), {"!=", "<", "<="}),
        (Truth(True), Truth(True), {"="}),
        (Truth(True), Truth(False), {"!="}),
        (Name("a"), Name("a"), {"="}),
        (Name("a"), Text("a"), {"="}),
        (Text("a"), Name("b"), {"!="}),
        (Text("a"), Text("b"), {"!="}),
        (Text("1"), Number(1), set()),
        (Truth(True), Number(1), set()),
        (Truth(True), Name("TRUE"), set()),
    ],
)
def test_what_holds_between_two(left_constant: Constant, right_constant: Constant, holding: set[str]) -> None:
    assert {
        sign for sign in ("=", "!=", "<", "<=", ">", ">=") if compare(MeasuredValue(left_constant), sign, MeasuredValue(right_constant))
    } == holding


@pytest.mark.parametrize(
    ("left_value", "right_value", "is_equal"),
    [
        (MeasuredValue(Number(1), 0.5), MeasuredValue(Number(1.5)), True),
        (MeasuredValue(Number(1)), MeasuredValue(Number(1.5), 0.5), True),
        (MeasuredValue(Number(1), 0.25), MeasuredValue(Number(1.5), 0.25), False),
        (MeasuredValue(Number(1), 0.25), MeasuredValue(Number(1.5), 0.5), True),
        (MeasuredValue(Number(1, "m"), 0.5), MeasuredValue(Number(150, "cm")), True),
        (MeasuredValue(Number(1, "m")), MeasuredValue(Number(150, "cm"), 50), True),
        (MeasuredValue(Number(1, "m")), MeasuredValue(Number(150, "cm"), 40), False),
        (MeasuredValue(Number(1, "m"), 0.4), MeasuredValue(Number(150, "cm"), 30), False),
    ],
)
def test_the_greater_tolerance_decides(left_value: MeasuredValue, right_value: MeasuredValue, is_equal: bool) -> None:
    assert compare(left_value, "=", right_value) is is_equal
    assert compare(left_value, "<", right_value) is not is_equal


def test_own_values_come_before_defaults() -> None:
    assert [value_of(name, "Size", MAP, ONTOLOGY) for name in ("A", "B", "C", "X")] == [2.0, 3.0, None, None]
    shut = Map([Object(name="A", type="Jar", values={"Open": False})])
    assert value_of("A", "Open", shut, ONTOLOGY) is False


def test_values_as_terms() -> None:
    size, label, colour = (ONTOLOGY.attributes[name] for name in ("Size", "Label", "Color"))
    assert constant(True, None) == Truth(True)
    assert [constant(2, attribute) for attribute in (size, None)] == [Number(2.0, "m"), Number(2.0)]
    assert [constant("Red", attribute) for attribute in (colour, label, None)] == [Name("Red"), Text("Red"), Text("Red")]
    assert attribute_at("Shape.Size", ONTOLOGY) == AttributeType(name="Size", kind=Kind.NUMBER, unit="m", tolerance=0.5)
    assert attribute_at("Shape", ONTOLOGY) is None
